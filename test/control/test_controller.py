# SPDX-License-Identifier: Apache-2.0
"""Facts about the controller: the decay of (28)-(34) and (57)-(59), limits, start-up checks."""

from __future__ import annotations

import copy

import numpy as np
import pytest

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.control.constraints import Bounded
from adaptive_blf_control.control.control_output import ControlOutput
from adaptive_blf_control.control.controller import Controller
from adaptive_blf_control.control.reference import (
    Posture,
    Reference,
    ReferencePoint,
    SmoothStart,
    SumOfSinusoids,
)
from adaptive_blf_control.control.sets import JointInterval
from adaptive_blf_control.control.settings import ControllerSettings, COUPLINGS
from adaptive_blf_control.control.trajectory import JoinedReference, PointReference
from adaptive_blf_control.errors import ParameterError, SetViolation

hypothesis = pytest.importorskip('hypothesis')
st = hypothesis.strategies

ARM = TwoLinkArm()
THETA = ARM.nominal
DYNAMICS = ARM.dynamics(THETA)
K1, K2 = np.array([40.0, 30.0]), np.array([30.0, 40.0])
LOWER, UPPER = np.array([-0.17, -0.17]), np.array([0.2, 0.2])
any_pair = st.tuples(st.floats(), st.floats())
TASK = SumOfSinusoids(np.zeros(2), np.array([[1.0], [2.0]]), np.full((2, 1), 0.5),
                      np.array([[0.0], [np.pi / 2]]))


def settings(coupling: str = 'per_joint', limit: float = 1e9, rate: float = 1e15,
             ) -> ControllerSettings:
    return ControllerSettings(k1=K1, k2=K2, torque_limit=limit, torque_rate_limit=rate,
                              coupling=coupling)


def controller(coupling: str = 'per_joint', limit: float = 1e9, widen: float = 0.0,
               lower: np.ndarray = LOWER, upper: np.ndarray = UPPER, rate: float = 1e15,
               reference: Reference = TASK, **given) -> Controller:
    safety = JointInterval(np.array([-1.17, -2.17]) - widen, np.array([1.2, 2.2]) + widen,
                           'safety')
    return Controller(ARM, settings(coupling, limit, rate), safety,
                      JointInterval(lower, upper, 'performance'), reference, **given)


def first_answer(law: Controller, t: float, q: np.ndarray, qd: np.ndarray,
                 theta: np.ndarray) -> ControlOutput:
    """Answer as the first sample of a motion, without a trace in ``law``."""
    return copy.copy(law).update(t, q, qd, theta)


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
        tau = first_answer(law, time, state[:2], state[2:], theta).torque
        return np.concatenate([state[2:], DYNAMICS.acceleration(state[:2], state[2:], tau)])

    def value(step: float) -> float:
        s1 = slope(t, state)
        s2 = slope(t + step / 2, state + step / 2 * s1)
        s3 = slope(t + step / 2, state + step / 2 * s2)
        s4 = slope(t + step, state + step * s3)
        end = state + step / 6 * (s1 + 2 * s2 + 2 * s3 + s4)
        output = first_answer(law, t + step, end[:2], end[2:], theta)
        return law.lyapunov(output, THETA)

    state, h = np.concatenate([q, qd]), 1e-5
    return (value(h) - value(-h)) / (2 * h)


@pytest.mark.parametrize('coupling', COUPLINGS)
def test_known_parameters_make_the_lyapunov_function_decay_as_in_equation_34(coupling):
    law = controller(coupling)
    for t, q, qd in random_states(law):
        output = first_answer(law, t, q, qd, THETA)
        expected = -np.sum(K1 * output.bound ** 2 * output.e1 ** 2) - np.sum(K2 * output.e2 ** 2)
        assert lyapunov_rate(law, THETA, t, q, qd) == pytest.approx(expected, rel=1e-5, abs=1e-6)


@pytest.mark.parametrize('coupling', COUPLINGS)
def test_wrong_parameters_add_what_the_adaptation_term_takes_away(coupling):
    law, wrong = controller(coupling), np.array([0.0, 9.0, 6.0, 0.0, 0.0])
    for t, q, qd in random_states(law, 20):
        output = first_answer(law, t, q, qd, wrong)
        decay = -np.sum(K1 * output.bound ** 2 * output.e1 ** 2) - np.sum(K2 * output.e2 ** 2)
        expected = decay + output.adaptation_term @ (wrong - THETA)  # (58)
        assert lyapunov_rate(law, wrong, t, q, qd) == pytest.approx(expected, rel=1e-4, abs=1e-5)


