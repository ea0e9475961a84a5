# SPDX-License-Identifier: Apache-2.0
"""Facts about the controller: the decay of (28)-(34) and (57)-(59), limits, start-up checks."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.control.controller import (
    Controller,
    ControllerSettings,
    COUPLINGS,
    sampling_number,
)
from adaptive_blf_control.control.reference import SumOfSinusoids
from adaptive_blf_control.control.sets import JointInterval
from adaptive_blf_control.errors import ParameterError, SetViolation

hypothesis = pytest.importorskip('hypothesis')
st = hypothesis.strategies

ARM = TwoLinkArm()
THETA = ARM.nominal
DYNAMICS = ARM.dynamics(THETA)
K1, K2 = np.array([40.0, 30.0]), np.array([30.0, 40.0])
LOWER, UPPER = np.array([-0.17, -0.17]), np.array([0.2, 0.2])
any_pair = st.tuples(st.floats(), st.floats())


def controller(coupling: str = 'per_joint', limit: float = 1e9, widen: float = 0.0,
               lower: np.ndarray = LOWER, upper: np.ndarray = UPPER) -> Controller:
    reference = SumOfSinusoids(np.zeros(2), np.array([[1.0], [2.0]]), np.full((2, 1), 0.5),
                               np.array([[0.0], [np.pi / 2]]))
    safety = JointInterval(np.array([-1.17, -2.17]) - widen, np.array([1.2, 2.2]) + widen,
                           'safety')
    return Controller(ARM, ControllerSettings(K1, K2, np.full(2, limit), coupling), safety,
                      JointInterval(lower, upper, 'performance'), reference)


def random_states(law: Controller, count: int = 40):
    """Yield t, q, q̇ with errors inside the set, on both sides of zero."""
    random = np.random.default_rng(4)
    for _ in range(count):
        t = random.uniform(0.0, 12.0)
        point = law.reference.at(t)
        error = random.uniform(0.1, 0.8, 2) * np.where(random.random(2) < 0.5, LOWER, UPPER)
        yield t, point.position + error, point.velocity + random.normal(size=2)


def lyapunov_rate(law: Controller, theta: np.ndarray, t: float, q: np.ndarray,
                  qd: np.ndarray) -> float:
    """Derivative of V (30) along the closed loop in continuous time, by a central difference."""
    def slope(time: float, state: np.ndarray) -> np.ndarray:
        tau = law.update(time, state[:2], state[2:], theta).torque
        return np.concatenate([state[2:], DYNAMICS.acceleration(state[:2], state[2:], tau)])

    def value(step: float) -> float:
        s1 = slope(t, state)
        s2 = slope(t + step / 2, state + step / 2 * s1)
        s3 = slope(t + step / 2, state + step / 2 * s2)
        s4 = slope(t + step, state + step * s3)
        end = state + step / 6 * (s1 + 2 * s2 + 2 * s3 + s4)
        output = law.update(t + step, end[:2], end[2:], theta)
        return law.lyapunov(end[:2], output, THETA)

    state, h = np.concatenate([q, qd]), 1e-5
    return (value(h) - value(-h)) / (2 * h)


@pytest.mark.parametrize('coupling', COUPLINGS)
def test_known_parameters_make_the_lyapunov_function_decay_as_in_equation_34(coupling):
    law = controller(coupling)
    for t, q, qd in random_states(law):
        output = law.update(t, q, qd, THETA)
        expected = -np.sum(K1 * output.bound ** 2 * output.e1 ** 2) - np.sum(K2 * output.e2 ** 2)
        assert lyapunov_rate(law, THETA, t, q, qd) == pytest.approx(expected, rel=1e-5, abs=1e-6)


@pytest.mark.parametrize('coupling', COUPLINGS)
def test_wrong_parameters_add_what_the_adaptation_term_takes_away(coupling):
    law, wrong = controller(coupling), np.array([0.0, 9.0, 6.0, 0.0, 0.0])
    for t, q, qd in random_states(law, 20):
        output = law.update(t, q, qd, wrong)
        decay = -np.sum(K1 * output.bound ** 2 * output.e1 ** 2) - np.sum(K2 * output.e2 ** 2)
        expected = decay + output.adaptation_term @ (wrong - THETA)  # (58)
        assert lyapunov_rate(law, wrong, t, q, qd) == pytest.approx(expected, rel=1e-4, abs=1e-5)


def test_lyapunov_function_is_barrier_plus_kinetic_energy_of_e2():
    law = controller()
    for t, q, qd in random_states(law, 10):
        output = law.update(t, q, qd, THETA)
        e1, e2, b = output.e1, output.e2, output.bound
        p1, p2, p3 = THETA[:3]
        c2 = np.cos(q[1])
        mass = np.array([[p1 + 2 * p3 * c2, p2 + p3 * c2], [p2 + p3 * c2, p2]])
        expected = 0.5 * np.sum(e1 ** 2 / (b ** 2 - e1 ** 2)) + 0.5 * e2 @ mass @ e2
        assert law.lyapunov(q, output, THETA) == pytest.approx(expected, rel=1e-12)


def test_output_is_consistent_with_itself():
    law = controller()
    for t, q, qd in random_states(law, 10):
        output = law.update(t, q, qd, THETA)
        np.testing.assert_array_equal(output.e1, q - output.reference.position)
        np.testing.assert_allclose(output.adaptation_term, output.x.T @ output.e2)
        np.testing.assert_array_equal(output.bound, np.where(output.e1 > 0.0, UPPER, -LOWER))
        assert not output.saturated.any()


@pytest.mark.filterwarnings('ignore:.*encountered:RuntimeWarning')
@pytest.mark.parametrize('coupling', COUPLINGS)
@hypothesis.given(theta=st.lists(st.floats(), min_size=5, max_size=5), q=any_pair, qd=any_pair,
                  t=st.floats(0.0, 1e6))
def test_torque_is_finite_and_limited_for_any_state_and_estimate(coupling, theta, q, qd, t):
    output = controller(coupling, limit=50.0).update(t, np.array(q), np.array(qd), np.array(theta))
    assert np.isfinite(output.torque).all()
    assert np.all(np.abs(output.torque) <= 50.0)


def test_saturation_is_reported_joint_by_joint():
    law = controller(limit=20.0)
    q, qd = law.reference.at(0.0).position, law.reference.at(0.0).velocity
    output = law.update(0.0, q, qd + np.array([3.0, 0.0]), np.zeros(5))
    assert output.saturated.tolist() == [True, False]
    assert output.torque[0] == -20.0


def test_performance_set_that_pokes_out_is_refused_at_start_up():
    with pytest.raises(SetViolation, match="'joint1'.*below"):
        controller(widen=-0.01)


def test_a_start_outside_the_performance_set_is_refused():
    law = controller(widen=1.0)
    law.check_start(np.array([0.1, 2.1]))
    with pytest.raises(SetViolation, match=r"'joint2'.*performance set.*0\.25 .*0\.2 "):
        law.check_start(np.array([0.1, 2.25]))
    with pytest.raises(SetViolation, match="'joint1'.*safety set"):
        controller().check_start(np.array([1.3, 2.0]))


@pytest.mark.parametrize('name', ['k1', 'k2', 'torque_limit'])
@pytest.mark.parametrize('value', [0.0, -1.0, float('nan'), float('inf')])
def test_gains_are_positive_and_finite(name, value):
    gains = {'k1': K1, 'k2': K2, 'torque_limit': K2, name: np.array([1.0, value])}
    with pytest.raises(ParameterError, match=rf'controller\.{name}'):
        ControllerSettings(**gains)


def test_an_unknown_coupling_is_named():
    with pytest.raises(ParameterError, match=r"'smooth'.*per_joint.*pseudoinverse"):
        ControllerSettings(K1, K2, K2, 'smooth')


def test_sampling_number_tells_where_a_sampled_loop_turns_unstable():
    q = np.array([0.0, 1.0])
    mass = np.column_stack([ARM.Y1(q, unit) @ THETA for unit in np.eye(2)])
    for factor, stable in ((0.95, True), (1.05, False)):
        dt = factor * 2.0 / sampling_number(ARM, K2, q, THETA, 1.0)
        e2 = np.array([1e-3, -1e-3])
        for _ in range(500):  # e2⁺ = e2 − dt M⁻¹ k2 e2
            e2 = e2 - dt * np.linalg.solve(mass, K2 * e2)
        assert (np.abs(e2).max() < 1e-3) == stable


def test_sampling_number_of_a_model_without_inertia_is_not_a_number():
    assert np.isnan(sampling_number(ARM, K2, np.zeros(2), np.zeros(5), 1e-3))
