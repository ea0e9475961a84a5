# SPDX-License-Identifier: Apache-2.0
"""``make mutants``: break a law on purpose, one line at a time, and see which tests notice.

The mutants are data: the files of the folder ``mutants``, one for each room. Each entry has

    fact:   what would no longer hold
    file:   source below adaptive_blf_control/
    text:   what stands there, once; a text of several lines is found at any indentation
    mutant: what stands there instead
    tests:  files below test/, or tests of them as ``file::test``, perhaps with ``[parameters]``;
            one of them has to fail

A mutant is killed where one of its tests fails, or does not end. Everything runs in temporary
copies of the repository, one for each worker; the repository itself is not touched. The tests
named there run once unchanged first: what fails anyway kills nothing.

Laws run uncompiled, which is quicker than to compile each mutant; ``compiled: true`` asks for the
machine code that the repository has.

Exit status: 0 if at least 95 % were killed, 1 if not, 2 if the list is wrong.
"""

from __future__ import annotations

import argparse
import ast
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
import multiprocessing
import os
from pathlib import Path
import queue
import re
import shutil
import signal
import sys
import tempfile
import threading
import time
from typing import NamedTuple

import yaml

REPOSITORY = Path(__file__).resolve().parents[2]
FOLDER = Path(__file__).with_name('mutants')
PACKAGE = 'adaptive_blf_control'
ENOUGH = 0.95
LONGEST = 240.0  # s for the tests of a mutant; a law that does not end is noticed, too
LEFT_OUT = ('.git', '.venv', '.hypothesis', '.pytest_cache', '.mypy_cache', '.ruff_cache', 'build',
            'install', 'log')
FAILED, NOTHING_RAN = 1, 5  # of pytest
KEYS = ('fact', 'file', 'text', 'mutant', 'tests')


class WrongList(Exception):
    """The list of mutants does not fit the repository; names the mutant."""


class Mutant(NamedTuple):
    """One change of one file.

    Attributes:
        fact: What would no longer hold.
        file: Path below the package.
        text: What stands there.
        mutant: What stands there instead.
        tests: What has to notice, below ``test/``.
        compiled: Whether the tests run with the machine code of the repository.
    """

    fact: str
    file: str
    text: str
    mutant: str
    tests: tuple[str, ...]
    compiled: bool = False

    def __str__(self) -> str:
        """Name it as the reports do."""
        return f'{self.file}: {self.fact}'

    def applied(self, source: str) -> str:
        """Return the source with the change; WrongList where the text is not there once."""
        found = list(_pattern(self.text).finditer(source))
        if len(found) != 1:
            raise WrongList(f'{self}: its text occurs {len(found)} times: expected once:\n'
                            f'{self.text}')
        indent = found[0]['indent']
        changed = self.mutant.replace('\n', f'\n{indent}')
        result = source[:found[0].start()] + indent + changed + source[found[0].end():]
        try:
            same = _program(result) == _program(source)
        except SyntaxError as error:
            raise WrongList(f'{self}: not Python with its mutant: {error}') from error
        if same:
            raise WrongList(f'{self}: its mutant is the same program')
        return result


@lru_cache(maxsize=8)
def _program(source: str) -> str:
    """Return what two sources have in common that are the same program; SyntaxError for none."""
    return ast.dump(ast.parse(source))


def _pattern(text: str) -> re.Pattern[str]:
    """Return what finds a text; its lines after the first are indented as the first one is."""
    lines = text.split('\n')
    if len(lines) == 1:
        return re.compile(r'(?P<indent>)' + re.escape(text))
    return re.compile(r'(?m)^(?P<indent> *)' + '\n'.join(
        [re.escape(lines[0]),
         *((r'(?P=indent)' if line else '') + re.escape(line) for line in lines[1:])]))


def load(folder: Path = FOLDER) -> list[Mutant]:
    """Return all mutants in the order of their files; WrongList where an entry cannot be used."""
    mutants: list[Mutant] = []
    for path in sorted(folder.glob('*.yaml')):
        for entry in yaml.safe_load(path.read_text(encoding='utf-8')):
            mutants.append(_mutant(path.name, entry))
    names = [str(mutant) for mutant in mutants]
    if twice := {name for name in names if names.count(name) > 1}:
        raise WrongList(f'{min(twice)}: there are two of this name')
    return mutants


