# SPDX-License-Identifier: Apache-2.0
"""The law runs without ROS: only ``nodes/`` knows it, and what computes knows no tool."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = 'adaptive_blf_control'
CORE = ('arms', 'control', 'identification', 'bags', 'simulation', 'parameters')


def _imports(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module or ''


def _is_ros(name: str) -> bool:
    top = name.partition('.')[0]
    return top in ('rclpy', 'rosidl_runtime_py') or top.endswith(('_msgs', '_srvs', '_interfaces'))


@pytest.fixture(scope='module')
def modules(repository: Path) -> dict[Path, set[str]]:
    """Return what each module of the package imports, by its path below the package."""
    package = repository / PACKAGE
    return {path.relative_to(package): set(_imports(path)) for path in package.rglob('*.py')}


def test_only_the_nodes_import_ros(modules: dict[Path, set[str]]) -> None:
    assert any(_is_ros(name) for names in modules.values() for name in names)
    assert {str(path): sorted(filter(_is_ros, names)) for path, names in modules.items()
            if path.parts[0] != 'nodes' and any(map(_is_ros, names))} == {}


def test_what_computes_imports_neither_nodes_nor_tools_nor_reports(
        modules: dict[Path, set[str]]) -> None:
    outer = tuple(f'{PACKAGE}.{room}' for room in ('nodes', 'tools', 'report'))
    assert {path.parts[0] for path in modules} >= set(CORE)
    assert {str(path): sorted(name for name in names if name.startswith(outer))
            for path, names in modules.items() if path.parts[0] in CORE
            and any(name.startswith(outer) for name in names)} == {}
