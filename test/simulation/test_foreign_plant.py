# SPDX-License-Identifier: Apache-2.0
"""A stranger's plant, named in a parameter, is driven as ours is."""

from __future__ import annotations

from pathlib import Path

import pytest

import adaptive_blf_control as door
from adaptive_blf_control.runs.run_guarantee import guarantee_of_trace
from adaptive_blf_control.tools.simulate import main

HERE = Path(__file__).parent


@pytest.fixture
def named(monkeypatch):
    """Return the changes that put the stranger's plant behind the driver."""
    monkeypatch.syspath_prepend(str(HERE))
    return {'arm_driver.plant': 'foreign_plant:Pendulums'}


def test_the_loop_closes_around_it_and_keeps_its_sets(repository, named):
    run = door.simulate(repository / 'config' / 'two_link.yaml', 3.0, **named)
    assert type(run.loop.plant).__name__ == 'Pendulums'
    assert run.kept
    assert run.rank[-1] >= 4


def test_what_needs_its_parameters_says_that_they_are_not_known(repository, named, capsys):
    run = door.simulate(repository / 'config' / 'two_link.yaml', 0.1, **named)
    assert guarantee_of_trace(run.loop, run) is None
    assert run.figures['guarantee'] is None
    assert main([str(repository / 'config' / 'two_link.yaml'), '--duration', '0.1',
                 '--set', 'arm_driver.plant=foreign_plant:Pendulums']) == 0
    assert 'theta* of the plant is not known' in capsys.readouterr().out


@pytest.mark.parametrize(('plant', 'message'), [
    ('foreign_plant:NoPlant', r'NoPlant has no qd, torque, measure'),
    ('foreign_plant:Nobody', r'AttributeError.*Nobody'),
    ('no_such_module:Plant', r'ModuleNotFoundError'),
    ('own', r'one of builtin, mujoco, module:name')])
def test_a_plant_that_cannot_be_driven_is_refused_with_the_reason(repository, named, plant,
                                                                 message):
    with pytest.raises(door.ParameterError, match=message):
        door.simulate(repository / 'config' / 'two_link.yaml', 0.1, arm_driver={'plant': plant})