def _mutant(where: str, entry: dict[str, object]) -> Mutant:
    wrong = [key for key in KEYS if key not in entry]
    wrong += [key for key in entry if key not in (*KEYS, 'compiled')]
    if wrong:
        raise WrongList(f'{where}: {entry.get("fact", entry)}: expected {", ".join(KEYS)} and '
                        f'perhaps compiled, not {", ".join(wrong)}')
    tests = entry['tests']
    return Mutant(str(entry['fact']), str(entry['file']), str(entry['text']),
                  str(entry['mutant']),
                  tuple([tests] if isinstance(tests, str) else map(str, tests)),
                  bool(entry.get('compiled', False)))


def check(mutants: Iterable[Mutant], repository: Path = REPOSITORY) -> None:
    """Raise WrongList with all mutants that do not fit the sources or the tests."""
    wrong = []
    for mutant in mutants:
        try:
            mutant.applied((repository / PACKAGE / mutant.file).read_text(encoding='utf-8'))
            for test in mutant.tests:
                _check_test(mutant, repository / 'test', test)
        except WrongList as error:
            wrong.append(str(error))
        except OSError as error:
            wrong.append(f'{mutant}: {error}')
    if wrong:
        raise WrongList('\n'.join(wrong))


def _check_test(mutant: Mutant, folder: Path, test: str) -> None:
    name, _, function = test.partition('::')
    text = (folder / name).read_text(encoding='utf-8')
    if function and f'def {function.partition("[")[0]}(' not in text:
        raise WrongList(f'{mutant}: test/{name} has no test {function}')


# Each run of pytest is a copy of one process that has imported what does not change.
_WAITING = multiprocessing.get_context('forkserver')
_WAITING.set_forkserver_preload([
    'pytest', '_pytest.assertion.rewrite', '_pytest.python', 'numpy', 'numba', 'scipy.linalg',
    'yaml', 'hypothesis', 'pinocchio', 'rclpy.node', 'rclpy.lifecycle', 'mcap.writer'])


def _run_pytest(root: str, log: str, arguments: list[str], environment: dict[str, str]) -> None:
    """Run pytest in the present process, in a session of its own, and end it."""
    os.setsid()
    os.chdir(root)
    os.environ.update(environment)
    if 'numba' in sys.modules:
        sys.modules['numba'].config.reload_config()
    sys.path[:] = [root, *(place for place in sys.path if place not in ('', str(REPOSITORY)))]
    with open(log, 'wb') as stream:
        os.dup2(stream.fileno(), 1)
        os.dup2(stream.fileno(), 2)
    import pytest
    status = int(pytest.main(arguments))
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)  # what a broken node has left behind does not hold it up


class Copy:
    """A copy of the repository in which one mutant at a time is tried."""

    def __init__(self, folder: Path, repository: Path = REPOSITORY) -> None:
        """Copy the repository below ``folder``."""
        self.root = folder / 'repository'
        shutil.copytree(repository, self.root, symlinks=True,
                        ignore=shutil.ignore_patterns(*LEFT_OUT))
        self._folder = folder
        # Python recompiles a source whose time is another, in whole seconds, or whose size is.
        self._time = int(time.time())

    def write(self, file: str, source: str) -> None:
        """Write a source of the package so that Python does not take it for the one before."""
        path = self.root / PACKAGE / file
        path.write_text(source, encoding='utf-8')
        self._time += 1
        os.utime(path, (self._time, self._time))

    def run(self, tests: Sequence[str], compiled: bool, *,
            longest: float = LONGEST) -> tuple[int, str]:
        """Return pytest's status and output; FAILED where it did not end in time [s]."""
        log = self._folder / 'output.txt'
        command = ['-q', '-x', '-p', 'no:cacheprovider', '-p', 'no:xdist', '--tb=short',
                   *(f'test/{test}' for test in tests)]
        environment = {'PYTHONPATH': str(self.root), 'TMPDIR': str(self._folder),
                       'ADAPTIVE_BLF_CONTROL_MEANT_TO_FAIL': '1',
                       'NUMBA_DISABLE_JIT': '0' if compiled else '1'}
        process = _WAITING.Process(target=_run_pytest, args=(
            str(self.root), str(log), command, environment))
        process.start()
        process.join(longest)
        if process.exitcode is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.join()
            return FAILED, f'not over within {longest:g} s'
        return process.exitcode, log.read_text(encoding='utf-8', errors='replace')

    def survives(self, mutant: Mutant) -> bool:
        """Try a mutant; WrongList where its tests could not be run at all."""
        path = self.root / PACKAGE / mutant.file
        before = path.read_text(encoding='utf-8')
        self.write(mutant.file, mutant.applied(before))
        try:
            status, output = self.run(mutant.tests, mutant.compiled)
        finally:
            self.write(mutant.file, before)
        if status not in (0, FAILED):
            raise WrongList(f'{mutant}: its tests could not be run:\n{output[-2000:]}')
        return status == 0


