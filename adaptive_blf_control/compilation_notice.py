# SPDX-License-Identifier: Apache-2.0
"""Lines that say why a program is silent: it compiles the laws for this machine."""

from __future__ import annotations

from collections.abc import Callable
import sys
import time
from types import TracebackType
from typing import TextIO

from adaptive_blf_control.compiled import before_each_compilation, before_own_compilations

__all__ = ['CompilationNotice', 'announce_compilation']

BEGIN = 'compiling for this machine, which is done once and can take minutes'
PERIOD = 20.0  # s between two lines where a line cannot be replaced
_told = False


def announce_compilation() -> None:
    """Have it said on standard error how far compiling is, where this process compiles anything.

    For programs that use the package from Python; a command has its `CompilationNotice`.
    """
    global _told
    if not _told:
        _told = True
        before_own_compilations(_Announcer())


class _Lines:
    """Writes a line with the first function that is compiled, and one now and then after it."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock, self._begin, self._last, self._functions = clock, 0.0, 0.0, 0

    def next(self) -> str:
        """Count a function; return the line that is due, '' for none."""
        now = self._clock()
        self._functions += 1
        if self._functions == 1:
            self._begin = self._last = now
            return f'{BEGIN}\n'
        if now - self._last < PERIOD:
            return ''
        self._last = now
        return f'compiling: {self._functions} functions so far, {now - self._begin:.0f} s\n'


class _Announcer:
    """Writes the lines of a program that has no notice of its own."""

    def __init__(self) -> None:
        self._lines = _Lines(time.monotonic)

    def __call__(self) -> None:
        if not CompilationNotice.active:
            sys.stderr.write(self._lines.next())
            sys.stderr.flush()


class CompilationNotice:
    """A context that says on a stream how far compiling is, if anything is compiled in it.

    On a terminal one line counts the functions and goes when the work is done; elsewhere there is
    a line at the begin and one every `PERIOD` s.

    Attributes:
        active: Whether one is in use, of this class.
    """

    active = False

    def __init__(self, stream: TextIO | None = None,
                 clock: Callable[[], float] = time.monotonic) -> None:
        """Write to ``stream``, standard error where None.

        Args:
            stream: Where to.
            clock: Returns the time [s].
        """
        self._stream = sys.stderr if stream is None else stream
        self._lines, self._functions = _Lines(clock), 0

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
        self._say(f'{BEGIN}: {self._functions} functions' if self._stream.isatty()
                  else self._lines.next())

    def _say(self, text: str) -> None:
        clear = '\r\x1b[K' if self._stream.isatty() else ''
        self._stream.write(clear + text)
        self._stream.flush()
