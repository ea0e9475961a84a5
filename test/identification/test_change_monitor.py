# SPDX-License-Identifier: Apache-2.0
"""Facts about the change monitor: silent in noise, quick after a change, the stack refills."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.configuration.build_closed_loop import build_closed_loop
from adaptive_blf_control.configuration.parameter_file import apply_settings, load_yaml
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.change_monitor import ResidualMonitor, take_over
from adaptive_blf_control.identification.history_stack import HistoryStack

TRUE = np.array([3.0, -1.0, 0.5])


def noisy_pair(random: np.random.Generator, theta: np.ndarray, noise: float = 0.05):
    regressor = random.normal(size=(2, 3))
    return regressor, regressor @ theta + noise * random.normal(size=2)


def recorded(pairs) -> HistoryStack:
    stack = HistoryStack(2, 3, len(pairs), 0.0)
    for pair in pairs:
        stack.offer(*pair)
    assert stack.full
    return stack


def subject(random: np.random.Generator, resolution: float = 0.0):
    """Return a monitor and ``watch(pair)``, which compares with 30 pairs of the true arm."""
    stack = recorded([noisy_pair(random, TRUE) for _ in range(30)])
    monitor = ResidualMonitor(2, 3, 0.1, 9.0, resolution)
    return monitor, lambda pair: monitor.watch(1e-3, *pair, stack)


def test_there_is_no_alarm_in_noise_like_that_of_the_recorded_pairs():
    random = np.random.default_rng(1)
    monitor, watch = subject(random)
    largest = 0.0
    for _ in range(20000):
        assert not watch(noisy_pair(random, TRUE))
        largest = max(largest, float(monitor.statistic.max()))
    assert 0.3 < largest < 2.0  # the mean of d² is a little below 1


def test_the_variance_of_the_recorded_pairs_is_that_of_their_noise():
    random, found = np.random.default_rng(9), []
    for _ in range(400):  # 16 equations, of which the fit of 4 parameters absorbs a quarter
        monitor = ResidualMonitor(2, 4, 0.1, 25.0, 0.0)
        regressors = random.normal(size=(8, 2, 4))
        torques = regressors @ np.ones(4) + 0.3 * random.normal(size=(8, 2))
        rows = regressors.reshape(16, 4)
        take_over(monitor.arrays, regressors, torques, rows.T @ rows, rows.T @ torques.ravel())
        found.append(monitor.arrays.variance.copy())
    np.testing.assert_allclose(np.mean(found, axis=0), 0.09, rtol=0.06)


@pytest.mark.parametrize('seed', range(5))
def test_pairs_with_noise_in_common_do_not_make_the_monitor_sure_far_from_them(seed):
    random = np.random.default_rng(seed)
    pairs = [noisy_pair(random, TRUE) for _ in range(8)]
    stack = recorded(pairs * 10)  # the very same noise ten times
    monitor = ResidualMonitor(2, 3, 0.1, 9.0, 0.0)
    for _ in range(500):
        regressor = 10.0 * random.normal(size=(2, 3))
        torque = regressor @ TRUE + 0.05 * random.normal(size=2)
        assert not monitor.watch(1e-3, regressor, torque, stack)


def test_one_wild_sample_is_not_a_change():
    random = np.random.default_rng(2)
    _, watch = subject(random)
    regressor, torque = noisy_pair(random, TRUE)
    assert not watch((regressor, torque + 1e3))


def test_a_change_is_found_within_the_window_and_after_a_reset_again():
    random = np.random.default_rng(3)
    monitor, watch = subject(random)
    changed = TRUE + [0.5, 0.0, 0.0]
    for _ in range(2):
        found = next(k for k in range(500) if watch(noisy_pair(random, changed)))
        assert 0 < found < 100
        monitor.reset()
        assert not monitor.statistic.any()


def test_a_change_that_is_too_little_in_each_joint_is_found_in_all_of_them_together():
    random = np.random.default_rng(11)
    stack = HistoryStack(6, 3, 30, 0.0)
    for _ in range(30):
        regressor = random.normal(size=(6, 3))
        stack.offer(regressor, regressor @ TRUE + 0.05 * random.normal(size=6))

    def found(joints: int, threshold: float = 25.0) -> bool:
        monitor = ResidualMonitor(6, 3, 0.1, threshold, 0.0)
        beyond = np.where(np.arange(6) < joints, 0.18, 0.0)
        alarms = []
        for _ in range(1500):
            regressor = random.normal(size=(6, 3))
            torque = regressor @ TRUE + 0.05 * random.normal(size=6) + beyond
            alarms.append(monitor.watch(1e-3, regressor, torque, stack))
        assert monitor.statistic.max() < 20.0
        return any(alarms)

    assert not found(1)
    assert found(4)
    assert not found(0, 5.0)  # what is ordinary in six joints adds up to nothing


def grown(pairs, size: int) -> HistoryStack:
    stack = HistoryStack(2, 3, size, 0.0)
    for pair in pairs:
        stack.offer(*pair)
    return stack


def test_there_is_nothing_to_compare_with_until_the_rank_is_full():
    random, monitor = np.random.default_rng(3), ResidualMonitor(2, 3, 0.1, 9.0, 0.0)
    pairs = [noisy_pair(random, TRUE) for _ in range(30)]
    flat = [(regressor * [1.0, 1.0, 0.0], torque) for regressor, torque in pairs]
    for stack in (recorded(flat), grown(pairs[:2], 30)):
        for _ in range(500):
            assert not monitor.watch(1e-3, *noisy_pair(random, -TRUE), stack)
        assert not monitor.statistic.any()
        external = monitor.external_torque
        assert np.isnan(external.torque).all()
        assert np.isinf(external.bound).all()


def test_a_change_is_found_before_the_stack_is_full():
    random, monitor = np.random.default_rng(3), ResidualMonitor(2, 3, 0.1, 9.0, 0.0)
    stack = grown([noisy_pair(random, TRUE) for _ in range(30)], 1000)
    assert not any(monitor.watch(1e-3, *noisy_pair(random, TRUE), stack) for _ in range(500))
    assert any(monitor.watch(1e-3, *noisy_pair(random, -TRUE), stack) for _ in range(100))


def test_the_external_torque_is_measured_minus_predicted_and_beyond_its_bound_where_pushed():
    random = np.random.default_rng(8)
    monitor, watch = subject(random)
    watch(noisy_pair(random, TRUE))
    assert (np.abs(monitor.external_torque.torque) < monitor.external_torque.bound).all()
    regressor, torque = noisy_pair(random, TRUE)
    watch((regressor, torque + [0.0, 2.0]))
    torque, bound = monitor.external_torque
    assert torque[1] == pytest.approx(2.0, abs=0.3)
    assert (np.abs(torque) > bound).tolist() == [False, True]
    assert ((bound > 0.15) & (bound < 0.3)).all()  # 3 standard deviations, and those of θ_s


def test_a_change_below_the_resolution_does_not_matter():
    random = np.random.default_rng(4)
    _, watch = subject(random, resolution=0.5)
    changed = TRUE + [0.5, 0.0, 0.0]
    assert not any(watch(noisy_pair(random, changed)) for _ in range(2000))


@pytest.mark.parametrize(('values', 'name'), [
    ((-0.1, 9.0, 0.0), 'window'), ((0.1, 1.0, 0.0), 'threshold'), ((0.1, 9.0, -1.0), 'resolution'),
    ((float('nan'), 9.0, 0.0), 'window')])
def test_monitors_that_cannot_be_used_are_refused_by_name(values, name):
    with pytest.raises(ParameterError, match=rf'identifier\.change\.{name}'):
        ResidualMonitor(2, 3, *values)


def test_the_payload_step_is_found_within_half_a_second_and_learned_again(repository):
    data = load_yaml(repository / 'config' / 'two_link_payload_step.yaml')
    loop = build_closed_loop(apply_settings(data, [
        'arm_driver.schedule.time=[6.0, 6.0, 6.0, 6.0, 6.0]']))
    identifier, stack, seen = loop.identifier, loop.identifier.stack, []
    for sample in loop.samples(10.0):
        seen.append((sample.t, identifier.changes, stack.count))
    found = next(t for t, changes, _ in seen if changes)
    assert 6.0 < found < 6.5
    assert identifier.changes == 1
    assert min(count for t, _, count in seen if found <= t < found + 0.05) == 0
    assert stack.full
    assert stack.rank == 5
    new = loop.plant.truth(loop.arm.parameters)[1][1]
    assert np.linalg.norm(identifier.theta - new) < 0.01 * np.linalg.norm(new)


def test_without_the_monitor_old_pairs_hold_the_estimate_away(repository):
    data = load_yaml(repository / 'config' / 'two_link_payload_step.yaml')
    loop = build_closed_loop(apply_settings(data, [
        'arm_driver.schedule.time=[6.0, 6.0, 6.0, 6.0, 6.0]', 'identifier.change.window=0.0']))
    trace = loop.run(10.0)
    new = loop.plant.truth(loop.arm.parameters)[1][1]
    assert np.linalg.norm(trace.theta_hat[-1] - new) > 0.03 * np.linalg.norm(new)


def test_a_changed_setting_acts_on_pairs_learned_before():
    pairs = np.random.default_rng(6)
    changed, watch_changed = subject(np.random.default_rng(5), resolution=0.9)
    always, watch_always = subject(np.random.default_rng(5), resolution=0.2)
    for watch in (watch_changed, watch_always):
        watch(noisy_pair(np.random.default_rng(6), TRUE))
    changed.retune(0.1, 9.0, 0.2)
    for monitor in (changed, always):
        monitor.arrays.statistic[:] = 0.0
    for _ in range(200):
        pair = noisy_pair(pairs, TRUE)
        watch_changed(pair)
        watch_always(pair)
        np.testing.assert_array_equal(changed.statistic, always.statistic)


def test_a_monitor_is_retuned_all_or_none():
    monitor, _ = subject(np.random.default_rng(5), resolution=0.2)
    for values in ((-0.1, 4.0, 0.1), (0.2, 1.0, 0.1), (0.2, 4.0, -1.0), (0.2, np.inf, 0.1)):
        with pytest.raises(ParameterError):
            monitor.retune(*values)
        assert (monitor.arrays.window, monitor.arrays.threshold,
                monitor.arrays.resolution) == (0.1, 9.0, 0.2)


def test_what_holds_a_joint_that_sticks_is_no_change_and_what_moves_it_is():
    """The third parameter is the Coulomb torque of the second joint, 2 N·m."""
    random, held = np.random.default_rng(5), 1.8
    theta = np.array([0.7, -1.1, 2.0])

    def pair(direction, more=0.0):
        regressor = random.normal(size=(2, 3))
        regressor[:, 2] = 0.0, direction
        return regressor, regressor @ theta + 0.02 * random.normal(size=2) + [0.0, more]

    stack = recorded([pair(random.choice([-1.0, 1.0])) for _ in range(30)])
    monitor = ResidualMonitor(2, 3, 0.1, 9.0, 0.0, coulomb=[-1, 2])
    assert not any(monitor.watch(1e-3, *pair(0.05, held), stack) for _ in range(1000))
    assert any(monitor.watch(1e-3, *pair(1.0, held), stack) for _ in range(100))
    without = ResidualMonitor(2, 3, 0.1, 9.0, 0.0)
    assert any(without.watch(1e-3, *pair(0.05, held), stack) for _ in range(100))
