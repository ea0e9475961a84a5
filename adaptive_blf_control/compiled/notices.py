# SPDX-License-Identifier: Apache-2.0
"""Calls around what is compiled: to say so, or to stop it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Any

from adaptive_blf_control.compiled.library import COMPILED

if COMPILED:
    from adaptive_blf_control.compiled.library import numba_event

__all__ = ['around_each_compilation', 'around_own_compilations', 'before_each_compilation']


def before_each_compilation(call: Callable[[], None]) -> AbstractContextManager[None]:
    """Return a context in which ``call`` is called before any function is compiled.

    An exception that it raises ends that compilation and those that needed it.
    """
    return around_each_compilation(call, lambda: None)


def around_each_compilation(begin: Callable[[], None],
                            end: Callable[[], None]) -> AbstractContextManager[None]:
    """Return a context in which calls are made around each compilation of any function.

    Args:
        begin: Called before it; an exception that it raises ends that compilation.
        end: Called after it, also where it fails.
    """
    return nullcontext() if not COMPILED else _listening(begin, end)


def around_own_compilations(begin: Callable[[], None], end: Callable[[], None]) -> None:
    """Have calls made around each compilation of a function of this package from now on.

    Args:
        begin: Called before it.
        end: Called after it, also where it fails.
    """
    if not COMPILED:
        return

    class Listener(numba_event.Listener):  # type: ignore[misc]
        def on_start(self, event: Any) -> None:
            if _is_own(event):
                begin()

        def on_end(self, event: Any) -> None:
            if _is_own(event):
                end()

    numba_event.register('numba:compile', Listener())


def _is_own(event: Any) -> bool:
    function = getattr(event.data.get('dispatcher'), 'py_func', None)
    return str(getattr(function, '__module__', '')).startswith('adaptive_blf_control.')


@contextmanager
def _listening(begin: Callable[[], None], end: Callable[[], None]) -> Iterator[None]:
    class Listener(numba_event.Listener):  # type: ignore[misc]
        def on_start(self, event: object) -> None:
            begin()

        def on_end(self, event: object) -> None:
            end()

    with numba_event.install_listener('numba:compile', Listener()):
        yield