class Trial:
    """Tries mutants side by side, each worker in a copy of its own."""

    def __init__(self, folder: Path, jobs: int) -> None:
        """Make the copies below ``folder``."""
        self._copies: queue.Queue[Copy] = queue.Queue()
        for number in range(jobs):
            place = folder / str(number)
            place.mkdir()
            self._copies.put(Copy(place))
        self._pool = ThreadPoolExecutor(jobs)
        self._print = threading.Lock()

    def check_unchanged(self, mutants: Sequence[Mutant]) -> None:
        """Raise WrongList where a test fails without any mutant."""
        wanted = sorted({(mutant.compiled, test) for mutant in mutants for test in mutant.tests})
        files = sorted({(compiled, test.partition('::')[0]) for compiled, test in wanted})
        groups = [(compiled, [test for kind, test in wanted
                              if kind == compiled and test.partition('::')[0] == file])
                  for compiled, file in files]
        failed = [text for text in self._pool.map(lambda each: self._unchanged(*each), groups)
                  if text]
        if failed:
            raise WrongList('fails without a mutant:\n' + '\n'.join(failed))

    def _unchanged(self, compiled: bool, tests: list[str]) -> str:
        copy, begin = self._copies.get(), time.monotonic()
        try:
            # A test is not run twice where its file is named as well.
            tests = [tests[0]] if '::' not in tests[0] else tests
            status, output = copy.run(tests, compiled, longest=10 * LONGEST)
        finally:
            self._copies.put(copy)
        self._say('unchanged', begin, ' '.join(tests))
        return '' if status in (0, NOTHING_RAN) else output[-2000:]

    def survivors(self, mutants: Sequence[Mutant]) -> list[Mutant]:
        """Return the mutants that no test has noticed."""
        return [mutant for mutant, survived in zip(mutants, self._pool.map(self._try, mutants))
                if survived]

    def _try(self, mutant: Mutant) -> bool:
        copy, begin = self._copies.get(), time.monotonic()
        try:
            survived = copy.survives(mutant)
        finally:
            self._copies.put(copy)
        self._say('SURVIVED' if survived else 'killed', begin, str(mutant))
        return survived

    def _say(self, what: str, begin: float, text: str) -> None:
        with self._print:
            print(f'{what:<10}{time.monotonic() - begin:6.1f} s  {text}', flush=True)


def main(args: Sequence[str] | None = None) -> int:
    """Try the mutants and print who survived."""
    parser = argparse.ArgumentParser(prog='make mutants', description=__doc__.partition('\n')[0])
    parser.add_argument('words', nargs='*', metavar='WORD',
                        help='only mutants whose file or fact holds one of these')
    parser.add_argument('--jobs', type=int, default=len(os.sched_getaffinity(0)),
                        help='how many at a time (default: one for each processor)')
    options = parser.parse_args(args)
    try:
        mutants = [mutant for mutant in load()
                   if not options.words or any(word in str(mutant) for word in options.words)]
        check(mutants)
        if not mutants:
            raise WrongList(f'no mutant is named {" or ".join(options.words)}')
        os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')  # no threads before a process forks
        with tempfile.TemporaryDirectory(prefix='mutants_') as folder:
            trial = Trial(Path(folder), options.jobs)
            trial.check_unchanged(mutants)
            survivors = trial.survivors(mutants)
    except WrongList as error:
        print(error, file=sys.stderr)
        return 2
    killed = len(mutants) - len(survivors)
    print(f'{killed} of {len(mutants)} mutants killed, {100.0 * killed / len(mutants):.1f} %')
    for mutant in survivors:
        print(f'survived: {mutant}')
    return int(killed < ENOUGH * len(mutants))


if __name__ == '__main__':
    sys.exit(main())
