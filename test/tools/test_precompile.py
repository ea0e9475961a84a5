# SPDX-License-Identifier: Apache-2.0
"""Facts about the command ``precompile``: what it compiled, no later process compiles again."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap

import pytest

from adaptive_blf_control.compiled import COMPILED
from adaptive_blf_control.tools.precompile import main

UR5 = 'package://example-robot-data/robots/ur_description/urdf/ur5_robot.urdf'

pytestmark = pytest.mark.skipif(not COMPILED, reason='numba is not installed or switched off')


@pytest.mark.parametrize('config', ['two_link.yaml', 'three_link_encoder.yaml'])
def test_a_run_after_it_compiles_nothing(repository, config):
    path = str(repository / 'config' / config)
    assert main([path]) == 0
    run = subprocess.run([sys.executable, '-m', 'adaptive_blf_control', 'simulate', path,
                          '--duration', '0.01'], capture_output=True, text=True, check=True,
                         env={**os.environ, 'PYTHONPATH': os.pathsep.join(sys.path)})
    assert 'compiling' not in run.stderr


def test_a_file_that_is_not_there_is_named(capsys):
    assert main(['nowhere.yaml']) == 2
    assert 'nowhere.yaml' in capsys.readouterr().err


def test_configure_calls_nothing_after_it_with_other_types(repository, tmp_path):
    """Whatever the cache holds: what is called with types that were not compiled is compiled."""
    pytest.importorskip('pinocchio', reason='Pinocchio reads URDFs')
    script = textwrap.dedent("""
        import gc, sys
        from numba.core.dispatcher import Dispatcher
        from adaptive_blf_control.tools import configure, precompile

        def called():
            return {(each.py_func.__module__, each.py_func.__qualname__, types)
                    for each in gc.get_objects() if isinstance(each, Dispatcher)
                    for types in each.signatures}

        assert precompile.main(sys.argv[1:2]) == 0
        before = called()
        assert configure.main(sys.argv[2:]) == 0
        print(sorted(name for _, name, _ in called() - before))
    """)
    run = subprocess.run(
        [sys.executable, '-c', script, str(repository / 'config/panda.yaml'),
         UR5, '--encoder', '20000', '-o', str(tmp_path / 'arm.yaml')],
        capture_output=True, text=True, check=True,
        env={**os.environ, 'PYTHONPATH': os.pathsep.join(sys.path)})
    assert run.stdout.splitlines()[-1] == '[]'
