# SPDX-License-Identifier: Apache-2.0
"""Facts about the sampled torque filter: Y_f θ* = τ_f at every sample of a held torque (18)."""

from __future__ import annotations

import math

import numpy as np
import pytest

from adaptive_blf_control.arms.inverse_dynamics import inverse_dynamics
from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.torque_filter import (
    filter_pair,
    TorqueFilter,
    TorqueFilterArrays,
)

ARM = TwoLinkArm()
THETA = ARM.nominal
PAPER_K = 0.001


def residuals(samples, k, gap=math.inf):
    """Y_f θ* − τ_f after every sample, shape (N, 2)."""
    torque_filter, last, result = TorqueFilter(2, 5, k, gap), samples[0].t, []
    for t, q, qd, tau in samples:
        torque_filter.update(t - last, *ARM.Y12(q, qd), tau)
        result.append(torque_filter.pair.regressor @ THETA - torque_filter.pair.torque)
        last = t
    return np.array(result)


def residuals_term_by_term(samples, k):
    """The same with (14)-(18) discretised term by term, each exact for an input held back."""
    y1f, y2f, tf = np.zeros((2, 5)), np.zeros((2, 5)), np.zeros(2)
    result = []
    for last, (t, q, qd, tau) in zip(samples, samples[1:]):
        a = math.exp(-(t - last.t) / k)
        y1f = a * y1f + (1 - a) * ARM.Y1(last.q, last.qd)
        y2f = a * y2f + (1 - a) * ARM.Y2(last.q, last.qd)
        tf = a * tf + (1 - a) * tau
        result.append(((ARM.Y1(q, qd) - y1f) / k + y2f) @ THETA - tf)
    return np.array(result)


@pytest.mark.parametrize('k', [PAPER_K, 0.02])
@pytest.mark.parametrize('jitter', [0.0, 0.5])
def test_filtered_regressor_times_parameters_equals_filtered_torque(record, k, jitter):
    assert np.abs(residuals(record(jitter=jitter), k)).max() < 1e-4  # of torques up to 12 N·m


@pytest.mark.parametrize('k', [PAPER_K, 0.02])
def test_filtering_term_by_term_is_a_thousand_times_worse(record, k):
    samples = record()
    settled = int(10 * k / 1e-3)
    assert (np.abs(residuals_term_by_term(samples, k)[settled:]).max()
            > 1000.0 * np.abs(residuals(samples, k)).max())


def test_nothing_but_the_trapezoid_on_y2_is_left(record):
    # Without y2's variation (friction and Coriolis columns frozen) the identity is exact.
    torque_filter, momentum, force = TorqueFilter(1, 1, 0.01), 0.0, np.random.default_rng(0)
    for k in range(200):
        tau = force.normal(size=1)
        momentum += 1e-3 * (k > 0) * tau[0]
        torque_filter.update(1e-3, np.array([[momentum]]), np.zeros((1, 1)), tau)
        np.testing.assert_allclose(torque_filter.pair.regressor[0], torque_filter.pair.torque,
                                   atol=1e-12)


def test_filter_is_a_first_order_lag_with_its_time_constant():
    torque_filter, zero = TorqueFilter(1, 1, 0.02), np.zeros((1, 1))
    torque_filter.update(0.0, zero, zero, np.ones(1))
    for k in range(1, 101):
        torque_filter.update(1e-3, np.array([[k * 1e-3]]), np.full((1, 1), 2.0), np.ones(1))
        lag = 1.0 - math.exp(-k * 1e-3 / 0.02)
        assert torque_filter.pair.torque[0] == pytest.approx(lag)
        # the first trapezoid begins at 0, every later one is 2
        late = lag - (1.0 - math.exp(-1e-3 / 0.02)) * math.exp(-(k - 1) * 1e-3 / 0.02)
        assert torque_filter.pair.regressor[0, 0] == pytest.approx(lag + 2.0 * late + (lag - late))


def test_filter_starts_from_zero():
    torque_filter = TorqueFilter(2, 5, PAPER_K)
    for _ in range(2):
        assert not torque_filter.update(0.0, np.ones((2, 5)), np.ones((2, 5)), np.ones(2))
        assert not torque_filter.pair.regressor.any()
        assert not torque_filter.pair.torque.any()
        assert torque_filter.update(1e-3, np.ones((2, 5)), np.ones((2, 5)), np.ones(2))
        assert torque_filter.pair.torque.all()
        torque_filter.reset()


def test_a_gap_restarts_the_filter_and_leaves_no_trace(record):
    samples = record(steps=600)
    with_gap = samples[:200] + samples[300:]  # 101 ms
    got = residuals(with_gap, 0.02, gap=0.05)
    assert not got[200].any()
    assert np.abs(got).max() < 1e-4
    assert np.abs(residuals(with_gap, 0.02)).max() > 1e-2  # filtered across, it would