def test_growing_bounds_only_add_to_the_decay_of_the_lyapunov_function():
    """V̇ = (34) − Σ b e1² ḃ/w²: what the barrier relaxes comes on top."""
    start, random, relaxed = np.array([1.15, -2.12]), np.random.default_rng(6), 0.0
    law = controller(reference=SmoothStart(TASK, 0.5, start))
    for _ in range(40):
        t = random.uniform(0.05, 0.45)
        point, bounds = law.reference.at(t), law.bounds(t)
        e1 = random.uniform(0.2, 0.8, 2) * np.where(random.random(2) < 0.5, bounds.lower,
                                                    bounds.upper)
        q, qd = point.position + e1, point.velocity + random.normal(size=2)
        output = first_answer(law, t, q, qd, THETA)
        b, e2 = output.bound, output.e2
        rate = np.where(output.e1 > 0.0, bounds.upper_rate, -bounds.lower_rate)
        extra = np.sum(b * e1 ** 2 * rate / (b ** 2 - e1 ** 2) ** 2)
        relaxed = max(relaxed, extra)
        expected = -np.sum(K1 * b ** 2 * e1 ** 2) - np.sum(K2 * e2 ** 2) - extra
        assert lyapunov_rate(law, THETA, t, q, qd) == pytest.approx(expected, rel=1e-4, abs=1e-5)
    assert relaxed > 1.0


def test_lyapunov_function_is_barrier_plus_kinetic_energy_of_e2():
    law = controller()
    for t, q, qd in random_states(law, 10):
        output = first_answer(law, t, q, qd, THETA)
        e1, e2, b = output.e1, output.e2, output.bound
        p1, p2, p3 = THETA[:3]
        c2 = np.cos(q[1])
        mass = np.array([[p1 + 2 * p3 * c2, p2 + p3 * c2], [p2 + p3 * c2, p2]])
        expected = 0.5 * np.sum(e1 ** 2 / (b ** 2 - e1 ** 2)) + 0.5 * e2 @ mass @ e2
        assert law.lyapunov(output, THETA) == pytest.approx(expected, rel=1e-12)


def test_output_is_consistent_with_itself():
    law = controller()
    for t, q, qd in random_states(law, 10):
        output = first_answer(law, t, q, qd, THETA)
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


@pytest.mark.filterwarnings('ignore:.*encountered:RuntimeWarning')
@pytest.mark.parametrize('coupling', COUPLINGS)
@hypothesis.given(samples=st.lists(st.tuples(
    any_pair, any_pair, st.lists(st.floats(), min_size=5, max_size=5),
    st.floats(-0.1, 1.0), st.floats(1e-3, 1e3)), min_size=2, max_size=6))
def test_torque_keeps_limit_and_rate_over_any_samples_and_live_limits(coupling, samples):
    law, rate, last, t = controller(coupling, limit=50.0, rate=2e3), 2e3, np.zeros(2), 0.0
    for k, (q, qd, theta, dt, limit) in enumerate(samples):
        law.retune(t, np.zeros(2), settings=settings(coupling, limit, rate))
        t += dt
        torque = law.update(t, np.array(q), np.array(qd), np.array(theta)).torque
        assert np.isfinite(torque).all()
        assert np.all(np.abs(torque) <= limit)
        reach = rate * (max(dt, 0.0) if k else 1e-3) * (1.0 + 1e-9) + 1e-9
        assert np.all(np.abs(torque - np.clip(last, -limit, limit)) <= reach)
        last = torque


def test_the_first_torque_of_a_motion_rises_from_zero_within_a_millisecond():
    law = controller(rate=2000.0)
    q, qd = TASK.at(0.0).position, TASK.at(0.0).velocity + np.array([3.0, 0.001])
    first = law.update(0.0, q, qd, np.zeros(5))
    assert first.torque[0] == -2.0
    assert first.saturated.tolist() == [True, False]
    assert law.update(0.004, q, qd, np.zeros(5)).torque[0] == -10.0
    assert law.update(0.004, q, -qd, np.zeros(5)).torque[0] == -10.0


def test_saturation_is_reported_joint_by_joint():
    law = controller(limit=20.0)
    q, qd = law.reference.at(0.0).position, law.reference.at(0.0).velocity
    output = law.update(0.0, q, qd + np.array([3.0, 0.0]), np.zeros(5))
    assert output.saturated.tolist() == [True, False]
    assert output.torque[0] == -20.0


def test_a_saturated_joint_does_not_wind_up_the_estimate():
    law, theta = controller(limit=20.0), np.zeros(5)
    q, qd = TASK.at(0.0).position, TASK.at(0.0).velocity
    down = law.update(0.0, q, qd + np.array([3.0, 0.1]), theta)  # e2 > 0 asks for ever less
    assert down.saturated.tolist() == [True, False]
    np.testing.assert_array_equal(down.adaptation_term, down.x[1] * down.e2[1])
    theta = np.array([0.0, 0.0, 0.0, 900.0, 0.0])  # X θ̂ is what saturates, e2 takes it back
    back = law.update(0.1, q, qd + np.array([0.2, 0.1]), theta)
    assert back.wanted[0] > 20.0
    np.testing.assert_allclose(back.adaptation_term, back.x.T @ back.e2, rtol=1e-12)


