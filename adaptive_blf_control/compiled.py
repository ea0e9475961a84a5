# SPDX-License-Identifier: Apache-2.0
"""One decorator that compiles a pure array function with numba where numba is installed.

The laws are written as functions over float64 arrays in the subset numba compiles. Without numba
(or with ``NUMBA_DISABLE_JIT=1``) the very same functions run as plain numpy.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
import hashlib
import os
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

__all__ = ['COMPILED', 'all_finite', 'before_each_compilation', 'jit', 'jit_closure']

Function = TypeVar('Function', bound=Callable[..., Any])

try:
    import numba
    from numba.core import event as numba_event
    import scipy.linalg  # noqa: F401 (numba's np.linalg is scipy's LAPACK)
    COMPILED: bool = not numba.config.DISABLE_JIT
except ImportError:  # plain numpy is the documented fallback
    numba = None
    COMPILED = False


def _cache_folder() -> str:
    """Return a folder for machine code that belongs to exactly these sources, '' if none.

    numba itself looks only at the file of the compiled function, not at those it calls: after an
    update it would go on running the old barrier inside the new law.
    """
    package = Path(__file__).parent
    digest = hashlib.sha256()
    for room in ('arms', 'control', 'identification'):  # where the compiled functions are
        for source in sorted((package / room).glob('*.py')):
            digest.update(source.read_bytes())
    folder = package / '__pycache__' / f'numba_{digest.hexdigest()[:16]}'
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return ''
    return str(folder) if os.access(folder, os.W_OK) else ''


CACHE = _cache_folder() if COMPILED else ''


def jit(function: Function) -> Function:
    """Compile a module-level function; the machine code is cached on disk."""
    if numba is None:
        return function
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = CACHE or before
    try:
        compiled = numba.njit(cache=bool(CACHE), error_model='numpy')(function)
    finally:
        numba.config.CACHE_DIR = before
    return compiled  # type: ignore[no-any-return]


def jit_closure(function: Function) -> Function:
    """Compile a function that closes over other compiled functions (not cacheable on disk)."""
    if numba is None:
        return function
    return numba.njit(error_model='numpy')(function)  # type: ignore[no-any-return]


def before_each_compilation(call: Callable[[], None]) -> AbstractContextManager[None]:
    """Return a context in which ``call`` is called before any function is compiled.

    What it raises ends the compilation that was to begin and those it was needed for.
    """
    return nullcontext() if numba is None else _listening(call)


@contextmanager
def _listening(call: Callable[[], None]) -> Iterator[None]:
    class Listener(numba_event.Listener):  # type: ignore[misc]
        def on_start(self, event: object) -> None:
            call()

        def on_end(self, event: object) -> None:
            pass

    with numba_event.install_listener('numba:compile', Listener()):
        yield


@jit
def all_finite(array: np.ndarray) -> bool:
    """Return whether every element is finite."""
    return bool(np.isfinite(array).all())