def test_an_interval_as_long_as_the_gap_is_filtered():
    for dt, expected in ((0.5, True), (0.5000001, False)):
        torque_filter = TorqueFilter(1, 1, 0.02, gap=0.5)
        torque_filter.update(0.0, np.ones((1, 1)), np.ones((1, 1)), np.ones(1))
        assert torque_filter.update(dt, np.ones((1, 1)), np.ones((1, 1)), np.ones(1)) == expected


def test_a_lost_sample_is_forgotten_with_the_time_constant(record):
    samples = record(steps=600)
    got = np.abs(residuals(samples[:200] + samples[201:], 0.02)).max(axis=1)
    assert got[200] > 1e-3  # the torque of the lost interval is unknown
    assert got[-1] < 1e-4
    assert got[300] == pytest.approx(got[200] * math.exp(-100e-3 / 0.02), rel=0.1)


def test_a_lost_sample_does_nothing_where_the_torque_did_not_change():
    dynamics, torque_filter = ARM.dynamics(THETA), TorqueFilter(2, 5, 0.02)
    q, qd, tau, last = np.array([0.0, 1.0]), np.zeros(2), np.array([2.0, -0.5]), 0
    for k in range(300):
        if k not in (150, 151):
            torque_filter.update((k - last) * 1e-3, *ARM.Y12(q, qd), tau)
            last = k
        regressor, torque = torque_filter.pair
        assert np.abs(regressor @ THETA - torque).max() < 1e-4
        q, qd = dynamics.advance(q, qd, tau, 1e-3, 2)


def test_pairs_handed_out_are_never_changed(record):
    torque_filter, seen = TorqueFilter(2, 5, PAPER_K), []
    for _, q, qd, tau in record(steps=5):
        torque_filter.update(1e-3, *ARM.Y12(q, qd), tau)
        seen.append((torque_filter.pair, torque_filter.pair.regressor.copy()))
    for pair, copy in seen:
        np.testing.assert_array_equal(pair.regressor, copy)


def test_one_step_equals_the_printed_formula():
    random = np.random.default_rng(6)
    yf, y1, y1_last, y2, y2_last = random.normal(size=(5, 2, 5))
    tf, tau = random.normal(size=(2, 2))
    dt, a = 0.003, 0.8
    regressor = a * yf + (1 - a) * ((y1 - y1_last) / dt + (y2 + y2_last) / 2)
    torque = a * tf + (1 - a) * tau
    arrays = TorqueFilterArrays(yf, tf, y1_last, y2_last, np.zeros(2), np.ones(1, dtype=bool),
                                -dt / math.log(a), False)
    assert filter_pair(arrays, dt, y1, y2, tau)
    np.testing.assert_allclose(arrays.regressor, regressor, rtol=1e-12)
    np.testing.assert_allclose(arrays.torque, torque, rtol=1e-12)


@pytest.mark.parametrize('value', [0.0, -1.0, float('nan')])
@pytest.mark.parametrize('name', ['time_constant', 'gap'])
def test_times_are_positive(name, value):
    times = {'time_constant': 0.01, 'gap': 0.1, name: value}
    with pytest.raises(ParameterError, match=rf'identifier\.filter\.{name}'):
        TorqueFilter(1, 1, **times)


def _smooth_motion(dt, instant):
    """Residual of a sinusoidal torque, measured at the samples or as its mean, largest of (N,)."""
    t = np.arange(0.0, 2.0, dt)
    w = np.array([3.0, 5.0])
    q, qd, qdd = (np.sin(np.outer(t, w)), w * np.cos(np.outer(t, w)),
                  -w**2 * np.sin(np.outer(t, w)))
    tau = inverse_dynamics(ARM, THETA, q, qd, qdd)
    torque_filter, largest = TorqueFilter(2, 5, 0.02, instant=instant), 0.0
    for k in range(t.size):
        torque_filter.update(dt, *ARM.Y12(q[k], qd[k]), tau[k])
        if t[k] > 0.3:
            residual = torque_filter.pair.regressor @ THETA - torque_filter.pair.torque
            largest = max(largest, float(np.abs(residual).max()))
    return largest


def test_a_torque_measured_at_the_samples_costs_half_a_sample_unless_it_is_declared():
    declared, undeclared = _smooth_motion(2e-3, True), _smooth_motion(2e-3, False)
    assert undeclared > 0.05  # N·m: half a sample of torques up to 100 N·m
    assert declared < 0.02 * undeclared
    assert _smooth_motion(1e-3, True) < 0.3 * declared  # of second order in the interval


def test_the_meaning_of_the_torque_can_change_between_two_samples():
    switched, mean = TorqueFilter(1, 1, 0.01), TorqueFilter(1, 1, 0.01)
    for torque_filter, after in ((switched, 3.0), (mean, 2.0)):
        torque_filter.update(1e-3, np.zeros((1, 1)), np.zeros((1, 1)), np.array([1.0]))
        torque_filter.retune(0.01, math.inf, instant=torque_filter is switched)
        torque_filter.update(1e-3, np.zeros((1, 1)), np.zeros((1, 1)), np.array([after]))
    assert switched.pair.torque == pytest.approx(mean.pair.torque)
