# SPDX-License-Identifier: Apache-2.0
"""Facts about the mutation run: what a list may hold, what is found, what kills."""

from __future__ import annotations

from collections.abc import Iterator
import importlib
from pathlib import Path
from types import ModuleType

import pytest

HERE = Path(__file__).parent
LAW = 'def limited(x):\n    if x > 2:\n        x = 2\n    return x\n'
TEST = ('from adaptive_blf_control.law import limited\n\n\n'
        'def test_small():\n    assert limited(1) == 1\n\n\n'
        'def test_large():\n    assert limited(3) == 2\n')


@pytest.fixture(scope='module')
def run_mutants() -> Iterator[ModuleType]:
    """Return the program as a module that the processes which it starts find, too."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(HERE)
        yield importlib.import_module('run_mutants')


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    """Return a repository of one law with two tests."""
    root = tmp_path / 'one'
    for path, text in (('adaptive_blf_control/law.py', LAW),
                       ('adaptive_blf_control/__init__.py', ''), ('test/test_law.py', TEST),
                       ('.venv/lib.py', '')):
        (root / path).parent.mkdir(parents=True, exist_ok=True)
        (root / path).write_text(text, encoding='utf-8')
    return root


@pytest.fixture
def mutant(run_mutants):
    """Return ``mutant(**changes)`` of the law's limit."""
    return lambda **changes: run_mutants.Mutant(**{
        'fact': 'two is the most', 'file': 'law.py', 'text': 'if x > 2:', 'mutant': 'if x > 9:',
        'tests': ('test_law.py',), **changes})


def test_every_mutant_of_ours_fits_the_sources_and_its_tests(run_mutants) -> None:
    mutants = run_mutants.load()
    run_mutants.check(mutants)
    assert len(mutants) >= 60
    rooms = {mutant.file.partition('/')[0] for mutant in mutants}
    assert rooms >= {'arms', 'bags', 'configuration', 'control', 'identification', 'limits',
                     'messages', 'nodes', 'runs', 'runtime', 'simulation'}


@pytest.mark.parametrize(('changes', 'words'), [
    ({'text': 'if x > 7:'}, 'occurs 0 times'),
    ({'text': 'x'}, 'occurs 4 times'),
    ({'mutant': 'if x >'}, 'not Python'),
    ({'mutant': 'if x  >  2:'}, 'the same program'),
    ({'tests': ('test_law.py::test_huge',)}, 'has no test test_huge'),
    ({'file': 'laws.py'}, 'laws.py'),
    ({'tests': ('test_laws.py',)}, 'test_laws.py'),
])
def test_a_mutant_that_no_longer_fits_is_an_error_that_names_it(run_mutants, repository, mutant,
                                                                changes, words) -> None:
    with pytest.raises(run_mutants.WrongList, match=words) as error:
        run_mutants.check([mutant(), mutant(fact='another', **changes)], repository)
    assert 'another' in str(error.value)
    assert 'two is the most' not in str(error.value)


@pytest.mark.parametrize(('entry', 'words'), [
    ('- {fact: a, file: b, text: c, mutant: d}', 'not tests'),
    ('- {fact: a, file: b, text: c, mutant: d, tests: e, test: f}', 'not test'),
    ('- {fact: a, file: b, text: c, mutant: d, tests: e}\n' * 2, 'two of this name'),
])
def test_an_entry_that_cannot_be_used_is_named(run_mutants, tmp_path, entry, words) -> None:
    (tmp_path / 'room.yaml').write_text(entry, encoding='utf-8')
    with pytest.raises(run_mutants.WrongList, match=words):
        run_mutants.load(tmp_path)


def test_several_lines_are_found_at_any_indentation_and_keep_it(run_mutants, mutant) -> None:
    changed = mutant(text='if x > 2:\n    x = 2', mutant='if x > 2:\n    x = 1\n    x = 0')
    assert changed.applied(LAW) == LAW.replace('        x = 2\n', '        x = 1\n        x = 0\n')


@pytest.mark.parametrize(('tests', 'survives'), [
    (('test_law.py',), False), (('test_law.py::test_large',), False),
    (('test_law.py::test_small',), True)])
def test_a_mutant_lives_where_none_of_its_tests_fails_and_leaves_no_trace(
        run_mutants, repository, mutant, tmp_path, tests, survives) -> None:
    copy = run_mutants.Copy(tmp_path / 'two', repository)
    assert not (copy.root / '.venv').exists()
    assert copy.survives(mutant(tests=tests)) is survives
    assert (copy.root / 'adaptive_blf_control/law.py').read_text(encoding='utf-8') == LAW
    assert copy.run(['test_law.py'], compiled=True)[0] == 0  # not the machine's old bytecode
    assert (repository / 'adaptive_blf_control/law.py').read_text(encoding='utf-8') == LAW


def test_a_law_that_does_not_end_is_noticed(run_mutants, repository, mutant, tmp_path) -> None:
    copy = run_mutants.Copy(tmp_path / 'two', repository)
    copy.write('law.py', LAW.replace('x = 2', 'while True:\n            pass'))
    status, output = copy.run(['test_law.py'], compiled=True, longest=5.0)
    assert status == run_mutants.FAILED
    assert 'not over within' in output


def test_tests_that_cannot_be_run_kill_nothing(run_mutants, repository, mutant, tmp_path) -> None:
    copy = run_mutants.Copy(tmp_path / 'two', repository)
    (copy.root / 'test/test_law.py').write_text('import nothing_of_this_name\n', encoding='utf-8')
    with pytest.raises(run_mutants.WrongList, match='could not be run'):
        copy.survives(mutant())
