# SPDX-License-Identifier: Apache-2.0
"""Every example runs as it stands, is short, and prints what it guarantees."""

from __future__ import annotations

import importlib.util
from pathlib import Path
import re
import subprocess
import sys

import pytest

import adaptive_blf_control as door
from patience import PATIENCE

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES = {
    'identify_a_log.py': r'p1 +3\.473\d\n(.*\n)*not determined by this log: none\n.*: \[0\.',
    'close_the_loop.py': r'sets kept: True\nlearned: .*3\.473',
    'own_arm.py': r'KEPT(.*\n)*.*rank 3 of 3(.*\n)*weight +6\.00\d',
    'own_law.py': r'KEPT(.*\n)*.*rank 5 of 5(.*\n)*.*is not about this law(.*\n)*'
                  r'.*in the last 0\.000\d+ rad',
    'own_sensor.py': r'perfect +sets kept: True.* 5\.30 (.*\n)Late +sets kept: True.*5\.2\d ',
    'own_constraint.py': r'safety, performance and wall sets: KEPT(.*\n)*wall +least margin 0\.03'
                         r'(.*\n)*refused: body .tip.: start reach outside the wall set',
    'own_update_law.py': r'ours +sets kept: True.* at the end\nStraight +sets kept: True.*'
                         r'0\.00\d+ at the end',
    'own_state_filter.py': r'low_pass +sets kept: True.*\n__main__:Mean +sets kept: True',
    'own_plant.py': r'KEPT(.*\n)*.*theta\* of the plant is not known(.*\n)*.*inertia of 2\.\d',
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


@pytest.mark.parametrize('part', [{'controller': {'law': 'own_law:ModelAndSpring'}},
                                  {'arm_driver': {'plant': 'own_plant:Pendulums'}},
                                  {'arm_driver': {'sensors': {'model': 'own_sensor:Late'}}},
                                  {'controller': {'constraints': ['own_constraint:Wall']},
                                   'arm_driver': {'initial_position': [0.0, 1.0]}},
                                  {'identifier': {'update_law': 'own_update_law:Straight'}},
                                  {'identifier': {'filter': {
                                      'state_filter': 'own_state_filter:Mean'}}}])
def test_the_parts_of_the_examples_can_be_named_in_a_parameter(part, monkeypatch, capsys):
    monkeypatch.syspath_prepend(str(ROOT / 'examples'))
    assert door.simulate(door.TwoLinkArm(), 0.1, **part).kept
    assert capsys.readouterr().out == ''  # importing them runs nothing


def _blocks(page: str) -> list[tuple[str, str]]:
    """Return the Python blocks of a page, each with the output that follows it, or ''."""
    text = (ROOT / page).read_text(encoding='utf-8')
    return re.findall(r'```python\n(.*?)```(?:\n\n```text\n(.*?)```)?', text, re.DOTALL)


PAGES = {'README.md': 2, 'docs/python.md': 5}


@pytest.mark.parametrize(('code', 'output'), [
    pytest.param(*block, id=f'{page} {number}')
    for page in PAGES for number, block in enumerate(_blocks(page), 1)])
def test_the_python_of_a_page_runs_and_prints_what_it_says(code, output):
    if 'load_arm' in code or 'panda' in code:
        pytest.importorskip('pinocchio')
    needs_robots = 'example-robot-data' in code or 'panda' in code
    if needs_robots and importlib.util.find_spec('cmeel') is None:
        pytest.skip('example-robot-data is not installed')
    done = subprocess.run([sys.executable, '-c', code], cwd=ROOT, capture_output=True, text=True,
                          timeout=PATIENCE)
    assert done.returncode == 0, done.stderr
    assert done.stdout == output


@pytest.mark.parametrize('page', PAGES)
def test_a_page_has_its_programs(page):
    assert len(_blocks(page)) == PAGES[page]
