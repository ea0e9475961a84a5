# SPDX-License-Identifier: Apache-2.0
"""Which parameters the data determine, and which motion would determine the others."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.identification.uncertainty import NORMAL, Uncertainty

__all__ = ['DETERMINED', 'NOT', 'WEAKLY', 'Motion', 'confidence', 'helpful_motion']

DETERMINED, WEAKLY, NOT = 'determined', 'weakly', 'not'
_STATES = 12  # random postures per motion
_OPEN = 1e6  # variance along directions that are open: larger than any other
_SPEED = 1.0  # rad/s, of a joint without a limit
_SWING = 2.0 * np.pi  # rad/s: reversals at 1 Hz


class Motion(NamedTuple):
    """A motion of one joint while the others stand in various postures.

    Attributes:
        joint: Its name.
        kind: ``range``: slowly through its range, which shows gravity; ``speeds``: at several
            speeds, which shows friction; ``reversals``: quick ones, which show inertia.
    """

    joint: str
    kind: str


def confidence(arm: Arm, theta: np.ndarray, judged: Uncertainty,
               regressors: np.ndarray) -> tuple[str, ...]:
    """Tell for each parameter whether the data determine it.

    ``determined``: its 95 % interval leaves out zero, or is so narrow that all of it makes no more
    torque than the residual, in the recorded motion and in one that moves every joint; ``weakly``:
    neither; ``not``: it can be anything.

    Args:
        arm: The arm.
        theta: θ̂, shape (m,).
        judged: How sure it is.
        regressors: Y_f of the recorded pairs, shape (P, n, m).
    """
    half = NORMAL * judged.std
    torque = np.maximum(np.sqrt(np.mean(regressors ** 2, axis=0)), _moving(arm))
    torque = torque / _floored(judged.residual)[:, None]
    finite = np.isfinite(half)
    matters = np.where(finite, half, 0.0) * torque.max(axis=0) > 1.0
    return tuple(NOT if not known else WEAKLY if unsure else DETERMINED
                 for known, unsure in zip(finite, (half > np.abs(theta)) & matters, strict=True))


def helpful_motion(arm: Arm, judged: Uncertainty, names: Sequence[str]) -> dict[Motion, list[str]]:
    """Return which motion would tell most about parameters, with those it would tell about.

    A motion is worth what a dozen of its states would take off a parameter's variance, C_ii less
    that of C − C Yᵀ(1 + Y C Yᵀ)⁻¹ Y C with the rows of Y in units of the residual.

    Args:
        arm: The arm.
        judged: How sure the estimate is.
        names: Parameters to improve.
    """
    places = [arm.parameters.index(name) for name in names]
    if not places:
        return {}
    covariance = judged.covariance + _OPEN * judged.open @ judged.open.T
    motions = [Motion(joint, kind) for joint in arm.joints
               for kind in ('range', 'speeds', 'reversals')]
    weight = 1.0 / _floored(judged.residual)
    removed = np.array([_removed(covariance, _rows(arm, motion, weight))[places]
                        for motion in motions])
    result: dict[Motion, list[str]] = {}
    for name, best in zip(names, np.argmax(removed, axis=0), strict=True):
        result.setdefault(motions[int(best)], []).append(name)
    return result


def _moving(arm: Arm) -> np.ndarray:
    """Return the RMS of each element of Y while every joint moves, shape (n, m)."""
    random = np.random.default_rng(1)
    lower, upper = _range(arm)
    squares = np.zeros((arm.n, arm.m))
    for _ in range(_STATES):
        q = random.uniform(lower, upper)
        qd, qdd = random.uniform(-_SPEED, _SPEED, (2, arm.n))
        squares += arm.X(q, qd, qd, qdd) ** 2 / _STATES
    return np.sqrt(squares)


def _floored(residual: np.ndarray) -> np.ndarray:
    """Return residuals that can be divided by; those of exact data are zero."""
    return np.maximum(residual, 1e-12)


def _removed(covariance: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return what measurements of unit variance take off each parameter's variance, shape (m,)."""
    seen = rows @ covariance
    inner = np.eye(len(rows)) + seen @ rows.T
    result: np.ndarray = np.sum(seen * np.linalg.solve(inner, seen), axis=0)
    return result


def _rows(arm: Arm, motion: Motion, weight: np.ndarray) -> np.ndarray:
    """Return Y of states of a motion, less what the arm shows at rest, shape (states n, m)."""
    random, n = np.random.default_rng(0), arm.n
    lower, upper = _range(arm)
    speed = 0.5 * np.minimum(getattr(arm, 'velocity_limit', np.full(n, np.inf)), 2.0 * _SPEED)
    joint, still = arm.joints.index(motion.joint), np.zeros(n)
    rows = []
    for k in range(_STATES):
        q, rest = random.uniform(lower, upper), random.uniform(lower, upper)
        rest = np.where(np.arange(n) == joint, rest, q) if motion.kind == 'range' else q
        turn = (-1.0) ** k * random.uniform(0.2, 1.0) * speed[joint] * np.eye(n)[joint]
        qd = turn if motion.kind == 'speeds' else still
        qdd = _SWING * turn if motion.kind == 'reversals' else still
        rows.append(arm.X(q, qd, qd, qdd) - arm.X(rest, still, still, still))
    return (np.array(rows) * weight[:, None]).reshape(-1, arm.m)


def _range(arm: Arm) -> tuple[np.ndarray, np.ndarray]:
    """Return position limits, half a turn where there are none."""
    lower = np.asarray(getattr(arm, 'position_lower', np.full(arm.n, -np.inf)))
    upper = np.asarray(getattr(arm, 'position_upper', np.full(arm.n, np.inf)))
    return (np.where(np.isfinite(lower), lower, -np.pi),
            np.where(np.isfinite(upper), upper, np.pi))
