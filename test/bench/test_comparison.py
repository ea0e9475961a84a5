# SPDX-License-Identifier: Apache-2.0
"""Facts about the comparison of laws: they run, they learn, their figures are those of the run."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.bench.comparison import FIXED, LAWS, run_law
from adaptive_blf_control.bench.integral_cl import IntegralWindow
from adaptive_blf_control.bench.law_figures import (
    COLUMNS,
    law_figures,
    markdown_row,
)
from adaptive_blf_control.configuration.build_closed_loop import build_closed_loop
from adaptive_blf_control.configuration.parameter_file import load_yaml


@pytest.fixture
def scenario(repository):
    """Return ``scenario(name)``: the data of a parameter file."""
    return lambda name: load_yaml(repository / 'config' / f'{name}.yaml')


@pytest.mark.parametrize('config', ['two_link', 'three_link_encoder'])
@pytest.mark.parametrize('name', LAWS)
def test_every_law_keeps_its_torque_finite_and_within_the_limit(scenario, name, config):
    loop, trace, _ = run_law(scenario(config), name, 1.0)
    assert np.isfinite(trace.torque).all()
    assert np.isfinite(trace.e1).all()
    assert (np.abs(trace.torque) <= loop.controller.settings.torque_limit).all()
    assert np.abs(trace.e1).max() < 0.2


def test_our_law_is_compared_as_the_scenario_runs_it_bit_for_bit(scenario):
    run = run_law(scenario('two_link'), 'ABLF, ablf_concurrent (37)', 0.5)
    trace = build_closed_loop(scenario('two_link')).run(0.5)
    np.testing.assert_array_equal(run.trace.torque, trace.torque)
    np.testing.assert_array_equal(run.theta, trace.theta_hat)


@pytest.mark.parametrize(('name', 'known'), [
    ('PD', None), (FIXED[1], 0.7), (FIXED[2], 1.0), (FIXED[3], 0.7)])
def test_a_law_that_learns_nothing_believes_in_what_the_table_says(scenario, name, known):
    loop, _, theta = run_law(scenario('two_link'), name, 0.01)
    if known is None:
        assert theta is None
    else:
        np.testing.assert_allclose(theta, np.tile(known * loop.arm.nominal, (11, 1)))


def test_integral_concurrent_learning_finds_the_parameters_of_the_two_link_arm(scenario):
    figures = law_figures(run_law(scenario('two_link'), 'integral concurrent learning', 6.0))
    assert figures['theta_settling_time_s'] < 3.0
    assert figures['theta_error'] < 1e-3


def test_slotine_li_tracks_ever_better_without_finding_the_parameters(scenario):
    run = run_law(scenario('two_link'), 'Slotine-Li adaptive', 25.0)
    e1, third = run.trace.e1, len(run.trace.t) // 3
    first, last = (np.sqrt(np.mean(part ** 2)) for part in (e1[:third], e1[-third:]))
    assert last < 0.3 * first
    true = run.loop.arm.nominal
    at_start = np.linalg.norm(run.theta[0] - true) / np.linalg.norm(true)
    assert law_figures(run)['theta_error'] < at_start


def test_the_integral_window_holds_exactly_what_the_arm_did():
    arm, random = TwoLinkArm(), np.random.default_rng(6)
    window, dynamics = IntegralWindow(arm, 50), arm.dynamics(arm.nominal)
    q, qd, torques, largest = np.array([0.0, 1.0]), np.array([0.5, -1.0]), [np.zeros(2)], 0.0
    for k in range(300):
        pair = window.update(1e-3, q, qd, torques[-1])
        assert (pair is None) == (k < 50)
        if pair is not None:
            regressor, torque = pair
            largest = max(largest, float(np.abs(regressor @ arm.nominal - torque).max()))
            np.testing.assert_allclose(torque, np.mean(torques[-50:], axis=0), atol=1e-12)
        torques.append(random.normal(scale=3.0, size=2))
        q, qd = dynamics.advance(q, qd, torques[-1], 1e-3, 4)
    assert largest < 1e-4  # the trapezoid


@pytest.mark.parametrize('name', ['PD', 'integral concurrent learning'])
def test_figures_are_those_of_the_run_and_fit_the_table(scenario, name):
    run = run_law(scenario('two_link'), name, 0.5)
    figures, trace = law_figures(run), run.trace
    assert figures['max_abs_error'] == np.abs(trace.e1).max(axis=0).tolist()
    assert figures['overall']['max_abs_error'] == np.abs(trace.e1).max()
    assert figures['overall']['rms_error'] == pytest.approx(np.sqrt(np.mean(trace.e1 ** 2)))
    assert figures['overall']['chatter'] == pytest.approx(
        np.sqrt(np.mean((trace.torque[1:] - trace.torque[:-1]) ** 2)))
    assert figures['set_violations'] == 0
    row = markdown_row(name, figures, name not in FIXED)
    assert row.count('|') == len(COLUMNS) + 1
