# SPDX-License-Identifier: Apache-2.0
"""Facts about changing the identifier between two samples: all or nothing, and nothing is lost."""

from __future__ import annotations

import dataclasses
import os
import subprocess
import sys

import numpy as np
import pytest

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.compiled import COMPILED
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.identifier import Identifier
from adaptive_blf_control.identification.settings import IdentifierSettings
from adaptive_blf_control.identification.stack_arrays import SIZE, THRESHOLD


def named(**values):
    """Return values by parameter name; ``__`` stands for a dot."""
    return {name.replace('__', '.'): value for name, value in values.items()}


ARM = TwoLinkArm()
SETTINGS = IdentifierSettings.from_values(named(
    initial_estimate=np.array([0.0, 9.0, 6.0, 0.0, 0.0]), gamma=np.ones(5), kt=10.0, kh=10.0,
    filter__time_constant=0.001, filter__gap=0.05, filter__settle=0.0, history__size=7,
    history__epsilon=0.1, change__window=0.1, excitation__window=0.1))

LIVE = {
    'filter__effort': 'instant',
    'gamma': np.full(5, 2.0), 'kt': 3.0, 'kh': 4.0, 'update_law': 'concurrent',
    'filter__time_constant': 0.004, 'filter__gap': 0.02, 'filter__settle': 2.0,
    'filter__state_order': 2, 'filter__state_time_constant': 0.01, 'history__size': 12,
    'history__epsilon': 0.3, 'history__minimum_growth': 0.5, 'change__window': 0.3,
    'change__threshold': 9.0, 'change__resolution': 0.1, 'excitation__window': 0.2,
    'history__noise': 0.1, 'history__noise_seed': 3, 'change__suspicion': 4.0,
    'change__settle': 2.0, 'change__patience': 1.0, 'change__adapt': True, 'known_contact': True,
    'position_limit_margin': 0.1, 'filter__distortion': 0.02}
BAD = {
    'gamma': np.ones(4), 'kt': -1.0, 'update_law': 'guess', 'filter__time_constant': 0.0,
    'filter__gap': float('nan'), 'filter__settle': float('inf'), 'filter__state_order': 1,
    'history__size': 0, 'history__epsilon': 1.5, 'history__minimum_growth': -1.0,
    'change__window': -0.1, 'change__threshold': 1.0, 'change__resolution': float('inf'),
    'excitation__window': float('inf'), 'history__noise': -0.1, 'change__suspicion': 30.0,
    'change__settle': -1.0, 'change__patience': 0.0, 'position_limit_margin': float('nan'),
    'filter__distortion': -0.1}


def identifier(**changes) -> Identifier:
    return Identifier(ARM, SETTINGS.replace(**named(**changes)))


def learn(subject: Identifier, samples) -> Identifier:
    for sample in samples:
        subject.update(*sample)
    return subject


def retune(subject: Identifier, **changes) -> None:
    subject.retune(subject.settings.replace(**named(**changes)))


def assert_same(first: Identifier, second: Identifier) -> None:
    np.testing.assert_array_equal(first.theta, second.theta)
    np.testing.assert_array_equal(first.stack.regressors, second.stack.regressors)
    np.testing.assert_array_equal(first.pair[0], second.pair[0])
    np.testing.assert_array_equal(first.monitor.statistic, second.monitor.statistic)
    assert first.excitation == second.excitation
    assert first.restarts == second.restarts


def poor(subject: Identifier, steps: int, start: int = 0) -> None:
    """One joint moves at a steady pace: the rank stays below 5."""
    for k in range(start, start + steps):
        subject.update(k * 1e-3, np.array([k * 1e-3, 0.2]), np.array([1.0 + 0.01 * k, 0.0]),
                       np.array([1.0, 2.0]))


def test_every_setting_that_may_change_is_in_the_list():
    assert set(named(**LIVE)) == {parameter.name for parameter in IdentifierSettings.table()
                                  if not parameter.read_only}


@pytest.mark.parametrize('name', LIVE)
def test_a_change_loses_neither_the_estimate_nor_a_pair(record, name):
    subject = learn(identifier(), record(steps=300)[:200])
    theta, pairs, restarts = subject.theta, subject.stack.regressors[:7].copy(), subject.restarts
    retune(subject, **{name: LIVE[name]})
    np.testing.assert_array_equal(subject.settings.values()[name.replace('__', '.')], LIVE[name])
    assert subject.theta is theta
    np.testing.assert_array_equal(subject.stack.regressors[:7], pairs)
    learn(subject, record(steps=300)[200:])
    assert subject.restarts == restarts + name.startswith('filter__state')
    assert sum(subject.dropped.values()) == 0


