# SPDX-License-Identifier: Apache-2.0
"""How hard all joints can brake at once, at rest, in all postures, for every θ* of a set.

Braking a takes torque C a at most, C ≥ 0, in each of many postures, and C a ≤ b is to hold with b
half of what the arm's weight leaves. What is not given follows one of two rules:

* ``equal``: a ∝ u, with u what the torque limit of each joint could do if all moved alike;
* ``short_stops``: the least Σ (v_j²/a_j)², so that the joints stop on short ways from their
  largest velocities v. A joint that costs little torque gets much and holds nobody back, but no
  joint gets more than it can use while another one needs it. The program is convex, and is solved
  by Newton's method with a logarithmic barrier, which is within r/t of the least value for r rows
  and a weight t of the objective (Boyd and Vandenberghe, Convex Optimization, 11.3).
"""

from __future__ import annotations

from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.arms.regressors import arrays_of, law_regressor
from adaptive_blf_control.arrays import same_values
from adaptive_blf_control.compiled import jit
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.limits.prior import Prior

__all__ = ['Asked', 'checked_braking', 'Resting', 'shortest_stops']

POSTURES = 300
SHARE = 0.5  # of the torque that gravity leaves in each posture
_ANSWERS: WeakKeyDictionary[Arm, tuple[tuple[Any, ...], np.ndarray]] = WeakKeyDictionary()
"""What was asked last of each arm, and the answer: it takes longer than a motion may to begin."""
CLOSE = 0.01  # part by which the sum may be above its least value
NEWTON_STEPS = 100


class Resting(NamedTuple):
    """An arm at rest.

    Attributes:
        arm: The arm.
        prior: The set that θ* is in.
        unexplained: Torque that no θ explains, shape (n,) [N·m].
        limit: Largest torque, shape (n,) [N·m].
    """

    arm: Arm
    prior: Prior
    unexplained: np.ndarray
    limit: np.ndarray

    def shares(self, postures: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return what is left of the limit in postures, and what 1 rad/s² of each joint takes.

        Args:
            postures: Shape (P, n) [rad].

        Returns:
            Shapes (P, n) and (P, n, n) [N·m].
        """
        rows = _rows_at_rest(arrays_of(self.arm), postures)
        largest = np.abs(rows @ self.prior.centre) + self.prior.support(
            rows.reshape(-1, rows.shape[-1])).reshape(rows.shape[:-1])
        return (self.limit - largest[:, 0] - self.unexplained,
                np.swapaxes(largest[:, 1:], 1, 2))


@jit
def _rows_at_rest(arm: Any, postures: np.ndarray) -> np.ndarray:
    """Return the rows of gravity, and of 1 rad/s² of each joint in turn, (P, 1 + n, n, m)."""
    count, n = postures.shape
    rest, axis = np.zeros(n), np.zeros(n)
    first = law_regressor(arm, postures[0], rest, rest, rest)
    rows = np.empty((count, 1 + n, n, first.shape[1]))
    for k in range(count):
        rows[k, 0] = law_regressor(arm, postures[k], rest, rest, rest)
        for j in range(n):
            axis[j] = 1.0
            rows[k, 1 + j] = law_regressor(arm, postures[k], rest, rest, axis) - rows[k, 0]
            axis[j] = 0.0
    return rows


class Asked(NamedTuple):
    """What braking is asked for; arrays of shape (n,).

    Attributes:
        braking: As given [rad/s²]; 0: to be derived.
        rule: ``equal`` or ``short_stops``, see above.
        speed: Largest velocities [rad/s].
        lower: Safety set [rad].
        upper: Likewise.
    """

    braking: np.ndarray
    rule: str
    speed: np.ndarray
    lower: np.ndarray
    upper: np.ndarray


def checked_braking(resting: Resting, asked: Asked) -> np.ndarray:
    """Return the braking, derived where none is given, shape (n,) [rad/s²].

    Raises:
        ParameterError: the torque does not allow it, with the posture: one of random postures of
            the safety set, the same ones each time.
    """
    question = (*resting[1:], *asked)
    before = _ANSWERS.get(resting.arm)
    if before is None or not same_values(question, before[0]):
        before = _ANSWERS[resting.arm] = question, _derived(resting, asked)
    return before[1].copy()


def _derived(resting: Resting, asked: Asked) -> np.ndarray:
    reach = np.clip(np.array([asked.lower, asked.upper]), -np.pi, np.pi)
    postures = np.random.default_rng(0).uniform(reach[0], reach[1], (POSTURES, reach.shape[1]))
    left, cost = resting.shares(postures)
    _refuse(left, postures, 'torque_limit', resting.limit, 'at least what holds the arm')
    braking, free = asked.braking.copy(), ~(asked.braking > 0.0)
    braking[free] = 0.0
    rest = left - cost @ braking
    if free.any() and (rest > 0.0).all():
        own = cost[:, :, free]
        if asked.rule == 'equal':
            unit = resting.limit[free] / own.sum(axis=2).max(axis=0)[free]
            braking[free] = SHARE * float((rest / (own @ unit)).min()) * unit
        else:
            braking[free] = shortest_stops(own.reshape(-1, own.shape[2]), SHARE * rest.reshape(-1),
                                           asked.speed[free])
    _refuse(left - cost @ braking, postures, 'limits.braking', braking,
            'braking that the torque limit allows')
    return braking


def shortest_stops(cost: np.ndarray, budget: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """Return the a > 0 with the least Σ (v²/a)² of which cost @ a ≤ budget, shape (n,).

    Args:
        cost: ≥ 0, and > 0 somewhere in each column, shape (r, n).
        budget: > 0, shape (r,).
        speed: v > 0, shape (n,).
    """
    alone = np.min(budget[:, None] / np.maximum(cost, 1e-300), axis=0)
    rows, ways = cost * alone / budget[:, None], (speed ** 2 / alone) ** 2
    ways /= ways.sum()  # of what each one can have alone, so that the least value is > 1
    part, weight = np.full(alone.size, 0.5 / alone.size), 1.0

    def value(tried: np.ndarray) -> float:
        slack = 1.0 - rows @ tried
        if tried.min() <= 0.0 or slack.min() <= 0.0:
            return np.inf
        return float(weight * (ways / tried ** 2).sum() - np.log(slack).sum())

    while weight < len(rows) / CLOSE:
        weight *= 100.0
        for _ in range(NEWTON_STEPS):
            slack = 1.0 / (1.0 - rows @ part)
            gradient = slack @ rows - 2.0 * weight * ways / part ** 3
            hessian = (rows.T * slack ** 2) @ rows + np.diag(6.0 * weight * ways / part ** 4)
            step = -np.linalg.solve(hessian, gradient)
            slope, length, before = float(gradient @ step), 1.0, value(part)
            if slope > -0.01:
                break
            while value(part + length * step) > before + 0.1 * length * slope:
                length *= 0.5
            part = part + length * step
    return alone * part


def _refuse(reserves: np.ndarray, postures: np.ndarray, name: str, value: np.ndarray,
            expected: str) -> None:
    k, joint = np.unravel_index(int(np.argmin(reserves)), reserves.shape)
    if reserves[k, joint] < 0.0:
        raise ParameterError(
            f'controller.{name}', value.tolist(),
            f'{expected}: at q = {np.round(postures[k], 3).tolist()} rad joint {joint + 1} lacks '
            f'{-reserves[k, joint]:.3g} N*m')
