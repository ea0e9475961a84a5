# SPDX-License-Identifier: Apache-2.0
"""Facts about runs against Theorem 2, and about the paper's 3-DoF scenarios."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

from adaptive_blf_control.configuration.build_closed_loop import build_closed_loop
from adaptive_blf_control.configuration.parameter_file import apply_settings, load_yaml
from adaptive_blf_control.runs.run_guarantee import guarantee_of_trace
from adaptive_blf_control.runs.summary import run_of_trace, summarise
from adaptive_blf_control.tools.simulate import main


@pytest.fixture
def run(repository):
    def go(scenario: str, duration: float, *settings: str):
        loop = build_closed_loop(apply_settings(
            load_yaml(repository / 'config' / f'{scenario}.yaml'), list(settings)))
        return loop, loop.run(duration)

    return go


@pytest.mark.parametrize('scenario', ['two_link', 'two_link_paper', 'three_link_paper'])
def test_a_run_keeps_the_guarantee_of_the_theorem(run, scenario):
    loop, trace = run(scenario, 3.0)
    guarantee = guarantee_of_trace(loop, trace)
    assert guarantee.first is None
    assert np.all(trace.e1 >= guarantee.guaranteed[0].error_lower)
    assert np.all(trace.e1 <= guarantee.guaranteed[0].error_upper)
    assert guarantee.values[0] == guarantee.guaranteed[0].value


def test_v_only_falls_with_the_law_of_the_theorem(run):
    loop, trace = run('two_link', 3.0)
    values = guarantee_of_trace(loop, trace).values
    assert values[-1] < 1e-6 * values[0]
    assert np.diff(values).max() < 1e-3 * values[0]  # sampling alone lets it rise, and little


def test_known_model_starts_with_the_value_of_the_barrier_and_e2_alone(run):
    loop, trace = run('two_link', 0.5, 'controller.model=known',
                      'controller.known_parameters=[3.473, 0.196, 0.242, 5.3, 1.1]',
                      'arm_driver.initial_position=[0.1, 1.9]')
    guarantee = guarantee_of_trace(loop, trace)
    assert guarantee.guaranteed[0].value < 1.0
    assert guarantee.first is None


def test_a_run_beyond_the_guaranteed_error_is_reported_with_joint_and_time(run):
    loop, trace = run('two_link', 0.5)
    aside = np.where(trace.t >= 0.25, 0.25, 0.0)[:, None] * [1.0, 0.0]
    guarantee = guarantee_of_trace(loop, dataclasses.replace(
        trace, q=trace.q + aside, e1=trace.e1 + aside))
    assert guarantee.first.joint == 'joint1'
    assert guarantee.first.t == 0.25
    assert guarantee.figures()['left']
    assert guarantee.figures()['message'] in guarantee.line()


def test_a_jump_of_the_true_parameters_begins_a_new_guarantee(run):
    loop, trace = run('two_link', 1.0, 'arm_driver.schedule.time=[0.5]',
                      'arm_driver.schedule.parameter=[p1]', 'arm_driver.schedule.value=[4.5]')
    guarantee = guarantee_of_trace(loop, trace)
    assert guarantee.starts == (0.0, 0.5)
    before, after = guarantee.values[499], guarantee.values[500]
    assert after > before + 0.1


def test_simulate_prints_the_guarantee_as_json_and_warns_of_a_short_history(repository, capsys):
    config = str(repository / 'config' / 'two_link.yaml')
    status = main([config, '--duration', '0.2', '--json', '--set', 'identifier.history.size=3'])
    output = capsys.readouterr()
    assert status == 0
    guaranteed = json.loads(output.out)['guarantee']
    assert guaranteed['V0'] == pytest.approx(76.0, abs=0.1)
    assert guaranteed['left'] is False
    assert guaranteed['message'] is None
    assert len(guaranteed['U_e1_lower']) == len(guaranteed['U_e1_upper']) == 2
    assert 'P = 3' in output.err


def test_three_link_learns_all_its_parameters_within_25_s_and_keeps_its_sets(run):
    loop, trace = run('three_link', 30.0)
    figures = summarise(run_of_trace(loop, trace))
    assert figures['set_violations'] == 0
    assert figures['theta_settling_time_s'] < 25.0
    assert figures['history_rank'] == 11


@pytest.mark.parametrize('payload', [0.0, 2.0])
def test_three_link_with_the_gains_of_the_paper_keeps_its_sets(run, payload):
    loop, trace = run('three_link_paper', 13.0, f'arm_driver.payload={payload}')
    figures = summarise(run_of_trace(loop, trace))
    assert figures['set_violations'] == 0
    assert figures['history_rank'] == 11


def test_three_link_stays_in_its_sets_with_20_ms_of_delay(run):
    loop, trace = run('three_link', 13.0, 'arm_driver.dead_time=20')
    assert summarise(run_of_trace(loop, trace))['set_violations'] == 0
    assert np.abs(trace.torque).max() < 3.0  # no oscillation


def test_three_link_reference_starts_at_zero_at_rest(run):
    loop, _ = run('three_link', 0.001)
    point = loop.controller.reference.at(0.0)
    np.testing.assert_allclose(np.concatenate(point[:2]), 0.0, atol=1e-12)
    np.testing.assert_allclose(loop.controller.reference.range()[1], [0.4, 1.0, 1.6])
