# SPDX-License-Identifier: Apache-2.0
"""How hard all joints can brake at once, at rest, in all postures, for every θ* of a set."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.arms.regressors import arrays_of, law_regressor
from adaptive_blf_control.compiled import jit
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.limits.parameter_set import ParameterSet

__all__ = ['checked_braking', 'Resting']

POSTURES = 300
SHARE = 0.5  # of the torque that gravity leaves in the worst posture


class Resting(NamedTuple):
    """An arm at rest.

    Attributes:
        arm: The arm.
        parameters: The set that θ* is in.
        unexplained: Torque that no θ explains, shape (n,) [N·m].
        limit: Largest torque, shape (n,) [N·m].
    """

    arm: Arm
    parameters: ParameterSet
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
        largest = np.abs(rows @ self.parameters.centre) + self.parameters.support(
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


def checked_braking(resting: Resting, braking: np.ndarray, lower: np.ndarray,
                    upper: np.ndarray) -> np.ndarray:
    """Return the braking, derived where none is given, shape (n,) [rad/s²].

    Args:
        resting: The arm.
        braking: As given, shape (n,); 0: what half of the torque that gravity leaves in the worst
            of the postures allows, the same part of it for every joint.
        lower: Safety set, shape (n,) [rad].
        upper: Likewise.

    Raises:
        ParameterError: the torque does not allow it, with the posture: one of random postures of
            the safety set, the same ones each time.
    """
    reach = np.clip(np.array([lower, upper]), -np.pi, np.pi)
    postures = np.random.default_rng(0).uniform(reach[0], reach[1], (POSTURES, lower.size))
    left, cost = resting.shares(postures)
    _refuse(left, postures, 'torque_limit', resting.limit, 'at least what holds the arm')
    if not (braking > 0.0).all():
        unit = resting.limit / cost.sum(axis=2).max(axis=0)
        part = SHARE * float((left / (cost @ unit)).min())
        braking = np.where(braking > 0.0, braking, part * unit)
    _refuse(left - cost @ braking, postures, 'limits.braking', braking,
            'braking that the torque limit allows')
    return braking.copy()


def _refuse(reserves: np.ndarray, postures: np.ndarray, name: str, value: np.ndarray,
            expected: str) -> None:
    k, joint = np.unravel_index(int(np.argmin(reserves)), reserves.shape)
    if reserves[k, joint] < 0.0:
        raise ParameterError(
            f'controller.{name}', value.tolist(),
            f'{expected}: at q = {np.round(postures[k], 3).tolist()} rad joint {joint + 1} lacks '
            f'{-reserves[k, joint]:.3g} N*m')
