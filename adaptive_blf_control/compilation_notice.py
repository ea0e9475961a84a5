# SPDX-License-Identifier: Apache-2.0
"""A line that says why a program is silent: it compiles the laws for this machine."""

from __future__ import annotations

import sys
from types import TracebackType
from typing import TextIO

from adaptive_blf_control.compiled import before_each_compilation, before_first_compilation

__all__ = ['CompilationNotice', 'announce_compilation']

_ONCE = 'compiling for this machine, once: up to a minute\n'
_told = False


def announce_compilation() -> None:
    """Have one line written to standard error once, where this process compiles anything.

    For programs that use the package from Python; a command has its `CompilationNotice`.
    """
    global _told
    if not _told:
        _told = True
        before_first_compilation(_announce)


def _announce() -> None:
    if not CompilationNotice.active:
        sys.stderr.write(_ONCE)
        sys.stderr.flush()


class CompilationNotice:
    """A context that says on a stream how far compiling is, if anything is compiled in it.

    On a terminal the line counts the functions and goes when the work is done; elsewhere it is
    written once.

    Attributes:
        active: Whether one is in use, of this class.
    """

    active = False

    def __init__(self, stream: TextIO | None = None) -> None:
        """Write to ``stream``, standard error where None."""
        self._stream = sys.stderr if stream is None else stream
        self._functions = 0

    def __enter__(self) -> CompilationNotice:
        self._listening = before_each_compilation(self._one_more)
        self._listening.__enter__()
        CompilationNotice.active = True
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self._listening.__exit__(kind, error, trace)
        CompilationNotice.active = False
        if self._functions and self._stream.isatty():
            self._say('')

    def _one_more(self) -> None:
        self._functions += 1
        if self._stream.isatty():
            self._say(f'compiling for this machine, once: {self._functions} functions')
        elif self._functions == 1:
            self._say(_ONCE)

    def _say(self, text: str) -> None:
        clear = '\r\x1b[K' if self._stream.isatty() else ''
        self._stream.write(clear + text)
        self._stream.flush()
