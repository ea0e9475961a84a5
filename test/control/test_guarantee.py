# SPDX-License-Identifier: Apache-2.0
"""Facts about the numbers of Theorem 2 and the monitor that watches them."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.arms.three_link import three_link_mass, ThreeLinkArm
from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.control.barrier import active_bound, barrier
from adaptive_blf_control.control.guarantee import (
    bounded_value,
    guarantee,
    GuaranteeMonitor,
    lyapunov_value,
    mass_range,
)
from adaptive_blf_control.control.law import torque
from adaptive_blf_control.control.sets import JointInterval
from adaptive_blf_control.errors import ParameterError

ARM, ONES = TwoLinkArm(), np.ones(5)
ONE = np.ones(2)  # J, the weight of the paper
WEIGHT = np.array([0.3, 4.0])  # J
PERFORMANCE = JointInterval([-0.17, -0.1], [0.2, 0.3])
REFERENCE = (np.array([-1.0, -2.0]), np.array([1.0, 2.0]))


def states(count=50):
    random = np.random.default_rng(5)
    for _ in range(count):
        e1 = random.uniform(0.99 * PERFORMANCE.lower, 0.99 * PERFORMANCE.upper)
        yield random.normal(size=2), e1, random.normal(size=2), random.normal(size=5)


def value(q, e1, e2, theta_hat, gamma=ONES):
    return lyapunov_value(ARM, q, e1, e2, PERFORMANCE, theta_hat, ARM.nominal, gamma, WEIGHT)


def test_value_is_the_sum_of_barrier_kinetic_and_parameter_terms():
    gamma = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    for q, e1, e2, theta_hat in states():
        mass = np.column_stack([ARM.Y1(q, unit) @ ARM.nominal for unit in np.eye(2)])
        b = np.where(e1 > 0.0, PERFORMANCE.upper, -PERFORMANCE.lower)
        error = theta_hat - ARM.nominal
        expected = (0.5 * np.sum(WEIGHT * e1 ** 2 / (b ** 2 - e1 ** 2)) + 0.5 * e2 @ mass @ e2
                    + 0.5 * error @ np.diag(1.0 / gamma) @ error)
        assert value(q, e1, e2, theta_hat, gamma) == pytest.approx(expected, rel=1e-12)


def test_an_error_within_u_e1_costs_no_more_than_v0_and_one_beyond_costs_more():
    """(61) and (62): U_e1 is where a single joint alone would take all of V(0)."""
    guaranteed = guarantee(0.7, PERFORMANCE, REFERENCE, 0.1, WEIGHT)
    for i in range(2):
        for bound in (guaranteed.error_lower, guaranteed.error_upper):
            e1 = np.zeros(2)
            e1[i] = bound[i]
            b = active_bound(e1, PERFORMANCE.lower, PERFORMANCE.upper)
            assert barrier(e1, b, WEIGHT) == pytest.approx(0.7, rel=1e-12)


def test_guaranteed_errors_lie_inside_the_performance_set_and_close_up_to_it():
    for v0 in (0.0, 1e-3, 1.0, 1e3, 1e9):
        guaranteed = guarantee(v0, PERFORMANCE, REFERENCE, 0.1, ONE)
        assert np.all(PERFORMANCE.lower < guaranteed.error_lower)
        assert np.all(guaranteed.error_upper < PERFORMANCE.upper)
    np.testing.assert_allclose(guaranteed.error_upper, PERFORMANCE.upper, rtol=1e-9)
    assert not guarantee(0.0, PERFORMANCE, REFERENCE, 0.1, ONE).error_upper.any()


def test_guaranteed_output_is_the_reference_widened_by_the_guaranteed_error():
    guaranteed = guarantee(0.7, PERFORMANCE, REFERENCE, 0.1, ONE)
    np.testing.assert_allclose(guaranteed.output_lower, REFERENCE[0] + guaranteed.error_lower)
    np.testing.assert_allclose(guaranteed.output_upper, REFERENCE[1] + guaranteed.error_upper)


def test_e2_within_its_bound_whatever_the_posture():
    smallest, largest = mass_range(ARM, ARM.nominal, np.full(2, -np.pi), np.full(2, np.pi))
    for q, e1, e2, theta_hat in states():
        v = value(q, e1, e2, theta_hat)
        guaranteed = guarantee(v, PERFORMANCE, REFERENCE, smallest, WEIGHT)
        assert np.linalg.norm(e2) <= guaranteed.e2_norm
        error = float(np.linalg.norm(theta_hat - ARM.nominal))
        assert v <= bounded_value(e1, e2, PERFORMANCE, largest, error, ONES, WEIGHT)


def test_mass_range_holds_the_eigenvalues_of_the_mass_matrix():
    arm = ThreeLinkArm()
    smallest, largest = mass_range(arm, arm.nominal, np.zeros(3), np.array([0.4, 1.0, 1.6]))
    values = np.linalg.eigvalsh(three_link_mass(np.zeros(3), arm.nominal))
    assert smallest == pytest.approx(values[0])  # stretched: the extremes are in a corner
    assert largest == pytest.approx(values[-1])


def test_a_bound_on_the_parameter_error_counts_with_the_smallest_gain():
    gamma = np.array([1.0, 0.5])
    zero = np.zeros(2)
    assert bounded_value(zero, zero, PERFORMANCE, 1.0, 3.0, gamma, ONE) == pytest.approx(9.0)


@pytest.mark.parametrize(('arguments', 'name'), [((-1.0, 1.0), 'largest_mass'),
                                                 ((1.0, np.nan), 'theta_error')])
def test_unusable_bounds_are_refused_by_name(arguments, name):
    zero = np.zeros(2)
    with pytest.raises(ParameterError, match=name):
        bounded_value(zero, zero, PERFORMANCE, *arguments, np.ones(5), ONE)


def test_value_that_is_not_finite_promises_nothing():
    with pytest.raises(ParameterError, match=r'V\(0\)'):
        guarantee(np.nan, PERFORMANCE, REFERENCE, 1.0, ONE)


# -- SBLF -----------------------------------------------------------------------------------------


def test_equal_and_opposite_bounds_make_the_barrier_symmetric_joint_by_joint():
    mixed = JointInterval([-0.2, -0.1], [0.2, 0.3])
    x, theta, k2 = np.zeros((2, 1)), np.zeros(1), np.ones(2)
    for _, e1, e2, _ in states():
        e1 = np.array([e1[0], 0.0])
        b = active_bound(e1, mixed.lower, mixed.upper)
        opposite = active_bound(-e1, mixed.lower, mixed.upper)
        assert barrier(e1, b, ONE) == barrier(-e1, opposite, ONE)
        np.testing.assert_array_equal(torque(x, theta, k2, e1, e2, b, ONE, True),
                                      -torque(x, theta, k2, -e1, -e2, opposite, ONE,
                                              True))
    guaranteed = guarantee(0.7, mixed, REFERENCE, 0.1, ONE)
    assert guaranteed.error_lower[0] == -guaranteed.error_upper[0]
    assert guaranteed.error_lower[1] != -guaranteed.error_upper[1]


# -- the monitor ----------------------------------------------------------------------------------


@pytest.fixture
def monitor():
    guaranteed = guarantee(0.5, PERFORMANCE, REFERENCE, 0.1, ONE)
    return GuaranteeMonitor(guaranteed, PERFORMANCE, ('a', 'b'), ONE)


def test_monitor_is_silent_inside(monitor):
    for t in range(10):
        assert monitor.observe(float(t), 0.99 * monitor.guaranteed.error_upper * 0.5, 0.5) is None
    assert monitor.first is None


def test_monitor_names_joint_value_and_bound_of_an_error_beyond(monitor):
    e1 = np.array([0.0, 1.01 * monitor.guaranteed.error_lower[1]])
    departure = monitor.observe(1.5, e1, 0.2)
    assert departure == (1.5, 'b', e1[1], monitor.guaranteed.error_lower[1])
    assert "joint 'b'" in str(departure)
    assert '1.500 s' in str(departure)


def test_monitor_notices_a_rise_of_v_but_not_rounding(monitor):
    zero = np.zeros(2)
    assert monitor.observe(0.0, zero, 0.5 * (1.0 + 1e-12)) is None
    departure = monitor.observe(2.0, zero, 0.51)
    assert departure == (2.0, None, 0.51, 0.5)
    assert 'V(0) = 0.5' in str(departure)


def test_monitor_keeps_the_first_departure(monitor):
    zero = np.zeros(2)
    monitor.observe(1.0, zero, 0.6)
    monitor.observe(2.0, zero, 0.7)
    assert monitor.first.t == 1.0


def test_monitor_takes_nan_for_a_departure(monitor):
    assert monitor.observe(0.0, np.array([np.nan, 0.0])).joint == 'a'
    assert monitor.observe(0.0, np.zeros(2), np.nan).joint is None


def test_monitor_watches_the_error_alone_where_theta_is_unknown(monitor):
    assert monitor.observe(0.0, np.zeros(2)) is None