def test_performance_set_that_exceeds_is_refused_at_start_up():
    with pytest.raises(SetViolation, match="'joint1'.*below"):
        controller(widen=-0.01)


def test_a_start_outside_the_performance_set_is_refused():
    law = controller(widen=1.0)
    law.check_start(np.array([0.1, 2.1]))
    with pytest.raises(SetViolation, match=r"'joint2'.*performance set.*0\.25 .*0\.2 "):
        law.check_start(np.array([0.1, 2.25]))
    with pytest.raises(SetViolation, match="'joint1'.*safety set"):
        controller().check_start(np.array([1.3, 2.0]))


@pytest.mark.parametrize('name', ['k1', 'k2', 'torque_limit', 'torque_rate_limit'])
@pytest.mark.parametrize('value', [0.0, -1.0, float('nan'), float('inf')])
def test_gains_are_positive_and_finite(name, value):
    gains = {'k1': K1, 'k2': K2, 'torque_limit': K2, 'torque_rate_limit': K2,
             name: np.array([1.0, value])}
    with pytest.raises(ParameterError, match=rf'controller\.{name}'):
        ControllerSettings(**gains)


def test_an_unknown_coupling_is_named():
    with pytest.raises(ParameterError, match=r"'smooth'.*per_joint.*pseudoinverse"):
        ControllerSettings(coupling='smooth')


@pytest.mark.parametrize('start', [[1.199, -2.169], [-1.16999, 2.19999], [0.3, 1.7]])
def test_a_smooth_start_is_possible_anywhere_inside_the_safety_set(start):
    posture = np.array(start)
    law = controller(reference=SmoothStart(TASK, 2.0, posture))
    law.check_start(posture)
    output = law.update(0.0, posture, np.zeros(2), THETA)
    assert not output.e1.any()
    margins = law.margins(output)
    np.testing.assert_allclose(margins[:2], law.safety.margin(posture))
    np.testing.assert_allclose(margins[2:], np.minimum(margins[:2], -LOWER), atol=1e-15)


@pytest.mark.parametrize(('start', 'joint', 'bound'), [
    ([1.2, 0.0], 'joint1', 1.2), ([0.0, -2.5], 'joint2', -2.17)])
def test_a_smooth_start_outside_the_safety_set_is_refused(start, joint, bound):
    with pytest.raises(SetViolation, match='start position outside the safety set') as caught:
        controller(reference=SmoothStart(TASK, 2.0, np.array(start)))
    assert (caught.value.joint, caught.value.bound) == (joint, bound)


def test_margins_are_those_of_the_bounds_in_use_at_the_sample():
    law = controller(reference=SmoothStart(TASK, 2.0, np.array([1.15, 0.0])))
    for t, upper in ((0.0, 0.05), (1.0, 0.125), (2.0, 0.2), (9.0, 0.2)):
        position = law.reference.at(t).position + np.array([0.01, -0.02])
        output = first_answer(law, t, position, np.zeros(2), THETA)
        np.testing.assert_allclose(law.margins(output)[2:],
                                   [min(upper - 0.01, 0.18), 0.15])
        assert output.bound[0] == pytest.approx(upper)


OTHER = SumOfSinusoids(np.array([0.1, 0.2]), np.array([[0.5], [0.7]]), np.full((2, 1), 0.8),
                       np.zeros((2, 1)))


def test_a_tighter_safety_set_may_not_leave_the_present_error_outside_during_a_smooth_start():
    posture = np.array([0.5, 0.0])
    rest = SumOfSinusoids(np.zeros(2), np.zeros((2, 1)), np.ones((2, 1)), np.zeros((2, 1)))
    law = controller(reference=SmoothStart(rest, 2.0, posture))
    q = law.reference.at(1.0).position + np.array([0.12, 0.0])
    tight = JointInterval([-1.17, -2.17], [0.51, 2.2])
    with pytest.raises(SetViolation, match='present error outside') as caught:
        law.retune(1.0, q, safety=tight)
    assert (caught.value.joint, caught.value.value) == ('joint1', pytest.approx(0.12))
    assert caught.value.bound == pytest.approx(0.5 * (0.01 + 0.2))
    assert law.safety.upper[0] == 1.2
    law.retune(1.0, q - np.array([0.1, 0.0]), safety=tight)
    assert law.safety.upper[0] == 0.51


