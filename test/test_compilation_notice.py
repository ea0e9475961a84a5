# SPDX-License-Identifier: Apache-2.0
"""Facts about the line that says that a command compiles."""

from __future__ import annotations

from contextlib import nullcontext
import io
import itertools
import subprocess
import sys

import pytest

from adaptive_blf_control.compilation_notice import (
    _Announcer,  # private: a process has one, and cannot take it back
    BEGIN,
    CompilationNotice,
    LONG,
    PERIOD,
    QUIET,
)
from patience import PATIENCE, wait_until

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


def test_a_file_gets_one_line_for_all_that_is_compiled_at_once():
    stream = io.StringIO()
    with CompilationNotice(stream, clock=lambda: 5.0):
        compile_two()
    assert stream.getvalue() == f'{BEGIN}\n'


def test_a_file_is_told_again_what_takes_long():
    stream, times = io.StringIO(), iter([5.0, 5.0 + 1.5 * PERIOD])
    with CompilationNotice(stream, clock=lambda: next(times), look=PATIENCE):
        compile_two()
    assert stream.getvalue() == (
        f'{BEGIN}\ncompiling: 2 functions so far, {1.5 * PERIOD:.0f} s\n')


def test_a_terminal_shows_the_count_and_is_left_clean():
    stream = Terminal()
    with CompilationNotice(stream, clock_at(5.0, 5.0, 12.0), look=PATIENCE):
        compile_two()
    *shown, last = stream.getvalue().split('\r\x1b[K')[1:]
    assert shown == [f'{BEGIN}: 1 functions, 0 s', f'{BEGIN}: 2 functions, 7 s']
    assert last == ''


@pytest.mark.parametrize(('make', 'words'), [
    (Terminal, f'{BEGIN}: 1 functions, {3 * PERIOD:.0f} s'),
    (io.StringIO, f'compiling: 1 functions so far, {3 * PERIOD:.0f} s\n')])
def test_a_command_tells_meanwhile_of_one_function_that_takes_long(make, words):
    times = itertools.count(0.0, PERIOD)
    stream = make()
    notice = CompilationNotice(stream, lambda: next(times), look=1e-3)
    notice.begin()
    wait_until(lambda: words in stream.getvalue(), words)
    notice.end()


@pytest.mark.parametrize('stream', [io.StringIO(), Terminal()])
def test_nothing_is_said_where_nothing_is_compiled(stream):
    with CompilationNotice(stream):
        pass
    assert stream.getvalue() == ''


PROGRAM = """
import numba
import adaptive_blf_control as blf

@numba.njit
def own(x):
    return x

own(1.0)
print('a program of its own', flush=True)
from adaptive_blf_control.compiled import jit
blf.TwoLinkArm
double = {function}
for number in (1.0, 1, 1j):
    double(number)
"""


@pytest.mark.parametrize(('module', 'said'), [
    ('adaptive_blf_control.other', f'{BEGIN}\n'),
    ('elsewhere', '')])
def test_a_program_is_told_once_that_the_package_compiles(module, said, tmp_path):
    function = f"numba.njit(type(own.py_func)(own.py_func.__code__, {{'__name__': {module!r}}}))"
    path = tmp_path / 'program.py'
    path.write_text(PROGRAM.format(function=function), encoding='utf-8')
    done = subprocess.run([sys.executable, str(path)], capture_output=True, text=True,
                          timeout=PATIENCE)
    assert done.returncode == 0, done.stderr
    assert done.stderr == said


def test_a_command_with_a_notice_of_its_own_says_nothing_twice(capsys):
    for inside in (True, False):
        announcer = _Announcer(clock=lambda: 5.0)
        with CompilationNotice(io.StringIO()) if inside else nullcontext():
            announcer.begin()
            announcer.end()
        assert ('compiling' in capsys.readouterr().err) is not inside


def clock_at(*times):
    """Return a clock that is read at these times."""
    left = iter(times)
    return lambda: next(left)


def test_a_second_compilation_is_told_from_its_own_begin(capsys):
    first, later = 5.0, 500.0
    announcer = _Announcer(clock_at(first, first + 1.0, later, later + 1.0, later + LONG + 1.0,
                                    later + LONG + 2.0), look=PATIENCE)
    announcer.begin()
    announcer.end()
    assert capsys.readouterr().err == f'{BEGIN}\n'
    announcer.begin()
    announcer.begin()
    assert capsys.readouterr().err == ''  # it may be over in a moment
    announcer.begin()
    assert capsys.readouterr().err == (
        f'compiling more: 3 functions so far, {LONG + 1.0:.0f} s\n')
    for _ in range(3):
        announcer.end()


def test_compilations_in_a_row_are_told_as_one(capsys):
    announcer = _Announcer(clock_at(5.0, 6.0, 6.0 + 0.5 * QUIET, 8.0), look=PATIENCE)
    for _ in range(2):
        announcer.begin()
        announcer.end()
    assert capsys.readouterr().err == f'{BEGIN}\n'


def test_one_function_that_takes_long_is_told_meanwhile(capsys):
    times = itertools.count(0.0, PERIOD)
    announcer = _Announcer(lambda: next(times), look=1e-3)
    announcer.begin()
    parts: list[str] = []

    def told_twice() -> bool:
        parts.append(capsys.readouterr().err)
        return ''.join(parts).count('\n') >= 3

    wait_until(told_twice, 'two lines while one function is compiled')
    announcer.end()
    said = ''.join(parts)
    assert said.startswith(f'{BEGIN}\ncompiling: 1 functions so far, 20 s\n')
    assert said.splitlines()[2] == 'compiling: 1 functions so far, 40 s'
