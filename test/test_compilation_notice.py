# SPDX-License-Identifier: Apache-2.0
"""Facts about the line that says that a command compiles."""

from __future__ import annotations

import io
import subprocess
import sys

import pytest

from adaptive_blf_control.compilation_notice import (
    _Announcer,  # private: a process has one, and cannot take it back
    BEGIN,
    CompilationNotice,
    PERIOD,
)
from patience import PATIENCE

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
    with CompilationNotice(stream, clock=lambda: next(times)):
        compile_two()
    assert stream.getvalue() == (
        f'{BEGIN}\ncompiling: 2 functions so far, {1.5 * PERIOD:.0f} s\n')


def test_a_terminal_shows_the_count_and_is_left_clean():
    stream = Terminal()
    with CompilationNotice(stream):
        compile_two()
    *shown, last = stream.getvalue().split('\r\x1b[K')[1:]
    assert shown == [f'{BEGIN}: {n} functions' for n in (1, 2)]
    assert last == ''


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
    announce = _Announcer()
    with CompilationNotice(io.StringIO()):
        announce()
    assert capsys.readouterr().err == ''
    announce()
    assert 'compiling' in capsys.readouterr().err