def test_a_wider_safety_set_is_taken_whatever_the_error():
    law = controller()
    outside = TASK.at(4.0).position + np.array([0.25, 0.0])
    law.retune(4.0, outside, safety=JointInterval([-1.5, -2.5], [1.5, 2.5]))
    assert law.safety.upper[0] == 1.5


def test_a_new_reference_is_joined_without_a_jump():
    law, t = controller(widen=1.0), 4.0
    before = law.reference.at(t)
    law.retune(t, before.position, reference=OTHER, blend_time=2.0)
    np.testing.assert_array_equal(law.reference.at(t), before)
    np.testing.assert_array_equal(law.reference.at(6.5), OTHER.at(6.5))
    law.retune(7.0, OTHER.at(7.0).position + 0.1, reference=TASK, blend_time=1.0)
    assert law.reference.before is OTHER


def test_a_reference_taken_at_once_needs_the_arm_close_to_it():
    law = controller()
    with pytest.raises(SetViolation, match='present error outside the new performance set'):
        law.retune(4.0, TASK.at(4.0).position, reference=OTHER)
    law.retune(4.0, OTHER.at(4.0).position, reference=OTHER)
    assert law.reference is OTHER


@pytest.mark.parametrize(('change', 'joint', 'value', 'bound', 'what'), [
    ({'safety': JointInterval([-1.2, -2.3], [1.3, 1.9])}, 'joint2', 2.2, 1.9, 'exceeds'),
    ({'safety': JointInterval([0.06, -2.3], [1.3, 2.3]), 'reference': OTHER,
      'performance': JointInterval([-0.01, -0.1], [0.1, 0.2])}, 'joint1', -0.41, 0.06,
     'exceeds'),
    ({'performance': JointInterval([-0.1, -0.1], [0.04, 0.1])}, 'joint1', 0.05, 0.04,
     'present error outside the new performance set'),
    ({'performance': JointInterval([-0.1, -0.1], [0.3, 0.1])}, 'joint1', 1.3, 1.2, 'exceeds'),
    ({'reference': SumOfSinusoids(np.zeros(2), np.full((2, 1), 1.1), np.ones((2, 1)),
                                  np.zeros((2, 1))), 'blend_time': 1.0}, 'joint1', -1.27, -1.17,
     'exceeds'),
])
def test_a_change_that_cannot_be_is_refused_whole(change, joint, value, bound, what):
    law = controller()
    q = TASK.at(1.0).position + np.array([0.05, -0.05])
    before = dict(law.__dict__)
    with pytest.raises(SetViolation, match=what) as caught:
        law.retune(1.0, q, settings=settings(limit=1.0), **change)
    assert caught.value.joint == joint
    assert caught.value.value == pytest.approx(value)
    assert caught.value.bound == bound
    assert all(law.__dict__[name] is value for name, value in before.items())


def test_a_new_safety_set_has_to_hold_the_present_position():
    small = SumOfSinusoids(np.zeros(2), np.full((2, 1), 0.1), np.ones((2, 1)), np.zeros((2, 1)))
    law = controller(reference=small)
    tight = JointInterval(np.full(2, -0.31), np.full(2, 0.31), 'safety')
    with pytest.raises(SetViolation, match="'joint2': present position outside the new safety"):
        law.retune(0.0, np.array([0.0, 0.32]), safety=tight)
    law.retune(0.0, np.array([0.0, 0.29]), safety=tight)
    assert law.safety is tight


def test_gains_are_taken_whatever_the_state():
    law, new = controller(), settings(limit=3.0)
    law.retune(1.0, np.full(2, 99.0), settings=new)
    assert law.settings == new.resolved(joints=2)
    output = law.update(1.0, np.zeros(2), np.zeros(2), np.full(5, 50.0))
    assert np.abs(output.torque).max() == 3.0


def test_retuning_with_nothing_new_changes_no_bit():
    plain, other = controller(), controller()
    for k in range(20):
        t = 1e-3 * k
        q, qd = TASK.at(t).position + 0.05, TASK.at(t).velocity
        outputs = [law.update(t, q, qd, THETA) for law in (plain, other)]
        np.testing.assert_array_equal(outputs[0].torque, outputs[1].torque)
        other.retune(t, q, settings=settings(), safety=other.safety,
                     performance=other.performance)


@hypothesis.given(part=st.floats(0.001, 0.999), start=st.floats(-1.16, 1.19),
                  when=st.floats(0.0, 2.5), blend=st.just(0.0) | st.floats(1e-9, 3.0),
                  later=st.floats(0.0, 4.0), tight=st.booleans())
