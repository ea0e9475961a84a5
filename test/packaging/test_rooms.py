# SPDX-License-Identifier: Apache-2.0
"""The order of the rooms: nothing imports upward, and ROS is known to nodes only."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = 'adaptive_blf_control'
# From the foundations up. A room may import itself and what stands before it, nothing else.
ORDER = ('synonyms', 'errors', 'calls', 'spelling', 'bounded_yaml', 'arrays', 'time_units',
         'machine_code',
         'compiled', 'compilation_notice', 'linear_algebra',
         'executables', 'command_line', 'parameters', 'arms', 'control', 'identification',
         'limits', 'simulation', 'messages', 'configuration', 'tuning', 'experiment', 'bags',
         'runs', 'runtime', 'nodes', 'report', 'campaigns', 'bench', 'tools', '__main__',
         '__init__')
WITH_ROS = ('runtime', 'nodes', 'bench/nodes')


def _imports(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module or ''


def _is_ros(name: str) -> bool:
    top = name.partition('.')[0]
    return top in ('rclpy', 'rosidl_runtime_py') or top.endswith(('_msgs', '_srvs', '_interfaces'))


def _room(path: Path) -> str:
    return path.parts[0].removesuffix('.py')


@pytest.fixture(scope='module')
def modules(repository: Path) -> dict[Path, set[str]]:
    """Return what each module of the package imports, by its path below the package."""
    package = repository / PACKAGE
    return {path.relative_to(package): set(_imports(path)) for path in package.rglob('*.py')}


def test_only_nodes_and_their_runtime_import_ros(modules: dict[Path, set[str]]) -> None:
    assert any(_is_ros(name) for names in modules.values() for name in names)
    assert {str(path): sorted(filter(_is_ros, names)) for path, names in modules.items()
            if not any(map(path.is_relative_to, WITH_ROS)) and any(map(_is_ros, names))} == {}


def test_every_room_has_its_place_in_the_order(modules: dict[Path, set[str]]) -> None:
    assert {_room(path) for path in modules} == set(ORDER)


def test_no_room_imports_one_above_it(modules: dict[Path, set[str]]) -> None:
    upward = []
    for path, names in modules.items():
        place = ORDER.index(_room(path))
        for name in names:
            package, _, rest = name.partition('.')
            if package == PACKAGE and rest and ORDER.index(rest.split('.')[0]) > place:
                upward.append(f'{path} imports {rest}')
    assert upward == []


def test_no_two_modules_import_each_other(modules: dict[Path, set[str]]) -> None:
    """No circle, not even one that only a type checker follows."""
    def name_of(path: Path) -> str:
        return '.'.join((PACKAGE, *path.with_suffix('').parts)).removesuffix('.__init__')

    edges = {name_of(path): names for path, names in modules.items()}
    done: set[str] = set()

    def visit(name: str, trail: tuple[str, ...]) -> None:
        assert name not in trail, ' -> '.join((*trail[trail.index(name):], name))
        if name in done or name not in edges:
            return
        for imported in edges[name]:
            if imported != PACKAGE:  # the face of the package, imported for its version
                visit(imported, (*trail, name))
        done.add(name)

    for name in edges:
        visit(name, ())
