# SPDX-License-Identifier: Apache-2.0
"""Facts about the folders of machine code: one for exactly the sources that it comes from."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path
import shutil
import subprocess
import sys

import pytest

from adaptive_blf_control import machine_code

MODULES = ('arms.two_link', 'arms.integrator', 'control.law', 'control.barrier',
           'control.step', 'identification.step', 'identification.torque_filter')
SHOW = ('import sys; from adaptive_blf_control.machine_code import cache_folder\n'
        'for name in sys.argv[1:]: print(cache_folder("adaptive_blf_control." + name))')


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """Return a copy of the package's sources that may be changed."""
    package = tmp_path / 'adaptive_blf_control'
    shutil.copytree(machine_code.PACKAGE, package,
                    ignore=shutil.ignore_patterns('__pycache__', '*.html', '*.js'))
    return package


def folders(package: Path, **environment: str) -> dict[str, Path]:
    """Return the folder of each module for the sources in ``package``."""
    run = subprocess.run([sys.executable, '-c', SHOW, *MODULES], check=True, capture_output=True,
                         text=True, cwd=package.parent,
                         env={**os.environ, 'PYTHONPATH': str(package.parent), **environment})
    return dict(zip(MODULES, map(Path, run.stdout.splitlines()), strict=True))


@pytest.mark.parametrize(('changed', 'affected'), [
    ('control/barrier.py', {'control.law', 'control.barrier', 'control.step'}),
    ('control/law.py', {'control.law', 'control.step'}),
    # Called from these by type.
    ('arms/two_link.py', {'arms.two_link', 'arms.integrator', 'control.step',
                          'identification.step'}),
    ('identification/torque_filter.py', {'identification.step', 'identification.torque_filter'}),
    ('compiled/references.py', set(MODULES)),
    ('report/page.py', set()), ('errors.py', set()), ('parameters/table.py', set()),
    ('control/settings.py', {'control.law', 'control.barrier', 'control.step'}),
    ('linear_algebra.py', {'arms.two_link', 'arms.integrator', 'control.step',
                           'identification.step'}),
])
def test_a_changed_source_renews_what_is_compiled_from_it_and_nothing_else(copy, changed,
                                                                          affected):
    before = folders(copy)
    with (copy / changed).open('a', encoding='utf-8') as file:
        file.write('# another law\n')
    after = folders(copy)
    assert {name for name in MODULES if before[name] != after[name]} == affected
    assert all(folder.is_dir() for folder in after.values())
    assert not any(before[name].exists() for name in affected)  # nothing piles up


def test_a_package_that_cannot_be_written_uses_the_cache_folder_of_the_user(copy, tmp_path):
    pycache = copy / '__pycache__'
    pycache.mkdir(exist_ok=True)
    (pycache / 'machine_code').write_text('no folder can be made here')
    chosen = folders(copy, XDG_CACHE_HOME=str(tmp_path / 'cache'))
    assert all(folder.is_relative_to(tmp_path / 'cache') for folder in chosen.values())


def test_what_a_read_only_installation_compiled_is_used(tmp_path, monkeypatch):
    installed = tmp_path / 'package' / '__pycache__' / 'machine_code'
    user = tmp_path / 'cache' / 'adaptive_blf_control'
    name = 'adaptive_blf_control.control.law'
    there = installed / Path(machine_code.cache_folder(name)).name
    there.mkdir(parents=True)
    (there / 'law.nbi').write_bytes(b'compiled')
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path / 'cache'))
    monkeypatch.setattr(machine_code, 'PACKAGE', tmp_path / 'package')
    monkeypatch.setattr(machine_code, '_digest', lambda _: there.name.rpartition('_')[2])
    monkeypatch.setattr(machine_code.os, 'access',  # root may write everywhere
                        lambda path, _: not Path(path).is_relative_to(installed))
    chosen = Path(machine_code.cache_folder(name))
    assert chosen.is_relative_to(user)
    assert (chosen / 'law.nbi').read_bytes() == b'compiled'


FOREIGN = """
import sys
from typing import NamedTuple
import numpy as np
from adaptive_blf_control.arms.integrator import acceleration, advance
from adaptive_blf_control.compiled import before_each_compilation, jit

class Mine(NamedTuple):
    mass: np.ndarray

@jit
def fall(arm, q, qd, tau):
    return tau / arm.mass

acceleration.register(Mine, fall)
with before_each_compilation(lambda: print('compiled')):
    advance(Mine(np.ones(2)), np.zeros(2), np.zeros(2), np.ones(2), 1e-3, 1)
"""


def test_types_of_a_program_leave_no_machine_code_that_others_cannot_read(tmp_path):
    # numba's index of a function names every type that it was compiled for.
    numba = pytest.importorskip('numba')
    if numba.config.DISABLE_JIT:
        pytest.skip('numba is switched off')
    environment = {**os.environ, 'PYTHONPATH': os.pathsep.join(map(str, [tmp_path, *sys.path]))}
    (tmp_path / 'my_arm.py').write_text(FOREIGN)
    first = subprocess.run([sys.executable, '-c', 'import my_arm'], env=environment, check=True,
                           capture_output=True, text=True)
    assert 'compiled' in first.stdout
    (tmp_path / 'my_arm.py').unlink()
    ours = ('from adaptive_blf_control.arms.two_link import TwoLinkArm\n'
            'arm = TwoLinkArm()\n'
            'arm.dynamics(arm.nominal).advance([0, 0], [0, 0], [1, 1], 1e-3)')
    subprocess.run([sys.executable, '-c', ours], env=environment, check=True)


def test_a_function_is_compiled_by_one_process_at_a_time(tmp_path):
    def free() -> bool:
        with (tmp_path / 'law.lock').open('w') as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                return False
        return True

    with machine_code.alone_with(str(tmp_path), 'law'):
        assert not free()
    assert free()


@pytest.mark.parametrize('folder', ['', '/nowhere/at/all'])
def test_where_nothing_can_be_kept_nobody_waits(folder):
    with machine_code.alone_with(folder, 'law'), machine_code.alone_with(folder, 'law'):
        pass
