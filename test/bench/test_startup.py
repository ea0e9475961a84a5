# SPDX-License-Identifier: Apache-2.0
"""Facts about the measurement of start-ups."""

from __future__ import annotations

from pathlib import Path
import subprocess
import sys

import pytest

from adaptive_blf_control.bench import startup
from adaptive_blf_control.errors import BlfError


def test_the_processor_time_is_that_of_the_program(repository):
    config = repository / 'config' / 'two_link.yaml'
    assert startup.simulated(config) > 0.1  # it imports numpy at least


def test_a_program_that_fails_is_reported_with_its_words(tmp_path):
    with pytest.raises(BlfError, match='nowhere.yaml'):
        startup.simulated(tmp_path / 'nowhere.yaml')


def test_medians_are_shown_with_least_and_most():
    assert startup.table({'simulate': [3.0, 1.0, 2.0]}).splitlines()[-1] == (
        '| simulate | 2.00 | 1.00 | 3.00 |')


def test_a_cold_start_runs_a_copy_of_the_package_without_machine_code():
    before = Path.cwd()
    where = 'import adaptive_blf_control as a; print(a.__file__)'
    with startup.nothing_compiled():
        found = subprocess.run([sys.executable, '-c', where], capture_output=True, text=True,
                               check=True).stdout
        package = Path(found.strip()).parent
        assert package.parent == Path.cwd()
        assert not list(package.rglob('*.nb[ic]'))
    assert Path.cwd() == before
    assert not package.exists()
