# SPDX-License-Identifier: Apache-2.0
"""Friction of joints as columns of a regressor: viscous, Coulomb, square-root, and a constant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.arrays import checked_array, checked_finite, dimensions
from adaptive_blf_control.errors import ParameterError

__all__ = ['FRICTION_KINDS', 'JointFriction', 'coulomb_columns', 'finite_array']

FRICTION_KINDS = {'viscous': 'fv', 'coulomb': 'fc', 'offset': 'f0', 'square_root': 'fs'}
"""Kinds of friction in the order of their columns, with the prefix of their parameters."""


class JointFriction:
    """The chosen columns of τ_f = diag(fv) q̇ + diag(fc + fs √|q̇|) tanh(q̇/v_s) + f0.

    The square root is for drives whose friction grows less than in proportion to the speed, as
    that of lubricated gears does.

    Attributes:
        names: Parameter names, ``fv_<joint>`` of all joints, then ``fc_``, ``f0_``, ``fs_``.
        nominal: Nominal coefficients in the order of ``names``.
        dissipates: Which of them a passive joint has ≥ 0, shape of ``nominal``: all but f0.
        coulomb_velocity: v_s [rad/s].
    """

    def __init__(self, joints: Sequence[str], nominal: Mapping[str, object],
                 coulomb_velocity: float) -> None:
        """Choose columns.

        Args:
            joints: Joint names, length n.
            nominal: For each chosen kind of `FRICTION_KINDS` its coefficients, a scalar or
                shape (n,) [N·m·s/rad, N·m, N·m, N·m·(s/rad)^½].
            coulomb_velocity: v_s [rad/s], > 0.

        Raises:
            ParameterError: If a value is not finite, negative (all but offset) or too short.
        """
        self.coulomb_velocity = checked_finite('coulomb_velocity', coulomb_velocity,
                                               'a speed > 0 [rad/s]', above=0.0)
        self._n = len(joints)
        self._kinds = tuple(kind for kind in FRICTION_KINDS if kind in nominal)
        self.names = tuple(f'{FRICTION_KINDS[kind]}_{joint}'
                           for kind in self._kinds for joint in joints)
        values = [finite_array(kind, nominal[kind], self._n) for kind in self._kinds]
        for kind, value in zip(self._kinds, values, strict=True):
            if kind != 'offset' and value.min() < 0.0:
                raise ParameterError(kind, nominal[kind], 'coefficients that are not negative')
        self.nominal = np.concatenate([np.zeros(0), *values])
        self.dissipates = np.repeat([kind != 'offset' for kind in self._kinds], self._n)

    def first_columns(self, before: int) -> np.ndarray:
        """Return the first column of each kind of `FRICTION_KINDS`, shape (4,), −1 without it.

        Args:
            before: Number of columns before those of friction.
        """
        return np.array([before + self._n * self._kinds.index(kind) if kind in self._kinds else -1
                         for kind in FRICTION_KINDS])

    def coefficients(self, parameters: np.ndarray) -> np.ndarray:
        """Return the coefficients in rows, in the order of `FRICTION_KINDS`, shape (4, n).

        Kinds that were not chosen are zero.

        Args:
            parameters: In the order of ``names``.
        """
        result = np.zeros((len(FRICTION_KINDS), self._n))
        for i, kind in enumerate(self._kinds):
            result[list(FRICTION_KINDS).index(kind)] = parameters[i * self._n:(i + 1) * self._n]
        return result


def finite_array(name: str, value: object, length: int) -> np.ndarray:
    """Return a scalar or a sequence as an array of finite numbers, shape (length,).

    Raises:
        ParameterError: If it is neither.
    """
    shape = () if dimensions(value) == 0 else (length,)
    expected = f'one finite number or {length} of them'
    try:
        array = checked_array(name, value, shape)
    except ParameterError:
        raise ParameterError(name, value, expected) from None
    if not np.all(np.isfinite(array)):
        raise ParameterError(name, value, expected)
    return np.broadcast_to(array, (length,)).copy()


def coulomb_columns(arm: Arm) -> list[int]:
    """Return the column of each joint's Coulomb torque, −1 where there is none."""
    columns = {name: i for i, name in enumerate(arm.parameters)}
    return [columns.get(f'{FRICTION_KINDS["coulomb"]}_{joint}', -1) for joint in arm.joints]
