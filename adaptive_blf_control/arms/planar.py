# SPDX-License-Identifier: Apache-2.0
"""What the planar arms share: names of their joints, regressors, and where their links are."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np

from adaptive_blf_control.arms.arm import ClosedArm
from adaptive_blf_control.arrays import are_vectors, checked_array, checked_vectors
from adaptive_blf_control.calls import checked_call
from adaptive_blf_control.errors import ArmError, close_names, ParameterError, UnknownParameter

__all__ = ['PlanarArm', 'PlanarRegressors', 'planar_points', 'refuse_lengths']


_WORDS = {2: 'two', 3: 'three'}


def refuse_lengths(arm: type, others: Mapping[str, Any]) -> None:
    """Raise ParameterError for what these arms cannot be told, such as the length of a link."""
    for name, value in others.items():
        if close_names(name, ['joints']):
            raise UnknownParameter(name, value, ['joints'])
        raise ParameterError(name, value, f'nothing: {arm.__name__}(joints) is the arm of the '
                             'paper, whose lengths and masses are in theta; another arm is '
                             'load_arm(urdf), or a class that inherits from Arm, and '
                             'simulate(arm, true_parameters=[...]) moves with another theta')


class PlanarRegressors(NamedTuple):
    """The regressors of a planar arm as compiled functions of arrays of shape (n,), see `Arm`."""

    Y1: Callable[[np.ndarray, np.ndarray], np.ndarray]
    Y2: Callable[[np.ndarray, np.ndarray], np.ndarray]
    Y12: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
    X: Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], np.ndarray]


class PlanarArm(ClosedArm):
    """Joint names and regressors of a planar arm; a subclass has the rest of an `Arm`."""

    _regressors: ClassVar[PlanarRegressors]

    def __init__(self, arm: str, joints: Sequence[str], count: int) -> None:
        """Name the joints; ArmError unless they are ``count`` distinct names."""
        given = list(joints) if isinstance(joints, tuple) else joints
        names = tuple(given) if isinstance(given, list) else ()
        named = all(isinstance(name, str) and name for name in names)
        if not named or len(names) != count or len(set(names)) != count:
            raise ArmError(f'{arm} has {_WORDS[count]} joints: expected as many distinct names, '
                           f'got {given!r}')
        self.joints = names
        self._shape = (count,)

    @checked_call
    def Y1(self, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """Momentum regressor, Y1 θ = M(q) q̇ (12), shape (n, m) [N·m·s per unit of θ].

        Raises:
            ParameterError: An array is not of shape (n,); likewise the other regressors.
        """
        if not are_vectors(self._shape, q, qd):
            q, qd = checked_vectors(self.joints, q=q, qd=qd)
        return self._regressors.Y1(q, qd)

    @checked_call
    def Y2(self, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """Y2 θ = −Ṁ q̇ + C q̇ + F q̇ (12), shape (n, m) [N·m per unit of θ]."""
        if not are_vectors(self._shape, q, qd):
            q, qd = checked_vectors(self.joints, q=q, qd=qd)
        return self._regressors.Y2(q, qd)

    @checked_call
    def Y12(self, q: np.ndarray, qd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return Y1 and Y2 of the same state."""
        if not are_vectors(self._shape, q, qd):
            q, qd = checked_vectors(self.joints, q=q, qd=qd)
        return self._regressors.Y12(q, qd)

    @checked_call
    def X(self, q: np.ndarray, qd: np.ndarray, alpha: np.ndarray,
          alpha_dot: np.ndarray) -> np.ndarray:
        """X θ = M α̇ + C q̇ + F q̇ − ½ Ṁ (q̇ − α) (35), shape (n, m) [N·m per unit of θ]."""
        if not are_vectors(self._shape, q, qd, alpha, alpha_dot):
            q, qd, alpha, alpha_dot = checked_vectors(self.joints, q=q, qd=qd, alpha=alpha,
                                                      alpha_dot=alpha_dot)
        return self._regressors.X(q, qd, alpha, alpha_dot)


def planar_points(q: np.ndarray, lengths: Sequence[float]) -> np.ndarray:
    """Return the base and the far end of every link, shape (n + 1, 3) [m], in the x-y plane.

    Args:
        q: Joint positions, each relative to the link before, shape (n,) [rad].
        lengths: Link lengths, length n [m].

    Raises:
        ParameterError: ``q`` has another shape.
    """
    angles = np.cumsum(checked_array('q', q, (len(lengths),)))
    steps = np.column_stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)])
    ends = np.cumsum(steps * np.array(lengths)[:, None], axis=0)
    return np.vstack([np.zeros((1, 3)), ends])
