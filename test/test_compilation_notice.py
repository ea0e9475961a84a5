# SPDX-License-Identifier: Apache-2.0
"""Facts about the line that says that a command compiles."""

from __future__ import annotations

import io

import pytest

from adaptive_blf_control.compilation_notice import CompilationNotice

numba = pytest.importorskip('numba')


class Terminal(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self) -> bool:
        """Return that it is one."""
        return True


def compile_two() -> None:
    """Compile a function and one that it calls."""
    @numba.njit
    def inner(x: float) -> float:
        return 2.0 * x

    @numba.njit
    def outer(x: float) -> float:
        return inner(x) + 1.0

    outer(1.0)


def test_a_file_gets_one_line_for_all_that_is_compiled():
    stream = io.StringIO()
    with CompilationNotice(stream):
        compile_two()
    assert stream.getvalue() == 'compiling for this machine, once: up to a minute\n'


def test_a_terminal_shows_the_count_and_is_left_clean():
    stream = Terminal()
    with CompilationNotice(stream):
        compile_two()
    *shown, last = stream.getvalue().split('\r\x1b[K')[1:]
    assert shown == [f'compiling for this machine, once: {n} functions' for n in (1, 2)]
    assert last == ''


@pytest.mark.parametrize('stream', [io.StringIO(), Terminal()])
def test_nothing_is_said_where_nothing_is_compiled(stream):
    with CompilationNotice(stream):
        pass
    assert stream.getvalue() == ''
