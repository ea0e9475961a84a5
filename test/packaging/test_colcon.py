# SPDX-License-Identifier: Apache-2.0
"""The package as ``colcon build`` installs it: where ros2 run, ros2 pkg and ros2 launch look."""

from __future__ import annotations

import os
from pathlib import Path
import re
import shutil
import subprocess
import sys

import pytest

from adaptive_blf_control.executables import EXECUTABLES
from patience import PATIENCE

pytest.importorskip('colcon_ros', reason='colcon is not installed: pip install .[test]')

PACKAGE = 'adaptive_blf_control'
SOURCES = (PACKAGE, 'config', 'launch', 'resource', 'rviz', 'package.xml', 'setup.cfg', 'setup.py')
GENERATED = shutil.ignore_patterns('__pycache__', '*.pyc', '.*')


def _environment(home: Path) -> dict[str, str]:
    # No proxy answers on port 9 (discard): any attempt to reach a registry fails the build.
    return {**os.environ, 'COLCON_HOME': str(home), 'COLCON_LOG_LEVEL': '50', 'PIP_NO_INDEX': '1',
            'http_proxy': 'http://127.0.0.1:9', 'https_proxy': 'http://127.0.0.1:9'}


def _build(repository: Path, workspace: Path, *options: str) -> Path:
    """Copy the sources into ``workspace/src``, build them, return the install prefix."""
    source = workspace / 'src' / PACKAGE
    source.mkdir(parents=True)
    for name in SOURCES:
        origin = repository / name
        if origin.is_dir():
            shutil.copytree(origin, source / name, ignore=GENERATED)
        else:
            shutil.copy2(origin, source / name)
    result = subprocess.run(
        [sys.executable, '-m', 'colcon', 'build', *options], cwd=workspace,
        env=_environment(workspace / 'home'), stdin=subprocess.DEVNULL, capture_output=True,
        text=True, timeout=PATIENCE)
    assert result.returncode == 0, result.stdout + result.stderr
    return workspace / 'install' / PACKAGE


@pytest.fixture(scope='module')
def prefix(repository: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return _build(repository, tmp_path_factory.mktemp('workspace'))


@pytest.fixture(scope='module')
def symlinked(repository: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return _build(repository, tmp_path_factory.mktemp('symlinked'), '--symlink-install')


def _site_packages(prefix: Path) -> Path:
    return next(prefix.glob('lib/python3*/site-packages'))


def _run(prefix: Path, executable: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Start an installed executable as ``ros2 run`` does after sourcing the workspace."""
    path = os.pathsep.join([str(_site_packages(prefix)), os.environ.get('PYTHONPATH', '')])
    return subprocess.run(
        [sys.executable, str(prefix / 'lib' / PACKAGE / executable), *arguments],
        cwd=prefix.parent, env={**os.environ, 'PYTHONPATH': path}, stdin=subprocess.DEVNULL,
        capture_output=True, text=True, timeout=PATIENCE)


def test_every_executable_lies_where_ros2_run_looks(prefix: Path) -> None:
    files = list((prefix / 'lib' / PACKAGE).iterdir())
    assert {file.name for file in files} == set(EXECUTABLES)
    assert all(os.access(file, os.X_OK) for file in files)


def test_symlink_install_has_the_same_executables(symlinked: Path) -> None:
    files = list((symlinked / 'lib' / PACKAGE).iterdir())
    assert {file.name for file in files} == set(EXECUTABLES)


def test_symlink_install_follows_the_sources(symlinked: Path) -> None:
    installed = symlinked / 'share' / PACKAGE / 'package.xml'
    source = symlinked.parents[1] / 'src' / PACKAGE / 'package.xml'
    assert installed.resolve() == source.resolve()


def test_package_is_in_the_ament_index(prefix: Path) -> None:
    marker = prefix / 'share/ament_index/resource_index/packages' / PACKAGE
    assert marker.read_bytes() == b''


@pytest.mark.parametrize('pattern', ['package.xml', 'config/*.*', 'launch/*.launch.py',
                                     'rviz/*.rviz'])
def test_share_holds_the_files_of_the_source_tree(
        repository: Path, prefix: Path, pattern: str) -> None:
    expected = {file.relative_to(repository): file.read_bytes()
                for file in repository.glob(pattern)}
    share = prefix / 'share' / PACKAGE
    installed = {file.relative_to(share): file.read_bytes() for file in share.glob(pattern)}
    assert expected
    assert installed == expected


def test_launch_file_names_are_unique_under_share(prefix: Path) -> None:
    names = [file.name for file in (prefix / 'share' / PACKAGE).rglob('*.launch.py')]
    assert len(names) == len(set(names))


def test_every_file_of_the_python_package_is_installed(repository: Path, prefix: Path) -> None:
    def files(folder: Path) -> set[Path]:
        found = {file.relative_to(folder) for file in folder.rglob('*') if file.is_file()}
        return {file for file in found
                if not any(part == '__pycache__' or part[0] == '.' for part in file.parts)}

    assert files(_site_packages(prefix) / PACKAGE) == files(repository / PACKAGE)


def test_installed_tool_runs_from_outside_the_source_tree(prefix: Path) -> None:
    result = _run(prefix, 'simulate', '--help')
    assert result.returncode == 0, result.stderr
    assert re.match(r'usage: .*\bsimulate ', result.stdout)
