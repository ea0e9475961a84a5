# SPDX-License-Identifier: Apache-2.0
"""Facts about the paper's 2-DoF arm, against M, C and F of (42) written out here."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pytest

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.errors import ArmError

hypothesis = pytest.importorskip('hypothesis')
st = hypothesis.strategies

ARM = TwoLinkArm()
PAPER = np.array([3.473, 0.196, 0.242, 5.3, 1.1])


class Model(NamedTuple):
    """The matrices of (42) at one state."""

    mass: np.ndarray
    mass_dot: np.ndarray
    coriolis: np.ndarray
    friction: np.ndarray


def model(q: np.ndarray, qd: np.ndarray, theta: np.ndarray) -> Model:
    p1, p2, p3, f1, f2 = theta
    c2, s2 = np.cos(q[1]), np.sin(q[1])
    return Model(
        np.array([[p1 + 2 * p3 * c2, p2 + p3 * c2], [p2 + p3 * c2, p2]]),
        -p3 * s2 * qd[1] * np.array([[2.0, 1.0], [1.0, 0.0]]),
        p3 * s2 * np.array([[-qd[1], -(qd[0] + qd[1])], [qd[0], 0.0]]),
        np.diag([f1, f2]))


def random_states(count: int = 50) -> Iterator[tuple[np.ndarray, ...]]:
    """Yield q, q̇, α, α̇ and positive definite parameters."""
    random = np.random.default_rng(1)
    for _ in range(count):
        vectors = random.normal(scale=2.0, size=(4, 2))
        p2, p3, f1, f2 = random.uniform(0.1, 1.0, 4)
        p1 = (p2 ** 2 + p3 ** 2) / p2 + random.uniform(0.1, 3.0)
        yield (*vectors, np.array([p1, p2, p3, f1, f2]))


def test_momentum_regressor_equals_mass_matrix_times_velocity():
    for q, qd, _, _, theta in random_states():
        np.testing.assert_allclose(ARM.Y1(q, qd) @ theta, model(q, qd, theta).mass @ qd,
                                   rtol=1e-12, atol=1e-12)


def test_second_regressor_equals_coriolis_and_friction_without_the_rate_of_momentum():
    for q, qd, _, _, theta in random_states():
        mass, mass_dot, coriolis, friction = model(q, qd, theta)
        np.testing.assert_allclose(ARM.Y2(q, qd) @ theta,
                                   (-mass_dot + coriolis + friction) @ qd, rtol=1e-12, atol=1e-12)


def test_both_regressors_at_once_equal_each_alone():
    for q, qd, *_ in random_states(5):
        y1, y2 = ARM.Y12(q, qd)
        np.testing.assert_array_equal(y1, ARM.Y1(q, qd))
        np.testing.assert_array_equal(y2, ARM.Y2(q, qd))


def test_control_regressor_equals_equation_35():
    for q, qd, alpha, alpha_dot, theta in random_states():
        mass, mass_dot, coriolis, friction = model(q, qd, theta)
        expected = mass @ alpha_dot + (coriolis + friction) @ qd - 0.5 * mass_dot @ (qd - alpha)
        np.testing.assert_allclose(ARM.X(q, qd, alpha, alpha_dot) @ theta, expected,
                                   rtol=1e-12, atol=1e-12)


def test_control_regressor_does_the_work_of_the_slotine_li_form_on_e2():
    for q, qd, alpha, alpha_dot, theta in random_states():
        mass, _, coriolis, friction = model(q, qd, theta)
        slotine_li = mass @ alpha_dot + coriolis @ alpha + friction @ qd
        difference = ARM.X(q, qd, alpha, alpha_dot) @ theta - slotine_li
        assert (qd - alpha) @ difference == pytest.approx(0.0, abs=1e-11)


def test_mass_matrix_rate_minus_twice_coriolis_is_skew():
    random = np.random.default_rng(2)
    for q, qd, _, _, theta in random_states():
        step = 1e-6
        mass = [np.column_stack([ARM.Y1(q + s * step * qd, e) @ theta for e in np.eye(2)])
                for s in (1, -1)]
        skew = (mass[0] - mass[1]) / (2 * step) - 2.0 * model(q, qd, theta).coriolis
        np.testing.assert_allclose(skew, -skew.T, atol=1e-7)
        v = random.normal(size=2)
        assert v @ skew @ v == pytest.approx(0.0, abs=1e-7)


def test_mass_matrix_is_symmetric_and_positive_definite():
    for q, _, _, _, theta in random_states():
        mass = np.column_stack([ARM.Y1(q, e) @ theta for e in np.eye(2)])
        np.testing.assert_allclose(mass, mass.T, rtol=1e-13)
        assert np.linalg.eigvalsh(mass)[0] > 0.0


def test_forward_dynamics_inverts_the_equation_of_motion():
    random = np.random.default_rng(3)
    for q, qd, _, _, theta in random_states():
        tau = random.normal(scale=20.0, size=2)
        qdd = ARM.dynamics(theta).acceleration(q, qd, tau)
        mass, _, coriolis, friction = model(q, qd, theta)
        np.testing.assert_allclose(mass @ qdd + (coriolis + friction) @ qd, tau, atol=1e-10)


def test_rate_of_momentum_plus_second_regressor_equals_torque_along_a_trajectory():
    dynamics, dt = ARM.dynamics(PAPER), 1e-4
    tau = np.array([6.0, -1.5])
    states = [(np.array([0.3, -0.8]), np.array([1.2, -2.0]))]
    for _ in range(2000):
        states.append(dynamics.advance(*states[-1], tau, dt, 1))
    for k in range(1, 2000, 97):
        rate = (ARM.Y1(*states[k + 1]) - ARM.Y1(*states[k - 1])) / (2 * dt)
        np.testing.assert_allclose((rate + ARM.Y2(*states[k])) @ PAPER, tau, atol=2e-5)


def test_integration_is_of_fourth_order():
    dynamics, tau = ARM.dynamics(PAPER), np.array([4.0, 1.0])
    q, qd = np.array([0.1, 1.5]), np.array([-1.0, 4.0])
    exact = np.concatenate(dynamics.advance(q, qd, tau, 0.1, 4096))
    coarse, fine = (np.abs(np.concatenate(dynamics.advance(q, qd, tau, 0.1, s)) - exact).max()
                    for s in (8, 16))
    assert 12.0 < coarse / fine < 20.0


def test_substeps_equal_shorter_steps():
    dynamics, tau = ARM.dynamics(PAPER), np.array([4.0, 1.0])
    q, qd = np.array([0.1, 1.5]), np.array([-1.0, 4.0])
    one = dynamics.advance(q, qd, tau, 0.02, 2)
    two = dynamics.advance(*dynamics.advance(q, qd, tau, 0.01, 1), tau, 0.01, 1)
    np.testing.assert_array_equal(one, two)


def test_advancing_leaves_its_arguments_alone():
    q, qd, tau = np.array([0.1, 1.5]), np.array([-1.0, 4.0]), np.array([4.0, 1.0])
    ARM.dynamics(PAPER).advance(q, qd, tau, 0.01, 3)
    np.testing.assert_array_equal([q, qd, tau], [[0.1, 1.5], [-1.0, 4.0], [4.0, 1.0]])


def test_nominal_parameters_are_those_of_the_paper():
    np.testing.assert_array_equal(ARM.nominal, PAPER)
    assert (ARM.n, ARM.m) == (2, 5)


def test_parameters_are_named_after_the_joints():
    arm = TwoLinkArm(('shoulder', 'elbow'))
    assert arm.joints == ('shoulder', 'elbow')
    assert arm.parameters == ('p1', 'p2', 'p3', 'fv_shoulder', 'fv_elbow')


@pytest.mark.parametrize('joints', [(), ('a',), ('a', 'a'), ('a', 'b', 'c')])
def test_two_distinct_joints_are_needed(joints):
    with pytest.raises(ArmError, match='two_link has two joints'):
        TwoLinkArm(joints)


@hypothesis.given(p1=st.floats(-1.0, 5.0), p2=st.floats(-1.0, 5.0), p3=st.floats(-3.0, 3.0))
def test_parameters_are_accepted_where_the_mass_matrix_is_positive_definite(p1, p2, p3):
    theta = np.array([p1, p2, p3, 1.0, 1.0])
    smallest = min(np.linalg.eigvalsh(model(np.array([0.0, q2]), np.zeros(2), theta).mass)[0]
                   for q2 in np.linspace(0.0, np.pi, 33))
    hypothesis.assume(abs(smallest) > 1e-9)
    if smallest > 0.0:
        ARM.dynamics(theta)
    else:
        with pytest.raises(ArmError, match='not positive definite'):
            ARM.dynamics(theta)


def test_negative_definite_parameters_are_refused():
    with pytest.raises(ArmError, match='not positive definite'):
        ARM.dynamics(np.array([-5.0, -0.2, 0.1, 1.0, 1.0]))


def test_dynamics_keeps_its_own_parameters():
    theta = PAPER.copy()
    dynamics = ARM.dynamics(theta)
    state = np.array([0.1, 0.2]), np.array([0.3, 0.4]), np.zeros(2)
    before = dynamics.acceleration(*state)
    theta[:] = 1.0
    np.testing.assert_array_equal(dynamics.acceleration(*state), before)
