# SPDX-License-Identifier: Apache-2.0
"""setup.py, package.xml, the changelog and the imports of the code tell the same story."""

from __future__ import annotations

import ast
from email.parser import Parser
from pathlib import Path
import re
import shutil
import subprocess
import sys
from typing import NamedTuple
from xml.etree import ElementTree

import pytest

import adaptive_blf_control
from patience import PATIENCE

PACKAGE = 'adaptive_blf_control'
ROS = ('ros-jazzy-rclpy', 'ros-jazzy-common-interfaces')


class Declared(NamedTuple):
    """Who provides an imported module: a PyPI distribution and a package.xml key, if any."""

    distribution: str
    key: str | None


MODULES = {
    'numpy': Declared('numpy', 'python3-numpy'),
    'yaml': Declared('PyYAML', 'python3-yaml'),
    'mcap': Declared('mcap', 'mcap-ros2-support'),
    'zstandard': Declared('zstandard', 'mcap-ros2-support'),
    'lz4': Declared('lz4', 'mcap-ros2-support'),
    'pinocchio': Declared('pin', 'pinocchio'),
    'coal': Declared('pin', 'pinocchio'),  # its collision library, which it brings
    'numba': Declared('numba', 'python3-numba'),
    'llvmlite': Declared('numba', 'python3-numba'),  # its compiler, which it brings
    'scipy': Declared('scipy', 'python3-scipy'),
    'matplotlib': Declared('matplotlib', 'python3-matplotlib'),
    'plotly': Declared('plotly', None),  # rosdep has no key for it
    'tqdm': Declared('tqdm', 'python3-tqdm'),
    'pyarrow': Declared('pyarrow', None),  # nor for this one
    'distributed': Declared('distributed', None),  # nor for this one
    'mujoco': Declared('mujoco', None),  # nor for this one
    **{name: Declared(ROS[0], name)
       for name in ('rclpy', 'rcl_interfaces', 'rosgraph_msgs', 'builtin_interfaces',
                    'lifecycle_msgs')},
    **{name: Declared(ROS[1], name)
       for name in ('sensor_msgs', 'std_msgs', 'std_srvs', 'diagnostic_msgs', 'trajectory_msgs',
                    'visualization_msgs')},
}
"""Everything that the package may import beyond the standard library, each by its reason."""


class Metadata(NamedTuple):
    """What setup.py tells pip; ``requires`` maps an extra ('' for none) to requirements."""

    name: str
    version: str
    requires: dict[str, list[str]]


@pytest.fixture(scope='module')
def metadata(repository: Path, tmp_path_factory: pytest.TempPathFactory) -> Metadata:
    pytest.importorskip('setuptools')
    folder = tmp_path_factory.mktemp('metadata')
    for name in ('setup.py', 'setup.cfg', 'package.xml'):
        shutil.copy2(repository / name, folder / name)
    shutil.copytree(repository / 'resource', folder / 'resource')
    package = folder / PACKAGE
    package.mkdir()
    for name in ('__init__.py', 'executables.py'):
        shutil.copy2(repository / PACKAGE / name, package / name)
    result = subprocess.run(
        [sys.executable, 'setup.py', '-q', 'egg_info'], cwd=folder, capture_output=True,
        text=True, timeout=PATIENCE)
    assert result.returncode == 0, result.stderr
    egg_info = folder / f'{PACKAGE}.egg-info'
    header = Parser().parsestr((egg_info / 'PKG-INFO').read_text())
    return Metadata(header['Name'], header['Version'],
                    _sections((egg_info / 'requires.txt').read_text()))


def _sections(text: str) -> dict[str, list[str]]:
    sections: dict[str, list[str]] = {'': []}
    extra = ''
    for line in filter(None, text.splitlines()):
        if line.startswith('['):
            extra = line.strip('[]')
            sections[extra] = []
        else:
            sections[extra].append(line)
    return sections


@pytest.fixture(scope='module')
def manifest(repository: Path) -> ElementTree.Element:
    return ElementTree.parse(repository / 'package.xml').getroot()