@pytest.mark.parametrize('name', sorted(
    set(LIVE) - {'history__noise_seed', 'filter__state_time_constant'}))
def test_a_changed_setting_is_that_of_an_identifier_that_always_had_it(record, name):
    base = {'filter__settle': 1.0, 'filter__gap': 0.02} if name == 'filter__gap' else {}
    samples = [sample for k, sample in enumerate(record(steps=300))
               if not (name == 'filter__gap' and 150 <= k < 180)]
    subject = identifier(**base, **({} if name == 'filter__gap' else {name: LIVE[name]}))
    always = learn(identifier(**{**base, name: LIVE[name]}), samples)
    if name == 'filter__gap':
        subject = learn(identifier(filter__settle=1.0), samples[:100])
    else:
        subject = identifier()
    retune(subject, **{name: LIVE[name]})
    learn(subject, samples[100:] if name == 'filter__gap' else samples)
    assert_same(subject, always)


@pytest.mark.parametrize('name', BAD)
def test_a_value_that_is_refused_changes_nothing_of_the_others(record, name):
    samples = record(steps=300)
    subject, untouched = (learn(identifier(), samples[:200]) for _ in range(2))
    with pytest.raises(ParameterError):
        retune(subject, **{**LIVE, name: BAD[name]})
    assert subject.settings is not None
    for field in dataclasses.fields(IdentifierSettings):
        np.testing.assert_array_equal(getattr(subject.settings, field.name),
                                      getattr(SETTINGS, field.name))
    assert_same(learn(subject, samples[200:]), learn(untouched, samples[200:]))


def test_the_same_settings_again_change_nothing(record):
    samples = record(steps=300)
    subject, untouched = (identifier(filter__state_order=2, history__noise=0.1)
                          for _ in range(2))
    for sample in samples:
        retune(subject)
        assert_same(learn(subject, [sample]), learn(untouched, [sample]))


def test_where_the_estimate_started_is_history(record):
    subject = learn(identifier(), record(steps=50))
    theta = subject.theta
    retune(subject, initial_estimate=np.ones(5), kt=2.0)
    assert subject.settings.kt == 2.0
    np.testing.assert_array_equal(subject.settings.initial_estimate, SETTINGS.initial_estimate)
    assert subject.theta is theta


def test_settings_cannot_be_assigned():
    with pytest.raises(AttributeError):
        identifier().settings = SETTINGS


def test_filtered_regressor_times_parameters_stays_the_filtered_torque_through_a_change():
    # Torques that satisfy the sampled equation exactly, so that only rounding is left.
    random, subject, last = np.random.default_rng(3), identifier(), None
    t, largest = 0.0, 0.0
    for k in range(400):
        if k % 50 == 25:
            retune(subject, filter__time_constant=float(10.0 ** random.uniform(-4.0, 0.0)))
        t += 1e-3 * random.uniform(0.5, 1.5)
        q, qd = np.sin([9.0 * t, 7.0 * t]), np.array([9.0, 7.0]) * np.cos([9.0 * t, 7.0 * t])
        y1, y2 = ARM.Y12(q, qd)
        tau = np.zeros(2) if last is None else (
            (y1 - last[1]) / (t - last[0]) + 0.5 * (y2 + last[2])) @ ARM.nominal
        subject.observe(t, q, qd, tau)
        last = t, y1, y2
        regressor, torque = subject.pair
        np.testing.assert_allclose(regressor @ ARM.nominal, torque, rtol=0.0, atol=1e-11)
        largest = max(largest, float(np.abs(torque).max()))
    assert subject.restarts == 1
    assert largest > 10.0


def test_another_state_filter_restarts_both_filters(record):
    samples = record(steps=300)
    subject = learn(identifier(filter__settle=5.0), samples[:200])
    insertions = subject.stack.insertions
    retune(subject, filter__state_order=2, filter__state_time_constant=0.002)
    assert not subject.pair[0].any()
    fresh = learn(identifier(filter__state_order=2, filter__state_time_constant=0.002,
                             filter__settle=5.0), samples[200:])
    for sample in samples[200:]:
        subject.update(*sample)
        assert (subject.settled, fresh.settled) == (sample.t > 0.2 + 0.025 - 1e-9, True)
        assert subject.settled or subject.stack.insertions == insertions
    assert subject.stack.insertions > insertions
    np.testing.assert_array_equal(subject.pair[0], fresh.pair[0])


def test_the_state_filter_can_be_switched_off(record):
    samples = record(steps=300)
    subject = learn(identifier(filter__state_order=2), samples[:200])
    retune(subject, filter__state_order=0)
    np.testing.assert_array_equal(learn(subject, samples[200:]).pair[0],
                                  learn(identifier(), samples[200:]).pair[0])