def test_reference_and_bounds_stay_inside_the_safety_set_after_any_accepted_change(
        part, start, when, blend, later, tight):
    law = controller(reference=SmoothStart(TASK, 2.0, np.array([start, 2.2 - 4.37 * part])))
    narrow = JointInterval(0.5 * LOWER, 0.5 * UPPER, 'performance')
    q = law.reference.at(when).position
    law.retune(when, q, performance=narrow if tight else None)
    try:
        law.retune(when, q, reference=OTHER, blend_time=blend)
    except SetViolation:
        assert blend == 0.0
    t = when + later
    bounds, position = law.bounds(t), law.reference.at(t).position
    assert np.all(position + bounds.upper <= law.safety.upper + 1e-12)
    assert np.all(position + bounds.lower >= law.safety.lower - 1e-12)
    if tight:
        assert np.all(bounds.upper <= narrow.upper)
        assert np.all(bounds.lower >= narrow.lower)


def test_a_safety_set_without_the_posture_of_the_start_under_way_is_refused():
    law = controller(reference=SmoothStart(TASK, 2.0, np.array([1.19, 0.0])), widen=0.0)
    wide = JointInterval(np.array([-2.0, -3.0]), np.array([1.185, 3.0]), 'safety')
    narrow = JointInterval(np.full(2, -0.1), np.full(2, 0.1), 'performance')
    q = law.reference.at(1.0).position
    with pytest.raises(SetViolation, match="'joint1': start position outside the safety set"):
        law.retune(1.0, q, safety=wide, performance=narrow)
    law.retune(2.0, law.reference.at(2.0).position, safety=wide, performance=narrow)


def test_a_trajectory_is_followed_and_can_be_left_again():
    law, t = controller(), 4.0
    now = law.reference.at(t + 0.1)
    end = TASK.at(0.0)._replace(velocity=np.zeros(2), acceleration=np.zeros(2))
    law.retune(t, law.reference.at(t).position,
               reference=JoinedReference(law.reference, t + 0.1, PointReference([0.0, 8.0],
                                                                                [now, end])))
    np.testing.assert_array_equal(law.reference.at(t), TASK.at(t))
    np.testing.assert_allclose(law.reference.at(12.1).position, end.position)
    law.retune(13.0, end.position, reference=TASK, blend_time=1.0)
    np.testing.assert_allclose(law.reference.at(13.0).position, end.position)
    np.testing.assert_array_equal(law.reference.at(14.0), TASK.at(14.0))


def test_outside_a_set_what_leads_back_is_accepted_and_what_leads_on_is_not():
    law, t = controller(), 4.0
    error = np.array([law.performance.upper[0] + 0.1, 0.0])  # outside above
    q = law.reference.at(t).position + error
    away = law.reference.at(t).position - 0.05
    with pytest.raises(SetViolation, match='present error outside'):
        law.retune(t, q, reference=Posture(away))
    law.retune(t, q, reference=TASK, blend_time=1.0)  # the error stays, and the way is calm
    nearer = law.reference.at(t).position + 0.05
    law.retune(t, q, reference=Posture(nearer))


def test_warming_up_leaves_no_trace():
    law = controller(reference=SmoothStart(TASK, 2.0, np.array([1.1, 0.0])))
    before = dict(law.__dict__)
    law.warm_up(THETA)
    assert all(law.__dict__[name] is value for name, value in before.items())


def test_nothing_is_compiled_anew_in_the_course_of_a_motion():
    numba = pytest.importorskip('numba')
    law = controller(reference=SmoothStart(TASK, 2.0, np.array([1.1, 0.0])))
    before = [numba.typeof((*law.reference.at(t), *law.bounds(t))) for t in (0.0, 1.0, 2.0, 3.0)]
    law.retune(3.0, law.reference.at(3.0).position, reference=OTHER, blend_time=2.0,
               performance=JointInterval(0.5 * LOWER, 0.5 * UPPER))
    after = [numba.typeof((*law.reference.at(t), *law.bounds(t))) for t in (3.0, 4.0, 6.0)]
    assert len({*before, *after}) == 1


@pytest.mark.parametrize('blend', [-1.0, float('nan'), float('inf')])
def test_a_blend_time_that_is_none_is_named(blend):
    law = controller(widen=1.0)
    with pytest.raises(ParameterError, match='blend_time'):
        law.retune(0.0, TASK.at(0.0).position, reference=OTHER, blend_time=blend)


@pytest.mark.parametrize(('settings', 'message'), [
    ({'safety.lower': [1.0], 'safety.upper': [1.0]},
     r"'controller\.safety\.lower' is \[1\.0\].*below controller\.safety\.upper = \[1\.0\] rad"),
    ({'safety.lower': [0.0, 2.0], 'safety.upper': [1.0]}, r'controller\.safety\.lower'),
    ({'performance.lower': [0.0]}, r"'controller\.performance\.lower'.*lower < 0 < upper"),
    ({'performance.upper': [-0.1]}, r"'controller\.performance\.upper'.*lower < 0 < upper"),
    ({'constraints': ['', 'velocity']}, "module:name each, not 'velocity'")])
