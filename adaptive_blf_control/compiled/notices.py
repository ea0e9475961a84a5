# SPDX-License-Identifier: Apache-2.0
"""Calls before something is compiled: to say so, or to stop it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Any

from adaptive_blf_control.compiled.library import COMPILED

if COMPILED:
    from adaptive_blf_control.compiled.library import numba_event

__all__ = ['before_each_compilation', 'before_own_compilations']


def before_each_compilation(call: Callable[[], None]) -> AbstractContextManager[None]:
    """Return a context in which ``call`` is called before any function is compiled.

    An exception that it raises ends that compilation and those that needed it.
    """
    return nullcontext() if not COMPILED else _listening(call)


def before_own_compilations(call: Callable[[], None]) -> None:
    """Have ``call`` called before each function of this package that is compiled from now on."""
    if not COMPILED:
        return

    class Listener(numba_event.Listener):  # type: ignore[misc]
        def on_start(self, event: Any) -> None:
            function = getattr(event.data.get('dispatcher'), 'py_func', None)
            if str(getattr(function, '__module__', '')).startswith('adaptive_blf_control.'):
                call()

        def on_end(self, event: object) -> None:
            pass

    numba_event.register('numba:compile', Listener())


@contextmanager
def _listening(call: Callable[[], None]) -> Iterator[None]:
    class Listener(numba_event.Listener):  # type: ignore[misc]
        def on_start(self, event: object) -> None:
            call()

        def on_end(self, event: object) -> None:
            pass

    with numba_event.install_listener('numba:compile', Listener()):
        yield
