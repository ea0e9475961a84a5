# SPDX-License-Identifier: Apache-2.0
"""What the docs claim about the code is there."""

from __future__ import annotations

import importlib
from pathlib import Path
import re

import pytest

from adaptive_blf_control.executables import EXECUTABLES
from adaptive_blf_control.messages.topics import TOPICS
from adaptive_blf_control.tools.parameters import markdown

DOCS = sorted(Path(__file__).resolve().parents[1].glob('docs/*.md'))
ROOT = Path(__file__).resolve().parents[1]


def test_parameter_page_equals_the_tables(repository: Path) -> None:
    page = (repository / 'docs/parameters.md').read_text(encoding='utf-8')
    assert page == markdown()


@pytest.mark.parametrize(('name', 'least'), [('paper.md', 40), ('glossary.md', 50)])
def test_every_place_that_a_page_names_exists(repository: Path, name: str, least: int) -> None:
    page = (repository / 'docs' / name).read_text(encoding='utf-8')
    places = re.findall(r'`([a-z_]+(?:\.[a-z_]+)+):([A-Za-z_0-9]+)`', page)
    assert len(places) > least
    for module, member in places:
        assert hasattr(importlib.import_module(f'adaptive_blf_control.{module}'), member), \
            f'{module}:{member}'


def test_paper_page_has_every_equation(repository: Path) -> None:
    page = (repository / 'docs/paper.md').read_text(encoding='utf-8')
    table = page.split('## Equations')[1].split('## The rest')[0]
    named: set[int] = set()
    for first, last in re.findall(r'\((\d+)\)(?:-\((\d+)\))?', table):
        named.update(range(int(first), int(last or first) + 1))
    assert set(range(1, 63)) <= named, sorted(set(range(1, 63)) - named)


def test_interfaces_page_names_every_topic(repository: Path) -> None:
    page = (repository / 'docs/interfaces.md').read_text(encoding='utf-8')
    for topic in TOPICS:
        assert f'`{topic}`' in page, topic


@pytest.mark.parametrize('page', [*DOCS, ROOT / 'README.md'], ids=lambda path: path.name)
def test_links_and_configs_named_in_a_page_exist(page: Path) -> None:
    text = page.read_text(encoding='utf-8')
    for target in re.findall(r'\]\(([^)#:]+)\)', text):
        assert (page.parent / target).exists(), f'{page.name}: {target}'
    for config in re.findall(r'config/([a-z_0-9]+\.(?:yaml|xml|json))', text):
        assert (ROOT / 'config' / config).exists(), f'{page.name}: config/{config}'


def test_readme_names_every_executable(repository: Path) -> None:
    text = (repository / 'README.md').read_text(encoding='utf-8')
    for name in EXECUTABLES:
        assert f'`{name}' in text, name