def test_settings_that_do_not_fit_each_other_are_refused_when_they_are_made(settings, message):
    with pytest.raises(ParameterError, match=message):
        ControllerSettings().replace(**settings)


class PushingFilter:
    """A safety filter that asks for as much as it is allowed, and notes what that is."""

    def __init__(self, arm, settings):
        self.allowed = []

    def filtered(self, sample):
        self.allowed.append((sample.least.copy(), sample.most.copy()))
        return sample.most.copy()


def test_a_safety_filter_stays_within_limit_and_rate_from_what_it_let_through(monkeypatch):
    monkeypatch.setattr('adaptive_blf_control.control.safety_filter.PushingFilter', PushingFilter,
                        raising=False)
    law = Controller(ARM, torque_limit=5.0, torque_rate_limit=500.0, k2=1.0,
                     safety={'lower': -2.0, 'upper': 2.0},
                     safety_filter='adaptive_blf_control.control.safety_filter:PushingFilter')
    torques = [law.update(k * 2e-3, [0.1, 0.1], [0.0, 0.0], np.zeros(5)).torque
               for k in range(8)]
    # Half of 1 N·m in the first interval, 1 ms, then 1 N·m in each of 2 ms, up to the limit.
    expected = np.minimum(0.5 + 1.0 * np.arange(8), 5.0)
    np.testing.assert_allclose(torques, np.column_stack([expected, expected]), rtol=1e-12)
    least, _ = law.safety_filter.allowed[-1]
    np.testing.assert_allclose(least, 4.0, rtol=1e-12)


class RetunedFilter(PushingFilter):
    """A safety filter that knows which one it goes on from."""

    def retuned(self, settings):
        other = RetunedFilter(None, settings)
        other.goes_on_from = self
        return other


def test_a_copy_that_is_retuned_goes_on_from_its_own_safety_filter(monkeypatch):
    monkeypatch.setattr('adaptive_blf_control.control.safety_filter.RetunedFilter', RetunedFilter,
                        raising=False)
    law = Controller(ARM, safety_filter='adaptive_blf_control.control.safety_filter:RetunedFilter')
    other = copy.copy(law)
    own = other.safety_filter
    other.retune(k2=5.0)
    assert own is not law.safety_filter
    assert other.safety_filter.goes_on_from is own


@pytest.mark.parametrize('smooth_start', [0.0, 1.0])
@pytest.mark.parametrize('place', range(4))
def test_no_number_is_answered_with_zero_torque(smooth_start, place):
    sample = [0.1, np.array([0.1, 0.0]), np.array([0.1, 0.0]), np.ones(5)]
    sample[place] = sample[place] * np.nan
    controller = Controller(ARM, start=[0.0, 0.0], reference={'smooth_start': smooth_start})
    np.testing.assert_array_equal(controller.update(*sample).torque, 0.0)


LIMITS = {'safety_filter': 'limits', 'torque_limit': 100.0, 'k2': [30.0, 10.0],
          'safety': {'lower': -1.0, 'upper': 1.0}, 'performance': {'lower': -0.1, 'upper': 0.1},
          'limits': {'velocity': 3.0, 'braking': 5.0}, 'start': [0.0, 0.0],
          'reference': {joint: {'amplitude': 0.3, 'frequency': 2.0} for joint in ARM.joints}}


def governed(**changes) -> Controller:
    """Return a controller with a safety filter and a reference governor."""
    return Controller(ARM, **{**LIMITS, **changes})


def moved(law: Controller, times: np.ndarray, q: np.ndarray,
          qd: np.ndarray) -> tuple[list[ControlOutput], np.ndarray, np.ndarray]:
    """Drive the arm from a state on; return the answers and the state it ends in."""
    outputs = []
    for t in times:
        outputs.append(law.update(t, q, qd, THETA))
        q, qd = DYNAMICS.advance(q, qd, outputs[-1].torque, 1e-3)
    return outputs, q, qd


@pytest.mark.parametrize('t', [np.nan, np.inf, -np.inf, 1e9, -1e9])
@pytest.mark.parametrize('changes', [
    {}, {'limits.govern': False}, {'loop.delay': 0.004}, {'safety_filter': 'none'}])
