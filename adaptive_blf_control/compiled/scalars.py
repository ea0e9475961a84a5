# SPDX-License-Identifier: Apache-2.0
"""What is done with single numbers all over: finite, copied, cosine and sine."""

from __future__ import annotations

import math

import numpy as np

from adaptive_blf_control.compiled.decorators import jit
from adaptive_blf_control.compiled.references import borrowed

__all__ = ['all_finite', 'assign_vector', 'both_finite', 'cos_sin', 'is_within']


@jit
def all_finite(array: np.ndarray) -> bool:
    """Return whether every element is finite."""
    finite = True
    for value in array.flat:
        finite = finite and math.isfinite(value)
    return finite


@jit
def both_finite(first: np.ndarray, second: np.ndarray) -> bool:
    """Return whether every element of two vectors is finite; for `entry_for`."""
    return all_finite(borrowed(first)) and all_finite(borrowed(second))


@jit
def is_within(array: np.ndarray, limit: np.ndarray) -> bool:
    """Return whether each element is finite and no larger than its limit, whatever its sign."""
    within = True
    for i in range(array.size):
        within = within and abs(array[i]) <= limit[i] and math.isfinite(array[i])
    return within


@jit
def assign_vector(target: np.ndarray, source: np.ndarray) -> None:
    """Copy a vector into one of its length, without asking whether the two overlap.

    A slice that is assigned to is asked that, which takes longer than to copy a few numbers.
    """
    for i in range(source.size):
        target[i] = source[i]


@jit
def cos_sin(angle: float) -> tuple[float, float]:
    """Return cosine and sine of an angle [rad]; NaN where it is not finite, with numba or without.

    Python's own raise ValueError for an infinite one.
    """
    if not math.isfinite(angle):
        return math.nan, math.nan
    return math.cos(angle), math.sin(angle)
