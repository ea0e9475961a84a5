# SPDX-License-Identifier: Apache-2.0
"""Facts about the laws we compare with: they run, they learn, their gains are what is said."""

from __future__ import annotations

from copy import copy

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
from adaptive_blf_control.configuration.build import build_closed_loop
from adaptive_blf_control.configuration.parameter_file import load_yaml
from adaptive_blf_control.simulation.baselines.gains import gains_like


@pytest.fixture
def scenario(repository):
    """Return ``scenario(name)``: the data of a parameter file."""
    return lambda name: load_yaml(repository / 'config' / f'{name}.yaml')


@pytest.mark.parametrize('config', ['two_link', 'three_link_encoder'])
@pytest.mark.parametrize('name', LAWS)
def test_every_law_keeps_its_torque_finite_and_within_the_limit(scenario, name, config):
    loop, run = run_law(scenario(config), name, 1.0)
    assert np.isfinite(run.torque).all()
    assert np.isfinite(run.e1).all()
    assert (np.abs(run.torque) <= loop.controller.settings.torque_limit).all()
    assert np.abs(run.e1).max() < 0.2


def test_our_law_behind_the_interface_is_the_closed_loop_bit_for_bit(scenario):
    _, run = run_law(scenario('two_link'), 'ABLF, ablf_concurrent (37)', 0.5)
    trace = build_closed_loop(scenario('two_link')).run(0.5)
    np.testing.assert_array_equal(run.torque, trace.torque)
    np.testing.assert_array_equal(run.theta, trace.theta_hat)


def test_integral_concurrent_learning_finds_the_parameters_of_the_two_link_arm(scenario):
    loop, run = run_law(scenario('two_link'), 'integral concurrent learning', 6.0)
    figures = law_figures(loop, run)
    assert figures['theta_settling_time_s'] < 3.0
    assert figures['theta_error'] < 1e-3


def test_slotine_li_tracks_ever_better_without_finding_the_parameters(scenario):
    loop, run = run_law(scenario('two_link'), 'Slotine-Li adaptive', 25.0)
    third = len(run.t) // 3
    first, last = (np.sqrt(np.mean(part ** 2)) for part in (run.e1[:third], run.e1[-third:]))
    assert last < 0.3 * first
    start = law_figures(loop, run._replace(t=run.t[:2], theta=run.theta[:2]))
    assert law_figures(loop, run)['theta_error'] < start['theta_error']


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


def test_gains_of_pd_are_the_linearisation_of_our_law(scenario):
    controller = build_closed_loop(scenario('three_link')).controller
    gains, arm, small = gains_like(controller), controller.arm, 1e-5
    point = controller.reference.at(0.0)
    for i, unit in enumerate(np.eye(arm.n)):
        for what, position, velocity in ((gains.stiffness, small * unit, 0.0 * unit),
                                         (gains.damping, 0.0 * unit, small * unit)):
            slopes = [-copy(controller).update(0.0, point.position + sign * position,
                                         point.velocity + sign * velocity,
                                         np.zeros(arm.m)).torque[i] / (sign * small)
                      for sign in (1.0, -1.0)]
            # One side of an asymmetric set is stiffer than the mean of both squares.
            assert min(slopes) * (1 - 1e-6) <= what[i] <= max(slopes) * (1 + 1e-6)


@pytest.mark.parametrize('name', ['PD', 'integral concurrent learning'])
def test_figures_are_those_of_the_run_and_fit_the_table(scenario, name):
    loop, run = run_law(scenario('two_link'), name, 0.5)
    figures = law_figures(loop, run)
    assert figures['max_abs_error'] == np.abs(run.e1).max(axis=0).tolist()
    assert figures['overall']['max_abs_error'] == np.abs(run.e1).max()
    assert figures['overall']['rms_error'] == pytest.approx(np.sqrt(np.mean(run.e1 ** 2)))
    assert figures['overall']['chatter'] == pytest.approx(
        np.sqrt(np.mean((run.torque[1:] - run.torque[:-1]) ** 2)))
    assert figures['set_violations'] == 0
    row = markdown_row(name, figures, name not in FIXED)
    assert row.count('|') == len(COLUMNS) + 1