def test_no_time_makes_a_torque_that_is_no_number_or_ends_a_motion(changes, t):
    law = governed(**changes)
    times = 1e-3 * np.arange(300)
    times[100] = t
    outputs, _, _ = moved(law, times, np.zeros(2), np.zeros(2))
    torques = np.array([output.torque for output in outputs])
    assert np.isfinite(torques).all()
    assert (np.abs(torques) <= 100.0).all()
    if not np.isfinite(t):  # the torque stays, and the motion goes on
        np.testing.assert_array_equal(torques[100], torques[99])
        assert min(law.margins(output).min() for output in outputs) > 0.09


def test_a_governed_reference_goes_on_from_where_it_is_when_the_clock_is_set_back():
    law, times = governed(), 1e-3 * np.arange(600)
    _, q, qd = moved(law, times, np.zeros(2), np.zeros(2))
    before = law.path_time(times[-1])
    outputs, _, _ = moved(law, times, q, qd)
    assert min(law.margins(output).min() for output in outputs) > 0.09
    assert law.path_time(times[-1]) == pytest.approx(before + 0.599)
    assert max(abs(output.torque).max() for output in outputs) < 10.0
    assert any('went back from 0.599 to 0 s: begin(q, qd)' in note for note in law.notes)


@pytest.mark.parametrize('safety_filter', ['none', 'limits'])
def test_a_motion_that_is_begun_again_is_answered_as_the_first_one(safety_filter):
    law = governed(safety_filter=safety_filter)
    times = 1e-3 * np.arange(300)
    first, q, _ = moved(law, times, np.zeros(2), np.zeros(2))
    law.begin([0.0, 0.0])
    again, _, _ = moved(law, times, np.zeros(2), np.zeros(2))
    for output, other in zip(first, again):
        np.testing.assert_array_equal(output.torque, other.torque)
    assert not any('went back' in note for note in law.notes)


def test_a_motion_begins_with_what_was_retuned():
    law = governed()
    moved(law, 1e-3 * np.arange(10), np.zeros(2), np.zeros(2))
    law.retune(9e-3, [0.0, 0.0], k2=20.0, reference=Posture(np.array([0.05, 0.0])),
               performance=(-0.08, 0.08), blend_time=1.0)
    law.begin([0.01, 0.0])
    assert law.settings.k2.tolist() == [20.0, 20.0]
    assert law.performance.upper.tolist() == [0.08, 0.08]
    np.testing.assert_array_equal(law.reference.at(0.0).position, [0.01, 0.0])
    np.testing.assert_array_equal(law.reference.at(100.0).position, [0.05, 0.0])


def test_a_motion_that_would_begin_outside_leaves_the_present_one_as_it_is():
    law, twin = governed(), governed()
    with pytest.raises(SetViolation, match="joint 'joint2'"):
        law.begin([0.0, 1.5])
    for t in (0.0, 1e-3):
        np.testing.assert_array_equal(law.update(t, [0.01, 0.0], [0.0, 0.0], THETA).torque,
                                      twin.update(t, [0.01, 0.0], [0.0, 0.0], THETA).torque)


@pytest.mark.parametrize('place', range(1, 4))
@pytest.mark.parametrize('govern', [True, False])
def test_no_state_makes_a_filtered_torque_that_is_no_number(place, govern):
    law, torques = governed(**{'limits.govern': govern}), []
    for k in range(20):
        sample = [k * 1e-3, np.array([0.01, 0.0]), np.zeros(2), THETA]
        if k >= 10:
            sample[place] = sample[place] * np.nan
        torques.append(law.update(*sample).torque)
    assert np.isfinite(torques).all()


class _InPython:
    """Sinusoids that are asked one time after the other, as a plug-in's are."""

    def __init__(self, reference: Reference) -> None:
        self._reference = reference

    def at(self, t: float) -> ReferencePoint:
        return self._reference.at(t)

    def range(self) -> tuple[np.ndarray, np.ndarray]:
        return self._reference.range()


def test_one_call_for_all_answers_as_the_law_asked_with_reference_and_bounds():
    usual = controller(limit=50.0, rate=3e3)
    asked = controller(limit=50.0, rate=3e3, reference=_InPython(TASK))
    for k, (_, q, qd) in enumerate(random_states(usual)):
        outputs = [law.update(2e-3 * k, q, qd, THETA) for law in (usual, asked)]
        for name in ('torque', 'adaptation_term', 'e1', 'e2', 'x', 'bound', 'wanted'):
            np.testing.assert_array_equal(*(getattr(each, name) for each in outputs), name)
        for first, second in zip(*(each.reference for each in outputs)):
            np.testing.assert_array_equal(first, second)
        margins = usual.margins(outputs[0])
        np.testing.assert_array_equal(margins, asked.margins(outputs[1]))
        np.testing.assert_array_equal(margins, usual.constraints.margins(outputs[0].state))


