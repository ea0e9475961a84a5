# SPDX-License-Identifier: Apache-2.0
"""Facts about the safety filter ``limits``: what is asked of the arm does not matter."""

from __future__ import annotations

from copy import copy

import numpy as np
import pytest

import adaptive_blf_control as blf
from adaptive_blf_control.control.safety_filter import FilterSample
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.limits.filter_step import ACTIVE, BRAKING, IDLE, SOFTENED
from adaptive_blf_control.limits.safety_filter import LimitsFilter

H = 1e-3
PRIOR = {'mass_error': 0.1, 'friction': [8.0, 2.0]}
TORQUE = np.array([60.0, 15.0])


def controller(**limits):
    settings = {'velocity': [1.5, 2.0], 'prior': PRIOR, **limits}
    return blf.Controller(blf.TwoLinkArm(), safety_filter='limits', limits=settings,
                          torque_limit=TORQUE, safety={'lower': -1.0, 'upper': 1.0},
                          performance={'lower': -0.1, 'upper': 0.1})


@pytest.fixture(scope='module')
def two_link():
    return controller().safety_filter


SECOND = np.array([0.546, 0.196, 0.242])  # part of the second link in p1, p2, p3 of the arm


def truths(arm, random, count):
    """Yield θ of the arms at the ends of the prior: masses of links 10 % off, friction or none."""
    for _ in range(count):
        first, second = random.choice([0.9, 1.1], 2)
        theta = arm.nominal.copy()
        theta[:3] = first * (arm.nominal[:3] - SECOND) + second * SECOND
        theta[3:] = random.choice([0.0, 1.0], 2) * PRIOR['friction']
        yield theta


def sample(filter_, q, qd, torque):
    return filter_.filtered(FilterSample(0.0, q, qd, torque, -TORQUE, TORQUE))