def test_a_longer_memory_has_to_settle_first(record):
    subject = learn(identifier(filter__settle=5.0), record(steps=20))
    assert subject.settled
    retune(subject, filter__time_constant=0.01)
    assert not subject.settled


def test_a_smaller_history_is_reached_sample_by_sample(record):
    samples = record(steps=300)
    subject = learn(identifier(history__size=20), samples[:200])
    assert subject.stack.count == 20
    retune(subject, history__size=8)
    counts = []
    for sample in samples[200:220]:
        subject.update(*sample)
        counts.append(subject.stack.count)
    assert counts == [*range(19, 7, -1), *[8] * 8]
    assert subject.stack.rank == 5


def test_the_change_monitor_goes_on_while_pairs_leave(record):
    samples = record(steps=400)
    subject = learn(identifier(history__size=20), samples[:200])
    retune(subject, history__size=8)
    before = subject.monitor.statistic
    learn(subject, samples[200:212])
    assert subject.stack.count == 8
    assert not np.array_equal(subject.monitor.statistic, before)
    learn(subject, samples[212:])
    assert (subject.changes, subject.stack.count) == (0, 8)


def test_the_mean_of_the_change_monitor_survives_all_but_another_window(record):
    subject = learn(identifier(), record(steps=200))
    statistic = subject.monitor.statistic
    assert statistic.any()
    retune(subject, change__threshold=9.0, change__resolution=0.02)
    np.testing.assert_array_equal(subject.monitor.statistic, statistic)
    retune(subject, change__window=0.2)
    assert not subject.monitor.statistic.any()


def test_the_excitation_index_restarts_with_another_window_only(record):
    subject = learn(identifier(), record(steps=200))
    index = subject.excitation
    assert index > 0.0
    retune(subject, kt=1.0)
    assert subject.excitation == index
    retune(subject, excitation__window=0.2)
    assert subject.excitation == 0.0
    retune(subject, excitation__window=0.0)
    assert subject.excitation is None


def test_noise_can_be_switched_on_while_rank_lacks_and_off_again():
    subject = identifier()
    poor(subject, 100)
    retune(subject, history__noise=0.1)
    assert not subject.artificial_noise
    subject.restart()
    poor(subject, 100, start=100)
    assert subject.artificial_noise
    retune(subject, history__noise=0.0)
    assert not subject.artificial_noise


def test_noise_is_not_switched_on_where_rank_is_full(record):
    samples = record(steps=300)
    subject, without = (learn(identifier(filter__settle=5.0), samples[:200]) for _ in range(2))
    for each in (subject, without):
        each.restart()  # so that the history alone teaches for a while
    retune(subject, history__noise=0.1)
    for sample in samples[200:]:
        subject.update(*sample)
        without.update(*sample)
        np.testing.assert_array_equal(subject.theta, without.theta)
    assert not subject.artificial_noise


def test_pairs_with_artificial_noise_follow_the_size_of_the_history():
    subject = identifier(history__noise=0.1, history__size=9)
    retune(subject, history__size=4, history__epsilon=0.2)
    noisy = subject.state.learner.noise.history
    assert noisy is not subject.stack.pairs
    assert (noisy.counters[SIZE], noisy.figures[THRESHOLD]) == (4, 0.2)


_WARM = """
import gc
import numpy as np
from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.compiled import COMPILED
from adaptive_blf_control.compiled.dispatchers import Entry
from adaptive_blf_control.identification.identifier import Identifier


def loaded():
    return sum(len(each.overloads) for each in gc.get_objects() if isinstance(each, Entry))


random = np.random.default_rng(1)
identifier = Identifier(TwoLinkArm(), history={'size': 6}, filter={'settle': 0.0})
identifier.warm_up()
before = loaded()
for k in range(40):
    identifier.update(k * 1e-3, *random.normal(size=(3, 2)))
identifier.retune(history={'size': 5})
for k in range(40, 50):
    identifier.update(k * 1e-3, *random.normal(size=(3, 2)))
assert identifier.stack.count == 5, identifier
print(loaded() - before)
"""


@pytest.mark.skipif(not COMPILED, reason='numba is not installed or switched off')
def test_a_smaller_history_asks_for_no_function_that_warming_up_has_not_compiled():
    run = subprocess.run([sys.executable, '-c', _WARM], capture_output=True, text=True,
                         env={**os.environ, 'PYTHONPATH': os.pathsep.join(sys.path)})
    assert run.stdout == '0\n', run.stderr