def test_an_answer_stays_what_it_was_and_keeps_its_margins():
    law = controller()
    (_, q, qd), (_, other, _), *_ = random_states(law)
    output = law.update(0.0, q, qd, THETA)
    torque, margins = output.torque.copy(), law.margins(output)
    kept = margins.copy()
    law.update(1e-3, other, qd, THETA)
    np.testing.assert_array_equal(output.torque, torque)
    np.testing.assert_array_equal(margins, kept)
    np.testing.assert_array_equal(law.margins(output), kept)


class _SlowJoints:
    """A constraint that no answer in one call knows."""

    name, quantity, unit, recovery, bodies = 'pace', 'velocity', 'rad/s', 'slow', ARM.joints

    def bounded(self, state):
        return Bounded(state.qd, np.array([-2.0, -2.0]), np.array([2.0, 2.0]))


NOT_MEASURED = np.full(2, np.nan)
answered_by = pytest.mark.parametrize('law', [
    controller(limit=50.0, rate=3e3),
    controller(limit=50.0, rate=3e3, reference=_InPython(TASK)),
    controller(limit=50.0, rate=3e3, constraints=_SlowJoints())],
    ids=['in one call', 'in several', 'with a constraint of their own'])


@answered_by
def test_what_a_node_is_answered_is_what_a_program_gets(law):
    twin = copy.copy(law)
    for k, (_, q, qd) in enumerate(random_states(law)):
        answered = law.answer(2e-3 * k, q, qd, THETA, NOT_MEASURED)
        output = twin.update(2e-3 * k, q, qd, THETA)
        for name in ('torque', 'adaptation_term', 'e1', 'e2'):
            np.testing.assert_array_equal(getattr(answered, name), getattr(output, name), name)
        margins = twin.constraints.margins(output.state)
        np.testing.assert_array_equal(answered.margins, margins)
        np.testing.assert_array_equal(twin.margins(output), margins)
        assert answered.smallest == answered.margins.min()
        assert answered.t == output.state.t
        assert answered.output == output
        np.testing.assert_array_equal(answered.reference, output.reference)


@answered_by
def test_margins_that_are_not_known_are_no_margins(law):
    _, q, qd = next(random_states(law))
    assert np.isnan(law.answer(0.0, q * [1.0, np.nan], qd, THETA, NOT_MEASURED).smallest)


def test_margins_of_an_answer_are_those_to_the_sets_in_use_since():
    law = controller()
    output = law.update(0.0, *(next(random_states(law))[1:]), THETA)
    law.retune(0.0, output.state.q, safety=(-3.0, 3.0))
    np.testing.assert_array_equal(law.margins(output)[:2], 3.0 - np.abs(output.state.q))


def test_a_copied_controller_goes_on_by_itself_after_an_answer():
    law, twin = controller(rate=3e3), controller(rate=3e3)
    (_, q, qd), (_, other, _), *_ = random_states(law)
    for each in (law, twin):
        each.update(0.0, q, qd, THETA)
    for copied in (copy.copy(law), copy.deepcopy(law)):
        copied.update(1e-3, other, -qd, THETA)
    torques = [each.update(1e-3, q, qd, THETA).torque for each in (law, twin)]
    assert np.any(torques[0] != 0.0)
    np.testing.assert_array_equal(*torques)


def test_a_reference_in_python_follows_one_in_arrays_at_once():
    law = controller()
    _, q, qd = next(random_states(law))
    law.update(0.0, q, qd, THETA)
    held = Posture(np.array([0.1, -0.1]))
    law.follow(held)
    np.testing.assert_array_equal(law.update(1e-3, q, qd, THETA).e1, q - held.at(0.0).position)
    slower = SumOfSinusoids(np.zeros(2), np.array([[1.0], [2.0]]), np.full((2, 1), 0.3))
    law.follow(slower)
    np.testing.assert_array_equal(law.update(2.0, q, qd, THETA).e1, q - slower.at(2.0).position)


def test_one_call_is_for_bounds_at_rest():
    start = np.array([1.1, 2.1])  # nearer to the safety bound than the performance set is wide
    law = Controller(ARM, settings(), JointInterval(np.array([-1.17, -2.17]), UPPER + [1, 2]),
                     JointInterval(LOWER, UPPER), TASK, start=start,
                     **{'reference.smooth_start': 2.0})
    law.retune(0.1, start, reference=TASK, blend_time=0.5)  # over before the bounds have grown
    growing = law.bounds(1.0)
    assert np.any(growing.lower_rate != 0.0) or np.any(growing.upper_rate != 0.0)
    point = law.reference.at(1.0)
    output = law.update(1.0, point.position, point.velocity, THETA)
    for used, wanted in zip(output.bounds, growing):
        np.testing.assert_array_equal(used, wanted)
