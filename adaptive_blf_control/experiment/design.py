# SPDX-License-Identifier: Apache-2.0
"""From an arm and what is stated about it to the motion that teaches most about it."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arms.clearance import Clearance
from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.errors import SetViolation
from adaptive_blf_control.experiment.criterion import condition
from adaptive_blf_control.experiment.descent import descend
from adaptive_blf_control.experiment.motion_limits import (
    MotionLimits,
    Use,
    use_of,
    worst_torque,
)
from adaptive_blf_control.experiment.objective import Objective, times_of
from adaptive_blf_control.experiment.periodic_motion import PeriodicMotion
from adaptive_blf_control.experiment.torque_rows import torque_rows

__all__ = ['Design', 'Task', 'best_motion', 'feasible', 'judged', 'random_motions']

FINE = 48  # samples of a period of the highest harmonic that are checked
STARTS = 12  # random motions of which the best begin a descent
HALVINGS = 12


class Task(NamedTuple):
    """What a motion is for.

    Attributes:
        arm: The arm whose parameters are to be learned.
        limits: That the motion must keep.
        noise: Standard deviation of the measured torques, shape (n,) [N·m].
        period: [s].
        harmonics: Number of harmonics, ≥ 3.
        bodies: Collision bodies, or None.
    """

    arm: UrdfArm
    limits: MotionLimits
    noise: np.ndarray
    period: float
    harmonics: int
    bodies: Clearance | None = None

    def objective(self) -> Objective:
        """Return the function of coefficients that is made small."""
        return Objective(self.arm, self.limits, self.noise, self.period, self.harmonics,
                         self.bodies)


class Design(NamedTuple):
    """A motion, judged on a fine grid of times.

    Attributes:
        motion: The motion.
        information: Mean of YᵀY / σ² over its samples, shape (m, m).
        condition: Of the stacked regressors with columns of length one.
        use: What it uses of its limits.
        distance: Least distance of its collision bodies [m]; infinity without any.
        between: The two bodies of that distance.
    """

    motion: PeriodicMotion
    information: np.ndarray
    condition: float
    use: Use
    distance: float
    between: tuple[str, str]


def best_motion(task: Task, *, steps: int = 150, descents: int = 2, seed: int = 0,
                report: Callable[[int, float], None] | None = None) -> Design:
    """Return the motion of a few descents that teaches most; the same for the same seed.

    Args:
        task: What the motion is for.
        steps: Largest number of quasi-Newton steps of each descent.
        descents: Number of descents, each from a random motion.
        seed: Of the random motions.
        report: Called with the number of steps done and the objective.

    Raises:
        SetViolation: the arm cannot even stand in the middle of its limits.
    """
    objective, random = task.objective(), np.random.default_rng(seed)
    starts = sorted((objective.random(random) for _ in range(STARTS)), key=objective.value)
    found = []
    for k, start in enumerate(starts[:descents]):
        def say(step: int, value: float, done: int = k * steps) -> None:
            if report is not None:
                report(done + step, value)

        x = descend(objective.value, objective.gradient, start, steps, say)
        found.append(judged(task, feasible(task, objective.motion(x))))
    return min(found, key=lambda design: design.condition)


def random_motions(task: Task, count: int, seed: int = 0) -> list[Design]:
    """Return random motions around the middle of the limits, as large as these allow."""
    objective, random = task.objective(), np.random.default_rng(seed)
    return [judged(task, feasible(task, objective.motion(4.0 * objective.random(random))))
            for _ in range(count)]


def feasible(task: Task, motion: PeriodicMotion) -> PeriodicMotion:
    """Return the motion with amplitudes as large as its limits allow, at most its own.

    Raises:
        SetViolation: its centre is not inside of the limits.
    """
    if _kept(task, motion):
        return motion
    _check_standing(task, motion.centre)
    low, high = 0.0, 1.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _kept(task, motion.scaled(middle)) else (low, middle)
    return motion.scaled(low)


def judged(task: Task, motion: PeriodicMotion) -> Design:
    """Judge a motion on a fine grid of times."""
    states = motion.at(times_of(task.period, task.harmonics, FINE))
    rows = torque_rows(task.arm.arrays, *states)
    scaled = (rows / task.noise[:, None]).reshape(-1, rows.shape[-1])
    gram = scaled.T @ scaled / len(rows)
    distance, between = (np.inf, ('', '')) if task.bodies is None else task.bodies.least(states.q)
    return Design(motion, gram, condition(gram), use_of(states, rows, task.limits), distance,
                  between)


def _kept(task: Task, motion: PeriodicMotion) -> bool:
    states = motion.at(times_of(task.period, task.harmonics, FINE))
    if use_of(states, torque_rows(task.arm.arrays, *states), task.limits).largest > 1.0:
        return False
    return task.bodies is None or task.bodies.kept(states.q)


def _check_standing(task: Task, centre: np.ndarray) -> None:
    """Raise SetViolation where the arm cannot stand in a posture."""
    still = np.zeros_like(centre)[None]
    rows = torque_rows(task.arm.arrays, centre[None].copy(), still, still)
    torque = worst_torque(rows, task.limits.prior)[0]
    for joint, value, limit in zip(task.arm.joints, torque, task.limits.torque):
        if value > limit:
            raise SetViolation(joint, float(value), float(limit), 'the torque that holds the arm '
                               'in the centre of the motion', unit='N·m',
                               recovery='another --centre, or less --mass-error or --payload')
    if task.bodies is not None and not task.bodies.kept(centre[None]):
        distance, between = task.bodies.least(centre[None])
        least = float(task.bodies.wanted[task.bodies.pairs.index(between)])
        raise SetViolation(' and '.join(between), distance, least,
                           'the distance in the centre of the motion', unit='m',
                           kind='bodies', recovery='another --centre, or --srdf')
