# SPDX-License-Identifier: Apache-2.0
"""Every example runs as it stands, is short, and prints what it guarantees."""

from __future__ import annotations

import importlib.util
from pathlib import Path
import re
import subprocess
import sys

import pytest

from patience import PATIENCE

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES = {
    'identify_a_log.py': r'p1 +3\.473\d\n(.*\n)*not determined by this log: none',
    'close_the_loop.py': r'sets kept: True\nlearned: .*3\.473',
    'own_arm.py': r'rank 3 of 3(.*\n)*weight +6\.00\d',
    'own_law.py': r'in the last 0\.000\d rad\n.*rank 5 of 5',
    'own_plant.py': r'KEPT(.*\n)*.*theta\* of the plant is not known',
}


def test_every_example_is_listed_here():
    assert {path.name for path in (ROOT / 'examples').glob('*.py')} == set(EXAMPLES)


@pytest.mark.parametrize('name', EXAMPLES)
def test_an_example_runs_and_prints_its_result(name, tmp_path):
    path = ROOT / 'examples' / name
    assert len(path.read_text(encoding='utf-8').splitlines()) < 50
    done = subprocess.run([sys.executable, str(path)], cwd=tmp_path, capture_output=True,
                          text=True, timeout=PATIENCE)
    assert done.returncode == 0, done.stderr
    assert re.search(EXAMPLES[name], done.stdout), done.stdout


def _blocks() -> list[tuple[str, str]]:
    """Return the Python blocks of the README, each with the output that follows it, or ''."""
    text = (ROOT / 'README.md').read_text(encoding='utf-8')
    return re.findall(r'```python\n(.*?)```(?:\n\n```text\n(.*?)```)?', text, re.DOTALL)


@pytest.mark.parametrize(('code', 'output'), _blocks())
def test_the_python_of_the_readme_runs_and_prints_what_it_says(code, output, tmp_path):
    pytest.importorskip('pinocchio')
    if 'example-robot-data' in code and importlib.util.find_spec('cmeel') is None:
        pytest.skip('example-robot-data is not installed')
    done = subprocess.run([sys.executable, '-c', code], cwd=ROOT, capture_output=True, text=True,
                          timeout=PATIENCE)
    assert done.returncode == 0, done.stderr
    assert done.stdout == output


def test_the_readme_has_its_two_programs():
    assert len(_blocks()) == 2
