# SPDX-License-Identifier: Apache-2.0
"""The table of executables, ``python -m adaptive_blf_control`` and the launch file agree."""

from __future__ import annotations

import ast
from importlib import import_module
import inspect
from pathlib import Path
import re
import subprocess
import sys

import pytest

import adaptive_blf_control
from adaptive_blf_control.executables import (
    BENCHES,
    COMPOSED,
    console_scripts,
    entry_of,
    EXECUTABLES,
    NODES,
    TOOLS,
)
from patience import PATIENCE


def _python_m(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, '-m', 'adaptive_blf_control', *arguments],
                          stdin=subprocess.DEVNULL, capture_output=True, text=True,
                          timeout=PATIENCE)


def _calls(file: Path, name: str) -> list[dict[str, ast.expr]]:
    """Return the keyword arguments of each call of ``name`` in a Python file."""
    return [{keyword.arg: keyword.value for keyword in node.keywords if keyword.arg}
            for node in ast.walk(ast.parse(file.read_text(encoding='utf-8')))
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
            and node.func.id == name]


@pytest.mark.parametrize('executable', [*TOOLS, *BENCHES])
def test_every_command_has_a_module_with_main_of_optional_arguments(
        repository: Path, executable: str) -> None:
    module, function = entry_of(executable)
    assert function == 'main'
    tree = ast.parse((repository / f'{module.replace(".", "/")}.py').read_text(encoding='utf-8'))
    mains = [node for node in tree.body
             if isinstance(node, ast.FunctionDef) and node.name == 'main']
    assert len(mains) == 1
    assert [argument.arg for argument in mains[0].args.args] == ['args']
    assert ast.unparse(mains[0].args.defaults[0]) == 'None'
    assert mains[0].returns is not None
    assert ast.unparse(mains[0].returns) == 'int'


@pytest.mark.parametrize('executable', [*NODES, *COMPOSED])
def test_every_node_has_a_function_of_optional_arguments(executable: str) -> None:
    pytest.importorskip('rclpy', reason='no ROS 2 here')
    module, function = entry_of(executable)
    assert function == executable
    start = getattr(import_module(module), function)
    assert [p.default for p in inspect.signature(start).parameters.values()] == [None]


def test_console_scripts_name_the_same_functions() -> None:
    assert console_scripts() == [f'{name} = {":".join(entry_of(name))}' for name in EXECUTABLES]
    assert len(set(console_scripts())) == len(EXECUTABLES) > 10


def test_an_unknown_executable_has_no_entry() -> None:
    with pytest.raises(KeyError, match='juggler'):
        entry_of('juggler')


def test_help_lists_every_executable() -> None:
    result = _python_m('--help')
    assert result.returncode == 0
    for name, summary in EXECUTABLES.items():
        assert f'  {name:<12}{summary}' in result.stdout


def test_without_arguments_the_usage_goes_to_stderr_with_status_2() -> None:
    result = _python_m()
    assert (result.returncode, result.stdout) == (2, '')
    assert result.stderr.startswith('usage: python -m adaptive_blf_control EXECUTABLE')


def test_unknown_executable_is_named_with_those_that_exist() -> None:
    result = _python_m('juggler')
    assert (result.returncode, result.stdout) == (2, '')
    assert "'juggler'" in result.stderr
    assert all(name in result.stderr for name in EXECUTABLES)


def test_version_is_the_version_of_the_package() -> None:
    assert _python_m('--version').stdout == adaptive_blf_control.__version__ + '\n'


def test_a_tool_gets_its_arguments_and_shows_its_own_usage() -> None:
    result = _python_m('simulate', '--help')
    assert result.returncode == 0, result.stderr
    assert re.match(r'usage: .*\bsimulate ', result.stdout)


def test_listing_the_executables_imports_neither_numpy_nor_ros() -> None:
    script = ('import sys, adaptive_blf_control.__main__ as m; m.usage(); '
              'sys.exit("numpy" in sys.modules or "rclpy" in sys.modules)')
    assert subprocess.run([sys.executable, '-c', script], timeout=PATIENCE).returncode == 0


def test_launch_file_starts_every_node_once_under_its_own_name(repository: Path) -> None:
    nodes = [node for node in _calls(repository / 'launch' / 'arm.launch.py', 'Node')
             if ast.unparse(node['package']) == 'PACKAGE']
    names = [ast.literal_eval(node['executable']) for node in nodes]
    assert sorted(names) == sorted([*NODES, *COMPOSED])
    # A process of several nodes has no name: it would become that of each of them.
    assert {ast.literal_eval(node['executable']): ast.literal_eval(node['name'])
            for node in nodes if 'name' in node} == {name: name for name in NODES}
    assert {ast.unparse(node['namespace']) for node in nodes} == {'namespace'}


def test_launch_file_passes_a_scenario_that_exists(repository: Path) -> None:
    file = repository / 'launch' / 'arm.launch.py'
    strings = {node.value for node in ast.walk(ast.parse(file.read_text(encoding='utf-8')))
               if isinstance(node, ast.Constant) and isinstance(node.value, str)}
    scenarios = {string for string in strings if string.endswith('.yaml')}
    assert scenarios == {'two_link.yaml'}
    assert all((repository / 'config' / name).is_file() for name in scenarios)


def test_launch_description_loads_where_ros_launch_is_installed(repository: Path) -> None:
    pytest.importorskip('launch_ros', reason="ROS's launch is not on PyPI")
    launch = pytest.importorskip('launch')
    sources = pytest.importorskip('launch.launch_description_sources')
    file = repository / 'launch' / 'arm.launch.py'
    description = sources.get_launch_description_from_python_launch_file(str(file))
    assert isinstance(description, launch.LaunchDescription)
    arguments = {argument.name for argument in description.get_launch_arguments()}
    assert arguments == {'params_file', 'plant', 'bag', 'namespace', 'use_sim_time',
                         'autostart', 'composed', 'rviz'}
