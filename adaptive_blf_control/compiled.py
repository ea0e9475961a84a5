# SPDX-License-Identifier: Apache-2.0
"""One decorator that compiles a pure array function with numba where numba is installed.

The laws are written as functions over float64 arrays in the subset numba compiles. Without numba
(or with ``NUMBA_DISABLE_JIT=1``) the very same functions run as plain numpy.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

__all__ = ['COMPILED', 'all_finite', 'jit', 'jit_closure']

Function = TypeVar('Function', bound=Callable[..., Any])

try:
    import numba
    import scipy.linalg  # noqa: F401 (numba's np.linalg is scipy's LAPACK)
    COMPILED: bool = not numba.config.DISABLE_JIT
except ImportError:  # plain numpy is the documented fallback
    numba = None
    COMPILED = False


def jit(function: Function) -> Function:
    """Compile a module-level function; the machine code is cached on disk."""
    if numba is None:
        return function
    return numba.njit(cache=True, error_model='numpy')(function)  # type: ignore[no-any-return]


def jit_closure(function: Function) -> Function:
    """Compile a function that closes over other compiled functions (not cacheable on disk)."""
    if numba is None:
        return function
    return numba.njit(error_model='numpy')(function)  # type: ignore[no-any-return]


@jit
def all_finite(array: np.ndarray) -> bool:
    """Return whether every element is finite."""
    return bool(np.isfinite(array).all())