def _text(manifest: ElementTree.Element, tag: str) -> str:
    text = manifest.findtext(tag)
    assert text is not None
    return text


def _keys(manifest: ElementTree.Element, *tags: str) -> set[str]:
    return {str(node.text) for tag in tags for node in manifest.iter(tag)}


def _distribution(requirement: str) -> str:
    match = re.match(r'[A-Za-z0-9._-]+', requirement)
    assert match is not None, requirement
    return match.group()


def _imports(*files: Path) -> dict[str, set[str]]:
    """Return each foreign top-level module with the names of the files that import it."""
    found: dict[str, set[str]] = {}
    for file in files:
        for node in ast.walk(ast.parse(file.read_text(encoding='utf-8'))):
            names: list[str] = []
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.level == 0:
                names = [str(node.module)]
            for name in names:
                found.setdefault(name.partition('.')[0], set()).add(file.name)
    return {name: importers for name, importers in found.items()
            if name != PACKAGE and name not in sys.stdlib_module_names}


def test_name_and_version_agree_everywhere(
        repository: Path, metadata: Metadata, manifest: ElementTree.Element) -> None:
    assert re.sub(r'[-_.]+', '_', metadata.name) == _text(manifest, 'name') == PACKAGE
    assert metadata.version == _text(manifest, 'version') == adaptive_blf_control.__version__
    newest = re.search(r'^(\d+\.\d+\.\d+) ', (repository / 'CHANGELOG.rst').read_text(), re.M)
    assert newest is not None
    assert newest.group(1) == metadata.version


def test_manifest_is_an_ament_python_package_of_format_3(manifest: ElementTree.Element) -> None:
    assert manifest.get('format') == '3'
    assert manifest.findtext('export/build_type') == 'ament_python'
    assert manifest.findtext('license') == 'Apache-2.0'


def test_every_import_of_the_package_is_declared_in_both_files(
        repository: Path, metadata: Metadata, manifest: ElementTree.Element) -> None:
    runtime = {_distribution(requirement) for extra, requirements in metadata.requires.items()
               if extra not in ('test', 'lint') for requirement in requirements}
    keys = _keys(manifest, 'depend', 'exec_depend')
    for module, files in _imports(*(repository / PACKAGE).rglob('*.py')).items():
        assert module in MODULES, f'{module}, imported by {sorted(files)}, is declared nowhere'
        assert MODULES[module].distribution in runtime
        assert MODULES[module].key is None or MODULES[module].key in keys


def test_every_import_of_the_launch_files_is_declared(
        repository: Path, manifest: ElementTree.Element) -> None:
    imported = set(_imports(*(repository / 'launch').glob('*.py')))
    assert imported
    assert imported <= _keys(manifest, 'depend', 'exec_depend')


def test_setup_runs_where_nothing_but_setuptools_is_installed(repository: Path) -> None:
    files = (repository / 'setup.py', repository / PACKAGE / 'executables.py')
    assert set(_imports(*files)) == {'setuptools'}


def test_what_setup_requires_is_in_the_manifest(
        metadata: Metadata, manifest: ElementTree.Element) -> None:
    # What rosdep does not know is optional, and stands in the manifest as a comment.
    keys: set[str | None] = {None, *_keys(manifest, 'depend', 'exec_depend')}
    by_distribution: dict[str, set[str | None]] = {}
    for declared in MODULES.values():
        by_distribution.setdefault(declared.distribution, set()).add(declared.key)
    for extra, requirements in metadata.requires.items():
        if extra not in ('test', 'lint'):
            for requirement in requirements:
                assert by_distribution[_distribution(requirement)] & keys, requirement


def test_colcon_test_would_run_pytest(metadata: Metadata) -> None:
    assert 'pytest' in map(_distribution, metadata.requires['test'])


def test_nodes_with_a_closed_form_arm_need_few_packages(metadata: Metadata) -> None:
    assert set(map(_distribution, metadata.requires[''])) == {
        'numpy', 'mcap', 'zstandard', 'lz4', 'PyYAML'}
