# SPDX-License-Identifier: Apache-2.0
"""Every fault of docs/safety.md has a test, and every test that it names is there."""

from __future__ import annotations

import ast
from pathlib import Path
import re

import pytest

TEST = Path(__file__).resolve().parent
PAGE = TEST.parent / 'docs' / 'safety.md'
PLACE = re.compile(r'`([a-z_/]+\.py)::(test_[a-z_0-9A-Z]+)`')
FAULTS = (
    'joint states late', 'joint states lost', 'joint states reordered', 'joint states duplicated',
    'joint states with NaN', 'joint states with wrong or missing joints', 'commands late or lost',
    'identifier killed and restarted', 'controller killed and restarted', 'recorder killed',
    'disk full', 'clock jumps ahead', 'clock jumps back', 'two controllers on one command topic',
    'e1 at or beyond its bound', 'θ̂ non-finite or beyond its limit',
    'Ctrl-C, SIGTERM, SIGHUP at any moment')


def _rows() -> dict[str, list[str]]:
    text = PAGE.read_text(encoding='utf-8').split('## Faults')[1].split('\n## ')[0]
    cells = [line.strip('|').split(' | ') for line in text.splitlines() if line.startswith('|')]
    return {row[0].strip(): row for row in cells[2:]}


def _tests(file: str) -> set[str]:
    path = TEST / file
    tree = ast.parse(path.read_text(encoding='utf-8')) if path.is_file() else ast.parse('')
    return {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


@pytest.mark.parametrize('fault', FAULTS)
def test_a_fault_has_a_row_with_everything_said(fault: str) -> None:
    row = _rows()[fault]
    assert len(row) == 5
    assert all(len(cell.strip()) > 3 for cell in row)


@pytest.mark.parametrize('fault', list(_rows()))
def test_every_test_that_is_named_for_a_fault_exists(fault: str) -> None:
    places = PLACE.findall(_rows()[fault][-1])
    assert places
    assert _rows()[fault][-1].count('::') == len(places)
    for file, name in places:
        assert name in _tests(file), f'{file}::{name}'
