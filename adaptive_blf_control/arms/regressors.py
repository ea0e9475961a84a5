# SPDX-License-Identifier: Apache-2.0
"""The regressors of an arm as compiled functions call them.

For them an arm is a NamedTuple of its own type, its ``arrays``. What there is to know about it is
`regressors` and `law_regressor`, to which every kind of arm adds its own implementations:

    class PendulumArrays(NamedTuple):
        parameters: int

    @jit
    def pendulum_regressors(arm: PendulumArrays, q, qd): ...

    regressors.register(PendulumArrays, pendulum_regressors)

An arm without ``arrays`` is asked for its regressors in Python, one sample at a time.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.compiled import by_type

__all__ = ['ArmInPython', 'arrays_of', 'law_regressor', 'regressors']

_METHODS = ('X', 'Y1', 'Y12', 'Y2')


@by_type
def regressors(arm: Any, q: np.ndarray, qd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Y1 θ = M q̇ and Y2 θ = −Ṁ q̇ + C q̇ + G + F q̇ (12), each of shape (n, m)."""
    raise TypeError(f'no regressors are registered for {type(arm).__name__}')


@by_type
def law_regressor(arm: Any, q: np.ndarray, qd: np.ndarray, alpha: np.ndarray,
                  alpha_dot: np.ndarray) -> np.ndarray:
    """X of (35), shape (n, m): see `Arm.X`."""
    raise TypeError(f'no regressors are registered for {type(arm).__name__}')


class ArmInPython(NamedTuple):
    """An arm that only its methods know, for the functions of this module uncompiled."""

    arm: Arm


def _regressors_in_python(arm: ArmInPython, q: np.ndarray,
                          qd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return arm.arm.Y12(q, qd)


regressors.register(ArmInPython, _regressors_in_python)


def arrays_of(arm: Any) -> Any:
    """Return an arm as compiled functions take it; None where only its methods know it.

    The methods of a subclass may differ from those that the arrays stand for: then they count.
    """
    kind = type(arm)
    owner = next((cls for cls in kind.__mro__ if 'arrays' in vars(cls)), None)
    if owner is None or any(getattr(kind, name) is not getattr(owner, name) for name in _METHODS):
        return None
    return arm.arrays
