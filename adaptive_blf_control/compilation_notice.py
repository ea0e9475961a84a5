# SPDX-License-Identifier: Apache-2.0
"""Lines that say why a program is silent: it compiles the laws for this machine."""

from __future__ import annotations

from collections.abc import Callable
import sys
import threading
import time
from types import TracebackType
from typing import TextIO

from adaptive_blf_control.compiled import around_each_compilation, around_own_compilations

__all__ = ['CompilationNotice', 'announce_compilation']

BEGIN = 'compiling for this machine, which is done once and can take minutes'
PERIOD = 20.0  # s between two lines where a line cannot be replaced
QUIET = 2.0  # s without compiling after which what follows is told by itself
LONG = 2.0  # s after which more of it is worth a line
LOOK = 0.5  # s between two looks while a function is compiled
_told = False


def announce_compilation() -> None:
    """Have it said on standard error how far compiling is, where this process compiles anything.

    For programs that use the package from Python; a command has its `CompilationNotice`.
    """
    global _told
    if not _told:
        _told = True
        announcer = _Announcer()
        around_own_compilations(announcer.begin, announcer.end)


class _Lines:
    """Writes a line with the first function that is compiled, and one now and then after it.

    Where something is compiled again later, that is told from its own begin, once it takes long.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock, self._functions, self._more = clock, 0, False
        self._begin = self._last = self._end = 0.0

    def next(self) -> str:
        """Count a function; return the line that is due, '' for none."""
        now = self._clock()
        if self._functions and self._end and now - self._end > QUIET:
            self._functions, self._more = 0, True
        self._functions += 1
        self._end = 0.0
        if self._functions > 1:
            return self._line(now)
        self._begin = self._last = now
        return '' if self._more else f'{BEGIN}\n'

    def due(self) -> str:
        """Return the line that is due while a function is compiled, '' for none."""
        return self._line(self._clock())

    def end(self) -> None:
        """Note that nothing is compiled from now on."""
        self._end = self._clock()

    def _line(self, now: float) -> str:
        first = self._more and self._last == self._begin
        if now - self._last < (LONG if first else PERIOD):
            return ''
        self._last = now
        return (f'compiling{" more" * self._more}: {self._functions} functions so far, '
                f'{now - self._begin:.0f} s\n')


class _Watcher:
    """Knows what is being compiled, and looks now and then whether something is to be said.

    A function can take a minute: a thread looks meanwhile.
    """

    def __init__(self, look: float) -> None:
        self._look, self._depth = look, 0
        self._lock, self._done = threading.Lock(), threading.Event()

    def begin(self) -> None:
        """Say what is due before a function is compiled."""
        with self._lock:
            self._depth += 1
            if self._depth == 1:
                self._done = threading.Event()
                threading.Thread(target=self._watch, args=(self._done,), daemon=True).start()
            self._one_more()

    def end(self) -> None:
        """Take note of a function that has been compiled, or could not be."""
        with self._lock:
            self._depth -= 1
            if self._depth == 0:
                self._done.set()
                self._no_more()

    def _watch(self, done: threading.Event) -> None:
        while not done.wait(self._look):
            with self._lock:
                if not done.is_set():
                    self._meanwhile()

    def _one_more(self) -> None:
        """Say what is due with one function more."""

    def _meanwhile(self) -> None:
        """Say what is due while a function is compiled."""

    def _no_more(self) -> None:
        """Note that nothing is compiled from now on."""


class _Announcer(_Watcher):
    """Writes the lines of a program that has no notice of its own."""

    def __init__(self, clock: Callable[[], float] = time.monotonic, look: float = LOOK) -> None:
        super().__init__(look)
        self._lines = _Lines(clock)

    def _one_more(self) -> None:
        self._say(self._lines.next())

    def _meanwhile(self) -> None:
        self._say(self._lines.due())

    def _no_more(self) -> None:
        self._lines.end()

    def _say(self, text: str) -> None:
        if text and not CompilationNotice.active:
            sys.stderr.write(text)
            sys.stderr.flush()


class CompilationNotice(_Watcher):
    """A context that says on a stream how far compiling is, if anything is compiled in it.

    On a terminal one line counts functions and seconds and goes when the work is done; elsewhere
    there is a line at the begin and one every `PERIOD` s.

    Attributes:
        active: Whether one is in use, of this class.
    """

    active = False

    def __init__(self, stream: TextIO | None = None,
                 clock: Callable[[], float] = time.monotonic, look: float = LOOK) -> None:
        """Write to ``stream``, standard error where None.

        Args:
            stream: Where to.
            clock: Returns the time [s].
            look: How often the line is looked after [s].
        """
        super().__init__(look)
        self._stream, self._clock = sys.stderr if stream is None else stream, clock
        self._lines, self._functions, self._first = _Lines(clock), 0, 0.0

    def __enter__(self) -> CompilationNotice:
        self._listening = around_each_compilation(self.begin, self.end)
        self._listening.__enter__()
        CompilationNotice.active = True
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self._listening.__exit__(kind, error, trace)
        CompilationNotice.active = False
        with self._lock:
            self._done.set()
            if self._functions and self._stream.isatty():
                self._say('')

    def aside(self, text: str) -> None:
        """Write another line to the stream, in place of the one of this notice."""
        with self._lock:
            self._say(f'{text}\n')

    def _one_more(self) -> None:
        self._functions += 1
        if not self._stream.isatty():
            self._say(self._lines.next())
            return
        if self._functions == 1:
            self._first = self._clock()
        self._meanwhile()

    def _meanwhile(self) -> None:
        self._say(f'{BEGIN}: {self._functions} functions, {self._clock() - self._first:.0f} s'
                  if self._stream.isatty() else self._lines.due())

    def _say(self, text: str) -> None:
        clear = '\r\x1b[K' if self._stream.isatty() else ''
        if clear or text:
            self._stream.write(clear + text)
            self._stream.flush()
