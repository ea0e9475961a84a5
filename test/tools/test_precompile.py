# SPDX-License-Identifier: Apache-2.0
"""Facts about the command ``precompile``: what it compiled, no later process compiles again."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from adaptive_blf_control.compiled import COMPILED
from adaptive_blf_control.tools.precompile import main

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
