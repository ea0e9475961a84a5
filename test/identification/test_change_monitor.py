# SPDX-License-Identifier: Apache-2.0
"""Facts about the change monitor: silent in noise, quick after a change, the stack starts anew."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.configuration.build import build_closed_loop
from adaptive_blf_control.configuration.parameter_file import apply_settings, load_yaml
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.change_monitor import ChangeMonitor

TRUE = np.array([3.0, -1.0, 0.5])


def noisy_pair(random: np.random.Generator, theta: np.ndarray, noise: float = 0.05):
    regressor = random.normal(size=(2, 3))
    return regressor, regressor @ theta + noise * random.normal(size=2)


def learned_monitor(random: np.random.Generator, resolution: float = 0.0) -> ChangeMonitor:
    pairs = [noisy_pair(random, TRUE) for _ in range(30)]
    regressors, torques = (np.array([pair[i] for pair in pairs]) for i in range(2))
    rows = regressors.reshape(-1, 3)
    monitor = ChangeMonitor(2, 0.1, 9.0, resolution)
    monitor.learn(regressors, torques, rows.T @ rows, torques.reshape(-1) @ rows, 30)
    return monitor


def test_there_is_no_alarm_in_noise_like_that_of_the_recorded_pairs():
    random = np.random.default_rng(1)
    monitor = learned_monitor(random)
    largest = 0.0
    for _ in range(20000):
        assert not monitor.update(1e-3, *noisy_pair(random, TRUE))
        largest = max(largest, float(monitor.statistic.max()))
    assert 0.3 < largest < 2.0  # the mean of d² is a little below 1
    assert monitor.changes == 0


@pytest.mark.parametrize('seed', range(5))
def test_pairs_with_noise_in_common_do_not_make_the_monitor_sure_far_from_them(seed):
    random = np.random.default_rng(seed)
    pairs = [noisy_pair(random, TRUE) for _ in range(8)] * 10  # the very same noise ten times
    regressors, torques = (np.array([pair[i] for pair in pairs]) for i in range(2))
    rows = regressors.reshape(-1, 3)
    monitor = ChangeMonitor(2, 0.1, 9.0, 0.0)
    monitor.learn(regressors, torques, rows.T @ rows, torques.reshape(-1) @ rows, 80)
    for _ in range(500):
        regressor = 10.0 * random.normal(size=(2, 3))
        torque = regressor @ TRUE + 0.05 * random.normal(size=2)
        assert not monitor.update(1e-3, regressor, torque)


def test_one_wild_sample_is_not_a_change():
    random = np.random.default_rng(2)
    monitor = learned_monitor(random)
    regressor, torque = noisy_pair(random, TRUE)
    assert not monitor.update(1e-3, regressor, torque + 1e3)


def test_a_change_is_found_within_the_window_and_then_the_monitor_begins_anew():
    random = np.random.default_rng(3)
    monitor = learned_monitor(random)
    changed = TRUE + [0.5, 0.0, 0.0]
    found = next(k for k in range(500) if monitor.update(1e-3, *noisy_pair(random, changed)))
    assert 0 < found < 100
    assert monitor.changes == 1
    assert not monitor.statistic.any()
    assert not monitor.update(1e-3, *noisy_pair(random, changed))  # nothing to compare with


def test_a_change_below_the_resolution_does_not_matter():
    random = np.random.default_rng(4)
    monitor = learned_monitor(random, resolution=0.5)
    changed = TRUE + [0.5, 0.0, 0.0]
    assert not any(monitor.update(1e-3, *noisy_pair(random, changed)) for _ in range(2000))


@pytest.mark.parametrize(('values', 'name'), [
    ((-0.1, 9.0, 0.0), 'window'), ((0.1, 1.0, 0.0), 'threshold'), ((0.1, 9.0, -1.0), 'resolution'),
    ((float('nan'), 9.0, 0.0), 'window')])
def test_absurd_monitors_are_refused_by_name(values, name):
    with pytest.raises(ParameterError, match=rf'identifier\.change\.{name}'):
        ChangeMonitor(2, *values)


def test_the_payload_step_is_found_within_half_a_second_and_learned_again(repository):
    data = load_yaml(repository / 'config' / 'two_link_payload_step.yaml')
    loop = build_closed_loop(apply_settings(data, [
        'arm_driver.schedule.time=[6.0, 6.0, 6.0, 6.0, 6.0]']))
    stack, monitor, seen = loop.identifier.stack, loop.identifier.monitor, []
    trace = loop.run(10.0, lambda sample: seen.append((sample.t, monitor.changes, stack.count)))
    found = next(t for t, changes, _ in seen if changes)
    assert 6.0 < found < 6.5
    assert monitor.changes == 1
    assert min(count for t, _, count in seen if found <= t < found + 0.05) == 0
    assert stack.full
    assert stack.rank == 5
    new = loop.plant.truth(loop.arm.parameters)[1][1]
    assert np.linalg.norm(trace.theta_hat[-1] - new) < 0.01 * np.linalg.norm(new)


def test_without_the_monitor_old_pairs_hold_the_estimate_away(repository):
    data = load_yaml(repository / 'config' / 'two_link_payload_step.yaml')
    loop = build_closed_loop(apply_settings(data, [
        'arm_driver.schedule.time=[6.0, 6.0, 6.0, 6.0, 6.0]', 'identifier.change.window=0.0']))
    trace = loop.run(10.0)
    new = loop.plant.truth(loop.arm.parameters)[1][1]
    assert np.linalg.norm(trace.theta_hat[-1] - new) > 0.03 * np.linalg.norm(new)


def test_a_changed_setting_acts_on_pairs_learned_before():
    pairs = np.random.default_rng(6)
    changed = learned_monitor(np.random.default_rng(5), resolution=0.9)
    always = learned_monitor(np.random.default_rng(5), resolution=0.2)
    changed.retune(0.1, 9.0, 0.2)
    for _ in range(200):
        pair = noisy_pair(pairs, TRUE)
        changed.update(1e-3, *pair)
        always.update(1e-3, *pair)
        np.testing.assert_array_equal(changed.statistic, always.statistic)


def test_a_monitor_is_retuned_all_or_none():
    monitor = learned_monitor(np.random.default_rng(5), resolution=0.2)
    for values in ((-0.1, 4.0, 0.1), (0.2, 1.0, 0.1), (0.2, 4.0, -1.0), (0.2, np.inf, 0.1)):
        with pytest.raises(ParameterError):
            monitor.retune(*values)
        assert (monitor.window, monitor.threshold, monitor.resolution) == (0.1, 9.0, 0.2)