@pytest.mark.parametrize('policy', ['towards one side', 'random', 'switching'])
def test_a_joint_never_leaves_its_limits_whatever_torque_is_asked(two_link, policy):
    random, arm, limits = np.random.default_rng(3), blf.TwoLinkArm(), two_link.limits
    for theta in truths(arm, random, 2):
        truth = arm.dynamics(theta)
        q, qd = np.zeros(2), np.zeros(2)
        for k in range(1500):
            side = {'towards one side': np.ones(2), 'random': random.uniform(-1.0, 1.0, 2),
                    'switching': np.full(2, 1.0 if k // 400 % 2 else -1.0)}[policy]
            torque = sample(two_link, q, qd, TORQUE * side)
            assert (np.abs(torque) <= TORQUE).all()
            for _ in range(4):  # between the samples as well
                q, qd = truth.advance(q, qd, torque, H / 4)
                assert (q >= limits.lower).all()
                assert (q <= limits.upper).all()
                assert (np.abs(qd) <= limits.speed).all()


def test_with_a_reserve_of_torque_the_rows_of_the_joints_are_never_softened(two_link):
    random, limits = np.random.default_rng(4), two_link.limits
    seen = 0
    for _ in range(2000):
        q = random.uniform(limits.lower, limits.upper)
        qd = random.uniform(-1.0, 1.0, 2) * limits.speed
        stop = q + qd * np.abs(qd) / (2.0 * limits.braking)
        if (stop < limits.lower + 1e-4).any() or (stop > limits.upper - 1e-4).any():
            continue
        sample(two_link, q, qd, random.uniform(-2.0, 2.0, 2) * TORQUE)
        if (two_link.report.reserve >= 0.0).all():
            seen += two_link.report.kind == ACTIVE
            assert two_link.report.kind in (IDLE, ACTIVE)
    assert seen > 50


def test_what_cannot_be_kept_is_softened_within_the_torque_box_and_said(two_link):
    fast = copy(two_link)
    torque = sample(fast, np.zeros(2), np.array([9.0, -9.0]), np.zeros(2))  # six times too fast
    assert (np.abs(torque) <= TORQUE).all()
    assert (np.sign(torque) == [-1.0, 1.0]).all()  # it brakes as it can
    assert fast.report.kind == SOFTENED
    assert 'reserve of joint' in fast.complaint
    assert fast.status()['samples softened'] == two_link.counts[SOFTENED] + 1
    sample(fast, np.zeros(2), np.zeros(2), np.zeros(2))
    assert fast.complaint == ''


def test_no_torque_is_ever_not_finite(two_link):
    wrong = copy(two_link)
    for q, qd, torque in ((np.full(2, np.nan), np.zeros(2), np.zeros(2)),
                          (np.zeros(2), np.full(2, np.inf), np.zeros(2)),
                          (np.zeros(2), np.zeros(2), np.full(2, np.nan))):
        given = sample(wrong, q, qd, torque)
        assert np.isfinite(given).all()
        assert (np.abs(given) <= TORQUE).all()


def test_the_acceleration_of_every_arm_of_the_prior_is_within_the_bound(two_link):
    random, arm, limits = np.random.default_rng(5), blf.TwoLinkArm(), two_link.limits
    tightest = 0.0
    for theta in truths(arm, random, 300):
        truth = arm.dynamics(theta)
        q = random.uniform(limits.lower, limits.upper)
        qd = random.uniform(-1.0, 1.0, 2) * limits.speed
        torque = sample(two_link, q, qd, random.uniform(-1.0, 1.0, 2) * TORQUE)
        report = two_link.report
        unexplained = random.choice([-1.0, 1.0], 2) * 0.1
        for part in (0.0, 0.5, 1.0):
            later = truth.advance(q, qd, torque + unexplained, part * H) if part else (q, qd)
            off = np.abs(truth.acceleration(*later, torque + unexplained) - report.acceleration)
            assert (off <= report.error).all()
            tightest = max(tightest, (off / report.error).max())
    assert tightest > 0.3  # no empty promise


def test_the_bound_of_a_known_arm_is_what_holding_a_torque_changes():
    exact = controller(prior={'mass_error': 1e-6, 'unexplained': 1e-6}).safety_filter
    random, arm = np.random.default_rng(6), blf.TwoLinkArm()
    truth = arm.dynamics(arm.nominal)
    for _ in range(100):
        q, qd = random.uniform(-0.9, 0.9, 2), random.uniform(-1.5, 1.5, 2)
        torque = sample(exact, q, qd, random.uniform(-1.0, 1.0, 2) * TORQUE)
        report = exact.report
        off = [np.abs(truth.acceleration(*truth.advance(q, qd, torque, part * H), torque)
                      - report.acceleration) for part in (0.5, 1.0)]
        assert (np.array(off) <= 1.01 * report.error + 1e-3).all()
        assert (report.error < 1.0 + 0.1 * np.abs(report.acceleration)).all()


def test_a_torque_that_no_parameter_explains_is_within_the_bound_of_a_known_arm():
    beyond = np.array([2.0, 1.0])  # N·m
    exact = controller(prior={'mass_error': 1e-6, 'unexplained': beyond}).safety_filter
    random, arm = np.random.default_rng(7), blf.TwoLinkArm()
    truth = arm.dynamics(arm.nominal)
    for _ in range(100):
        q, qd = random.uniform(-0.9, 0.9, 2), random.uniform(-1.5, 1.5, 2)
        torque = sample(exact, q, qd, random.uniform(-1.0, 1.0, 2) * TORQUE)
        for sign in ([1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]):
            off = truth.acceleration(q, qd, torque + sign * beyond) - exact.report.acceleration
            assert (np.abs(off) <= exact.report.error + 1e-3).all()


def test_the_loop_is_the_same_bit_for_bit_while_nothing_is_near(repository):
    off = blf.simulate(repository / 'config' / 'two_link.yaml', 0.5)
    on = blf.simulate(repository / 'config' / 'two_link.yaml', 0.5, controller={
        'safety_filter': 'limits', 'limits': {'velocity': [50.0], 'prior': PRIOR}})
    assert on.loop.controller.safety_filter.counts[1:] == [0, 0, 0]
    assert off.in_python == ()
    for name in ('q', 'qd', 'torque', 'theta_hat', 'sigma_min'):
        np.testing.assert_array_equal(getattr(on, name), getattr(off, name))


def test_velocities_stay_within_their_limit_where_the_reference_asks_for_more(repository):
    run = blf.simulate(repository / 'config' / 'two_link.yaml', 2.0, controller={
        'safety_filter': 'limits',
        'limits': {'velocity': [0.4], 'prior': PRIOR, 'govern': False}}, arm_driver={
            'initial_velocity': [0.0]})
    counts = run.loop.controller.safety_filter.counts
    assert counts[ACTIVE] > 100
    assert counts[BRAKING:] == [0, 0]
    assert np.abs(run.qd).max() <= 0.4


def test_braking_that_the_torque_does_not_allow_is_refused_with_the_posture():
    with pytest.raises(ParameterError, match=r'limits.braking.*at q = .* joint 1 lacks'):
        controller(braking=[100.0, 100.0])


def test_a_velocity_limit_below_the_present_velocity_is_refused_with_numbers():
    motion = controller()
    motion.update(0.0, [0.0, 0.0], [0.5, 0.0], np.zeros(5))
    settings = motion.settings.replace(**{'limits.velocity': [0.4, 2.0]})
    with pytest.raises(ParameterError, match=r'limits.velocity.*0\.5 rad/s.*joint1'):
        motion.retune(0.0, [0.0, 0.0], settings=settings)
    assert motion.safety_filter.limits.speed[0] == 1.5


def test_a_live_change_goes_on_where_the_governor_is():
    motion = controller(velocity=[0.5, 0.5])
    swing = {'joint1': {'amplitude': [0.5], 'frequency': [3.0]}}
    motion.retune(0.0, [0.0, 0.0], reference=blf.Controller(
        blf.TwoLinkArm(), reference=swing).reference)
    truth, q, qd = blf.TwoLinkArm().dynamics(blf.TwoLinkArm().nominal), np.zeros(2), np.zeros(2)
    pace = motion.safety_filter.governor.pace
    for k in range(150):
        output = motion.update(k * H, q, qd, blf.TwoLinkArm().nominal)
        q, qd = truth.advance(q, qd, output.torque, H)
    assert 0.0 < pace.time < 0.145
    assert pace.time == motion.path_time(0.149)
    motion.retune(0.149, q, settings=motion.settings.replace(**{'limits.velocity': [0.6, 0.6]}))
    after = motion.safety_filter.governor.pace
    assert after is not pace
    assert (after.time, after.rate) == (pace.time, pace.rate)
    following = motion.update(0.15, q, qd, blf.TwoLinkArm().nominal)
    assert np.abs(following.reference.position - output.reference.position).max() < 2e-3


def test_a_copy_leaves_no_trace_in_the_governor():
    motion = controller()
    motion.update(0.0, [0.0, 0.0], [0.0, 0.0], np.zeros(5))
    other = copy(motion)
    for k in range(1, 5):
        other.update(k * H, [0.0, 0.0], [0.0, 0.0], np.zeros(5))
    assert motion.safety_filter.governor.pace.time == 0.0
    assert sum(motion.safety_filter.counts) == 1


def test_an_arm_without_a_velocity_limit_has_to_be_given_one():
    with pytest.raises(ParameterError, match='limits.velocity'):
        controller(velocity=[0.0])


def test_another_filter_can_be_named(monkeypatch):
    class Half:
        def __init__(self, arm, settings):
            pass

        def filtered(self, sample):
            return 0.5 * sample.torque

    monkeypatch.setattr('adaptive_blf_control.limits.safety_filter.Half', Half, raising=False)
    name = 'adaptive_blf_control.limits.safety_filter:Half'
    plain, half = blf.Controller(blf.TwoLinkArm()), blf.Controller(blf.TwoLinkArm(),
                                                                   safety_filter=name)
    given = [each.update(0.0, [0.1, 0.0], [0.0, 0.0], np.ones(5)) for each in (plain, half)]
    np.testing.assert_array_equal(given[1].torque, 0.5 * given[0].torque)
    assert half.arrays is None
    assert isinstance(LimitsFilter, type)


def test_a_torque_counts_as_held_for_as_long_as_the_one_before_was():
    q, qd, wanted = np.array([0.2, 0.0]), np.array([1.0, 0.0]), np.array([60.0, 0.0])
    answers = []
    for times in ((0.0, H), (0.0, 0.05), (0.0, 5.0)):  # as usual, late, after a gap
        filter_ = controller().safety_filter
        for t in times:
            torque = filter_.filtered(FilterSample(t, q, qd, wanted, -TORQUE, TORQUE))
        answers.append(torque)
    assert answers[1][0] < answers[0][0] - 1.0  # what is held for longer may be less
    np.testing.assert_array_equal(answers[2], answers[0])
