# SPDX-License-Identifier: Apache-2.0
"""Facts about the identifier: it converges, and nothing beyond reason gets into θ̂."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.arms.inverse_dynamics import inverse_dynamics
from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.identifier import Identifier
from adaptive_blf_control.identification.settings import IdentifierSettings

hypothesis = pytest.importorskip('hypothesis')
st = hypothesis.strategies


def named(**values):
    """Return values by parameter name; ``__`` stands for a dot."""
    return {name.replace('__', '.'): value for name, value in values.items()}


ARM = TwoLinkArm()
SETTINGS = IdentifierSettings.from_values(named(
    initial_estimate=np.array([0.0, 9.0, 6.0, 0.0, 0.0]), gamma=np.ones(5), kt=10.0, kh=10.0,
    filter__time_constant=0.001, filter__gap=0.05, filter__settle=0.0, history__size=7,
    history__epsilon=0.1, change__window=0.0, excitation__window=0.0))
STATE = np.array([0.1, 0.2]), np.array([0.3, -0.4]), np.array([1.0, 2.0])

pairs = st.tuples(st.floats(), st.floats())
wild_samples = st.tuples(st.floats(0.0, 0.03), pairs, pairs, pairs,
                           st.lists(st.floats(), min_size=5, max_size=5))


def identifier(**changes) -> Identifier:
    return Identifier(ARM, SETTINGS.replace(**named(**changes)))


def learned(samples, **changes) -> Identifier:
    result = identifier(**changes)
    for sample in samples:
        result.update(*sample)
    return result


def drops(**counts: int) -> dict[str, int]:
    return {'not finite': 0, 'too large': 0, 'stamp repeated': 0, 'stamp went back': 0, **counts}


def error_of(result: Identifier) -> float:
    return float(np.linalg.norm(result.theta - ARM.nominal))


@pytest.mark.parametrize('jitter', [0.0, 0.5])
def test_estimate_converges_to_the_true_parameters(record, jitter):
    result = learned(record(steps=1500, jitter=jitter), kt=100.0, kh=100.0)
    assert result.stack.rank == 5
    assert error_of(result) < 1e-3


def test_history_keeps_teaching_when_the_arm_stands_still(record):
    result = learned(record(steps=300))
    before, last = error_of(result), record(steps=300)[-1]
    for k in range(3000):
        result.update(last.t + 1.0 + k * 1e-3, last.q, np.zeros(2), np.zeros(2))
    assert error_of(result) < 0.1 * before


def test_learning_does_not_depend_on_when_the_clock_starts(record):
    late = learned([(s.t + 4096.0, *s[1:]) for s in record(steps=200)])
    np.testing.assert_allclose(late.theta, learned(record(steps=200)).theta, rtol=1e-6)


def test_adaptation_term_moves_the_estimate_against_its_sign():
    term = np.array([1.0, -2.0, 0.0, 0.5, 0.0])
    result = identifier(kt=0.0, kh=0.0)
    for k in range(3):
        result.update(k * 0.01, *STATE, term)
    np.testing.assert_allclose(result.theta, SETTINGS.initial_estimate - 0.02 * term)


def test_estimate_is_replaced_and_never_changed_in_place(record):
    result, seen = identifier(), []
    for sample in record(steps=20):
        theta = result.update(*sample)
        seen.append((theta, theta.copy()))
    for theta, copy in seen:
        np.testing.assert_array_equal(theta, copy)
    np.testing.assert_array_equal(SETTINGS.initial_estimate, [0.0, 9.0, 6.0, 0.0, 0.0])


def test_observing_does_not_learn(record):
    result, other = identifier(), identifier()
    for sample in record(steps=50):
        result.observe(*sample)
        other.update(*sample)
    np.testing.assert_array_equal(result.theta, SETTINGS.initial_estimate)
    assert result.stack.count == 0
    np.testing.assert_array_equal(result.pair[0], other.pair[0])


@pytest.mark.parametrize('bad', [float('nan'), float('inf'), -float('inf')])
@pytest.mark.parametrize('place', range(4))
def test_a_sample_that_is_not_finite_is_dropped_and_counted(record, bad, place):
    samples = list(record(steps=100))
    broken = [np.array(field, dtype=float) for field in samples[50]]
    broken[place] = np.full_like(broken[place], bad)
    without = learned(samples[:50] + samples[51:])
    got = learned(samples[:50] + [(float(broken[0]), *broken[1:])] + samples[51:])
    assert got.dropped == drops(**{'not finite': 1})
    np.testing.assert_array_equal(got.theta, without.theta)


def test_a_repeated_stamp_is_dropped_and_counted(record):
    samples = record(steps=100)
    got = learned([*samples[:50], samples[49], *samples[50:]])
    assert got.dropped == drops(**{'stamp repeated': 1})
    np.testing.assert_array_equal(got.theta, learned(samples).theta)


def test_a_stamp_that_goes_back_a_little_is_dropped_and_counted(record):
    samples = record(steps=100)
    got = learned([*samples[:50], samples[30], samples[47], *samples[50:]])
    assert got.dropped == drops(**{'stamp went back': 2})
    assert got.restarts == 1
    np.testing.assert_array_equal(got.theta, learned(samples).theta)


def test_a_clock_that_jumps_back_far_restarts_the_filter(record):
    samples = record(steps=300)
    got = learned([*samples[:200], *samples[:200]])
    assert sum(got.dropped.values()) == 0
    assert got.restarts == 2
    assert got.stack.insertions > learned(samples[:200]).stack.insertions - 1
    assert error_of(got) < error_of(learned(samples[:200]))


def test_a_gap_restarts_the_filter_and_keeps_what_was_learned(record):
    samples = record(steps=400)
    got = learned(samples[:200] + samples[300:])
    assert got.restarts == 2
    assert got.stack.insertions >= 7
    assert error_of(got) < error_of(learned(samples[:200]))


def test_restarting_by_hand_forgets_the_filter_only(record):
    result = learned(record(steps=100))
    theta, count = result.theta, result.stack.count
    result.restart()
    np.testing.assert_array_equal(result.update(0.0, *STATE), theta)
    assert not result.pair[0].any()
    assert result.stack.count == count
    assert sum(result.dropped.values()) == 0


def test_resetting_the_history_keeps_the_estimate(record):
    result = learned(record(steps=100))
    theta = result.theta
    result.reset_history()
    assert (result.stack.count, result.stack.rank) == (0, 0)
    assert result.theta is theta


def test_resetting_the_history_begins_the_mean_of_the_monitor_again(record):
    result = Identifier(TwoLinkArm(), history={'size': 10}, filter={'settle': 0.0},
                        change={'window': 0.1, 'resolution': 0.0})
    for t, q, qd, tau in record(steps=400):
        result.update(t, q, qd, tau * 1.01 ** (t > 0.3))
    assert result.monitor.statistic.any()
    result.reset_history()
    assert not result.monitor.statistic.any()


def test_nothing_is_learned_until_the_filter_has_settled(record):
    result = identifier(filter__settle=20.0)  # of 1 ms
    for sample in record(steps=30):
        result.update(*sample)
        assert result.settled == (sample.t >= 0.02 - 1e-9)
        assert (result.stack.count > 0) == result.settled
        assert np.array_equal(result.theta, SETTINGS.initial_estimate) != result.settled


def test_settling_begins_again_after_a_gap(record):
    samples = record(steps=400)
    result = learned(samples[:100], filter__settle=20.0)
    count = result.stack.insertions
    for sample in samples[200:220]:
        result.update(*sample)
        assert not result.settled
    assert result.stack.insertions == count


@pytest.mark.filterwarnings('ignore:.*encountered:RuntimeWarning')
@pytest.mark.parametrize('bad', [float('nan'), float('inf'), -1e308])
def test_an_adaptation_term_that_is_not_finite_or_overflows_is_dropped_and_counted(record, bad):
    result, samples = identifier(gamma=np.full(5, 1e9)), record(steps=20)
    for sample in samples[:10]:
        result.update(*sample, np.zeros(5))
    theta = result.theta
    other = result.update(*samples[10], np.array([0.0, 0.0, bad, 0.0, 0.0]))
    np.testing.assert_array_equal(other, theta)
    assert result.dropped == drops(**{'not finite': 1})
    assert result.update(*samples[11], np.zeros(5)) is not theta


@pytest.mark.filterwarnings('ignore:.*encountered:RuntimeWarning')
@hypothesis.settings(max_examples=150)
@hypothesis.given(st.lists(wild_samples, max_size=12))
def test_estimate_stays_finite_and_the_identifier_recovers_from_wild_data(steps):
    result, t = identifier(history__size=5, history__epsilon=0.0), 0.0
    for dt, q, qd, tau, term in steps:
        t += dt
        theta = result.update(t, np.array(q), np.array(qd), np.array(tau), np.array(term))
        assert np.isfinite(theta).all()
        assert np.isfinite(result.pair[0]).all()
        assert np.isfinite(result.stack.gram).all()
        assert np.isfinite(result.stack.sigma_min)
    for k in range(3):
        result.update(t + 1.0 + k * 1e-3, *STATE)
    assert result.pair[0].any()  # the filter runs again


@pytest.mark.filterwarnings('ignore:.*encountered:RuntimeWarning')
@pytest.mark.parametrize('glitch', [1e4, 1e10, 1e30, 1e80, 1e200, 1e308])
def test_one_wild_velocity_does_not_end_the_learning(record, glitch):
    samples = list(record(steps=1500))
    samples[60] = samples[60]._replace(qd=np.array([glitch, -glitch]))
    result = learned(samples, kt=100.0, kh=100.0)
    assert result.dropped['too large'] in (1, 2)  # the sample, and the one after a restart
    assert error_of(result) < 1e-3


@pytest.mark.parametrize(('name', 'value'), [
    ('kt', -1.0), ('kt', float('nan')), ('kh', float('inf')), ('filter__settle', -0.1),
    ('gamma', np.zeros(5)), ('gamma', np.full(5, float('nan'))), ('gamma', np.full(5, np.inf)),
    ('initial_estimate', np.full(5, float('inf')))])
def test_settings_are_checked_by_name(name, value):
    name = name.replace('__', '.')
    with pytest.raises(ParameterError, match=rf'identifier\.{name}'):
        SETTINGS.replace(**{name: value})


def test_nothing_is_recorded_while_present_data_contradict_the_recorded_pairs():
    arm, random = TwoLinkArm(), np.random.default_rng(8)
    t, w = 1e-3 * np.arange(3500), np.array([3.1, 4.7])
    q, qd, qdd = (part * np.sin(np.outer(t, w) + phase) for part, phase in (
        (0.8, 0.0), (0.8 * w, 0.5 * np.pi), (0.8 * w ** 2, np.pi)))
    other = arm.nominal * [3.0, 3.0, 3.0, 1.0, 1.0]
    tau = np.where((t > 2.5)[:, None], inverse_dynamics(arm, other, q, qd, qdd),
                   inverse_dynamics(arm, arm.nominal, q, qd, qdd))
    tau += 0.02 * random.normal(size=tau.shape)
    identifier = Identifier(arm, history={'size': 30}, filter={'time_constant': 0.03},
                            change={'suspicion': 2.0, 'window': 0.1, 'patience': 5.0})
    contradicted = 0
    for k in range(t.size):
        before = identifier.stack.insertions
        identifier.update(t[k], q[k], qd[k], tau[k])
        if identifier.response in ('doubt', 'held'):
            contradicted += t[k] > 2.5
            assert identifier.stack.insertions == before
    assert contradicted > 200
    assert identifier.found['alarms'] == 1


def test_a_huge_torque_beside_a_normal_motion_is_dropped_and_the_estimate_stays(record):
    samples = list(record(steps=101))
    result = learned(samples[:100])
    theta, (t, q, qd, tau) = result.theta, samples[100]
    result.update(t, q, qd, tau + 1e9)
    assert result.dropped == drops(**{'too large': 1})
    assert result.theta is theta


def test_take_gives_the_estimate_of_update_in_an_array_that_the_next_sample_changes():
    random = np.random.default_rng(3)
    asked, taken = (Identifier(ARM, history={'size': 10}, filter={'settle': 0.0})
                    for _ in range(2))
    places = []
    for k in range(30):
        q, qd, tau = random.normal(size=(3, ARM.n))
        term = random.normal(size=ARM.m)
        theta = asked.update(1e-3 * k, q, qd, tau, term)
        places.append(taken.take(1e-3 * k, q, qd, tau, term))
        assert places[-1].tobytes() == theta.tobytes()
    assert all(place is places[0] for place in places)
    assert np.any(places[0])
    assert taken.take(1.0, q, qd, tau, None).tobytes() == asked.update(1.0, q, qd, tau).tobytes()
