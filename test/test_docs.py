# SPDX-License-Identifier: Apache-2.0
"""What the docs claim about the code is there."""

from __future__ import annotations

import ast
from pathlib import Path
import re

import pytest
import yaml

from adaptive_blf_control.executables import EXECUTABLES
from adaptive_blf_control.tools import topics
from adaptive_blf_control.tools.parameters import markdown

ROOT = Path(__file__).resolve().parents[1]
DOCS = sorted(ROOT.glob('docs/*.md'))
PACKAGE = ROOT / 'adaptive_blf_control'
# Words that docs/glossary.md replaces, or that no page of ROS 2 uses, and what to say instead.
RETIRED = {
    'anew': 'again, restarts, a new ...',
    'whoever': 'name who: the publisher, the caller, any program',
    'absurd': 'beyond its limit, not usable',
    'shouts?|shouting': 'another publisher',
    'promises?|promised': 'guarantee',
    'fabricat(?:e|es|ed|ing)': 'artificial noise',
    'LawRun': 'trace',
    'PATIENCE': 'a timeout, with what is waited for',
    'HEARTBEAT': 'republish interval',
}
# Written before the glossary and being changed; to be emptied.
NOT_YET: tuple[str, ...] = ()


def test_parameter_page_equals_the_tables(repository: Path) -> None:
    page = (repository / 'docs/parameters.md').read_text(encoding='utf-8')
    assert page == markdown()


@pytest.mark.parametrize(('name', 'least'), [('paper.md', 40), ('glossary.md', 50)])
def test_every_place_that_a_page_names_exists(repository: Path, name: str, least: int) -> None:
    page = (repository / 'docs' / name).read_text(encoding='utf-8')
    places = re.findall(r'`([a-z_]+(?:\.[a-z_]+)+):([A-Za-z_0-9]+)`', page)
    assert len(places) > least
    for module, member in places:
        assert member in _defined(PACKAGE / f'{module.replace(".", "/")}.py'), f'{module}:{member}'


def _defined(path: Path) -> set[str]:
    """Return the names that a module defines, without importing it: nodes need ROS."""
    names: set[str] = set()
    for node in ast.parse(path.read_text(encoding='utf-8')).body if path.is_file() else []:
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            names.add(node.name)
        elif isinstance(node, (ast.Assign, ast.AnnAssign)):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names.update(target.id for target in targets if isinstance(target, ast.Name))
    return names


def _found(text: str) -> list[str]:
    return [f'{match[0]}: {instead}' for word, instead in RETIRED.items()
            for match in re.finditer(rf'\b(?:{word})\b', text)]


@pytest.mark.parametrize('page', [page for page in DOCS if page.name != 'glossary.md'],
                         ids=lambda path: path.name)
def test_no_page_uses_a_retired_word(page: Path) -> None:
    text = page.read_text(encoding='utf-8')
    assert _found(re.sub(r'`[^`\n]*`', '', text)) == []  # what is quoted has the name it has


def test_no_module_uses_a_retired_word() -> None:
    found = {}
    for path in sorted(PACKAGE.rglob('*.py')):
        name = path.relative_to(PACKAGE).as_posix()
        if not name.startswith(NOT_YET) and (words := _found(path.read_text(encoding='utf-8'))):
            found[name] = words
    assert found == {}


def test_paper_page_has_every_equation(repository: Path) -> None:
    page = (repository / 'docs/paper.md').read_text(encoding='utf-8')
    table = page.split('## Equations')[1].split('## The rest')[0]
    named: set[int] = set()
    for first, last in re.findall(r'\((\d+)\)(?:-\((\d+)\))?', table):
        named.update(range(int(first), int(last or first) + 1))
    assert set(range(1, 63)) <= named, sorted(set(range(1, 63)) - named)


def test_topics_page_and_security_policy_equal_the_declarations(repository: Path) -> None:
    for name, text in (('docs/topics.md', topics.markdown()),
                       ('config/sros2_policy.xml', topics.policy())):
        assert (repository / name).read_text(encoding='utf-8') == text, name


@pytest.mark.parametrize('page', [*DOCS, ROOT / 'README.md'], ids=lambda path: path.name)
def test_links_and_configs_named_in_a_page_exist(page: Path) -> None:
    assert _missing(page, page.read_text(encoding='utf-8')) == []


def _missing(page: Path, text: str) -> list[str]:
    """Return what a page links to or names below config/ that is not there."""
    links = [page.parent / target for target in re.findall(r'\]\(([^)#:]+)[^):]*\)', text)]
    configs = [ROOT / found for found in re.findall(r'config/[a-z_0-9]+\.(?:yaml|xml|json)', text)]
    return [path.name for path in (*links, *configs) if not path.exists()]


def test_a_link_or_config_that_is_not_there_is_found() -> None:
    text = '[a](nothing.md), [b](README.md), [c](gone.md#part), `config/none.yaml`, [d](http://x)'
    assert _missing(ROOT / 'README.md', text) == ['nothing.md', 'gone.md', 'none.yaml']


def test_readme_names_every_executable(repository: Path) -> None:
    text = (repository / 'README.md').read_text(encoding='utf-8')
    for name in EXECUTABLES:
        assert f'`{name}' in text, name


def test_every_message_that_a_page_publishes_by_hand_fits_its_type() -> None:
    pytest.importorskip('rclpy', reason='no ROS 2 here: no messages')
    from adaptive_blf_control.runtime.message_class import message_class
    commands = [found for page in DOCS for found in re.findall(
        r"ros2 topic pub [^'`\n]* (\w+/msg/\w+) '([^']+)'", page.read_text(encoding='utf-8'))]
    assert len(commands) >= 2
    for type_name, text in commands:
        fields = yaml.safe_load(text)  # as the command line reads it: 1e9 would be a string
        message = message_class(type_name)(**fields)
        for name, value in fields.items():
            assert list(getattr(message, name)) == value
            assert name == 'name' or all(isinstance(each, float) for each in value)
