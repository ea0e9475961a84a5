# SPDX-License-Identifier: Apache-2.0
"""Facts about whole runs: what the scenarios reach, the same bits twice, numba or not."""

from __future__ import annotations

from collections.abc import Callable
import os
from pathlib import Path
import subprocess
import sys

import numpy as np
import pytest

from adaptive_blf_control.compiled import COMPILED
from adaptive_blf_control.configuration.build_closed_loop import build_closed_loop
from adaptive_blf_control.configuration.parameter_file import apply_settings, load_yaml
from adaptive_blf_control.errors import ParameterError, SetViolation
from adaptive_blf_control.runs.summary import run_of_trace, summarise
from adaptive_blf_control.simulation.closed_loop import ClosedLoop
from adaptive_blf_control.simulation.sample import Sample, sample_time

PAPER_GAINS = ('controller.k1=[40.0, 30.0]', 'controller.k2=[30.0, 40.0]',
               'identifier.kt=10.0', 'identifier.kh=10.0')
KNOWN = ('controller.model=known', 'controller.known_parameters=[3.473, 0.196, 0.242, 5.3, 1.1]')
FIELDS = ('t', 'q', 'e1', 'torque', 'theta_hat', 'rank', 'sigma_min')

Build = Callable[..., ClosedLoop]


@pytest.fixture
def build(repository) -> Build:
    """Return ``build(setting, ..., config=...)``: the closed loop of a scenario, changed."""
    def of(*settings: str, config: str = 'two_link') -> ClosedLoop:
        data = load_yaml(repository / 'config' / f'{config}.yaml')
        return build_closed_loop(apply_settings(data, list(settings)))
    return of


def figures_of(loop: ClosedLoop, duration: float):
    return summarise(run_of_trace(loop, loop.run(duration)))


def test_the_two_link_scenario_learns_within_two_seconds_and_keeps_its_sets(build):
    figures = figures_of(build(), 20.0)
    assert figures['set_violations'] == 0
    assert figures['theta_settling_time_s'] <= 2.0
    assert figures['theta_error_norm'] <= 1e-3
    assert max(figures['max_abs_error']) <= 0.02
    assert figures['history_rank'] == 5
    assert figures['history_sigma_min'] > 0.0


def test_the_papers_own_gains_converge_as_far_as_they_can_in_fifty_seconds(build):
    figures = figures_of(build(config='two_link_paper'), 50.0)
    assert figures['set_violations'] == 0
    assert figures['theta_error_norm'] <= 0.11
    assert figures['history_rank'] == 5


@pytest.mark.parametrize('coupling', ['per_joint', 'pseudoinverse'])
def test_either_coupling_keeps_the_sets(build, coupling):
    figures = figures_of(build(*PAPER_GAINS, f'controller.coupling={coupling}'), 3.0)
    assert figures['set_violations'] == 0
    assert max(figures['max_abs_error']) < 0.05


def test_the_known_model_tracks_at_once_whatever_the_identifier_believes(build):
    known = figures_of(build(*PAPER_GAINS, *KNOWN), 1.0)
    estimated = figures_of(build(*PAPER_GAINS), 1.0)
    assert max(known['max_abs_error']) < 1e-4 < max(estimated['max_abs_error'])
    assert known['theta_hat'] != estimated['theta_hat']


def test_lyapunov_function_falls_along_a_sampled_run_with_the_known_model(build):
    loop = build(*PAPER_GAINS, *KNOWN, 'arm_driver.initial_position=[0.15, 1.88]')
    values: list[float] = []

    def observer(sample: Sample) -> None:
        values.append(loop.controller.lyapunov(sample.output, loop.arm.nominal))

    loop.run(2.0, observer)
    assert np.all(np.diff(values)[:500] < 0.0)
    assert values[-1] < 0.05 * values[0]


def test_a_start_close_to_the_edge_is_pushed_inward(build):
    loop = build('arm_driver.initial_position=[0.19, 1.84]', 'arm_driver.initial_velocity=[0.0]')
    trace = loop.run(1.0)
    assert np.abs(trace.e1[0]).min() > 0.15
    assert np.all(loop.controller.performance.margin(trace.e1) > 0.0)
    assert np.abs(trace.e1[-1]).max() < 0.1


def test_a_smooth_start_begins_without_error(build):
    loop = build('controller.reference.smooth_start=1.0', 'arm_driver.initial_position=[0.3, 1.7]',
                 'arm_driver.initial_velocity=[0.0]')
    trace = loop.run(0.5)
    assert not trace.e1[0].any()
    assert np.abs(trace.e1).max() < 0.05


@pytest.mark.parametrize(('config', 'start', 'nearest'), [
    ('two_link', '[1.1999, 2.1999]', 1e-4), ('two_link', '[-1.169, 2.199]', 1e-3),
    ('three_link', '[0.519, -0.099, 1.799]', 1e-3)])
def test_a_motion_begins_at_the_edge_of_the_safety_set_and_keeps_both_sets(build, config, start,
                                                                          nearest):
    loop = build('controller.reference.smooth_start=2.0', f'arm_driver.initial_position={start}',
                 'arm_driver.initial_velocity=[0.0]', config=config)
    margins: list[np.ndarray] = []
    loop.run(3.0, lambda sample: margins.append(loop.controller.margins(sample.output)))
    assert np.min(margins) > 0.9 * nearest
    assert np.min(margins[-1]) > 0.01


def test_torque_changes_no_faster_than_its_rate_limit(build):
    trace = build('controller.torque_rate_limit=[300.0, 100.0]').run(0.2)
    steps = np.abs(np.diff(np.vstack([np.zeros(2), trace.torque]), axis=0))
    assert np.all(steps <= np.array([0.3, 0.1]) * (1 + 1e-9))
    assert steps.max(axis=0).tolist() == pytest.approx([0.3, 0.1])


@pytest.mark.parametrize('rate', [1000.0, 300.0, 777.0])
def test_sample_times_are_those_of_stamps_in_whole_nanoseconds(build, rate):
    trace = build(f'arm_driver.rate={rate}').run(0.2)
    epoch = 1_000_000_000
    for k, t in enumerate(trace.t):
        stamp = epoch + int(round(k * (1.0 / rate) * 1e9))
        assert t == (stamp - epoch) * 1e-9 == sample_time(k, 1.0 / rate)
        assert int(round(t * 1e9)) == stamp - epoch
        assert t == pytest.approx(k / rate, abs=1e-9)


@pytest.mark.parametrize('setting', [
    'identifier.update_law=concurrent', 'identifier.kt=1.0', 'identifier.kh=1.0',
    'identifier.gamma=[2.0]', 'identifier.history.size=9', 'identifier.history.epsilon=0.3',
    'identifier.filter.time_constant=0.01', 'controller.k1=[20.0]', 'controller.k2=[20.0]',
    'controller.coupling=pseudoinverse', 'controller.torque_limit=[4.0]',
    'controller.torque_rate_limit=[100.0]',
    'controller.performance.upper=[0.18]', 'controller.initial_estimate=[0.5]',
    'identifier.initial_estimate=[0.5]', 'arm_driver.torque_limit=[4.0]', 'arm_driver.rate=500.0',
    'arm_driver.true_parameters=[3.4, 0.2, 0.2, 5.0, 1.0]', 'arm_driver.initial_velocity=[0.1]'])
def test_every_setting_reaches_the_run(build, setting):
    base = [s for s in PAPER_GAINS if s.split('=')[0] != setting.split('=')[0]]
    start = ['arm_driver.initial_position=[0.05, 1.95]']
    plain, changed = (build(*base, *start, *extra).run(0.1) for extra in ((), (setting,)))
    assert not np.array_equal(plain.theta_hat[-1], changed.theta_hat[-1])


def test_torque_is_clipped_at_the_limit_of_the_controller(build):
    trace = build('controller.torque_limit=[2.0, 1.0]').run(0.05)
    assert np.abs(trace.torque).max(axis=0).tolist() == [2.0, 1.0]


def test_effort_is_what_the_drives_applied_over_the_last_interval(build):
    samples: list[Sample] = []
    build('arm_driver.torque_limit=[3.0]').run(0.02, samples.append)
    assert not samples[0].measured.torque.any()
    for last, sample in zip(samples, samples[1:]):
        np.testing.assert_array_equal(sample.measured.torque,
                                      np.clip(last.output.torque, -3.0, 3.0))


def test_a_sample_is_answered_with_the_estimate_of_the_last_one(build):
    samples: list[Sample] = []
    build(*PAPER_GAINS).run(0.02, samples.append)
    theta, alone = np.array([0.0, 9.0, 6.0, 0.0, 0.0]), build(*PAPER_GAINS).controller
    for sample in samples:
        expected = alone.update(sample.t, sample.measured.q, sample.measured.qd, theta)
        np.testing.assert_array_equal(sample.output.torque, expected.torque)
        theta = sample.theta_hat


def test_the_identifier_hears_the_adaptation_term_that_was_held_over_the_last_interval(build):
    samples: list[Sample] = []
    build(*PAPER_GAINS).run(0.02, samples.append)
    alone, term = build(*PAPER_GAINS).identifier, np.zeros(5)
    for sample in samples:
        theta = alone.update(sample.t, *sample.measured, term)
        np.testing.assert_array_equal(sample.theta_hat, theta)
        term = sample.output.x.T @ sample.output.e2
        np.testing.assert_allclose(sample.output.adaptation_term, term, rtol=1e-12)
        term = sample.output.adaptation_term


def test_observed_samples_are_those_of_the_trace(build):
    samples: list[Sample] = []
    trace = build().run(0.02, samples.append)
    assert len(samples) == len(trace.t) == 21
    for k, sample in enumerate(samples):
        assert sample.t == trace.t[k]
        np.testing.assert_array_equal(sample.measured.q, trace.q[k])
        np.testing.assert_array_equal(sample.output.e1, trace.e1[k])
        np.testing.assert_array_equal(sample.output.torque, trace.torque[k])
        np.testing.assert_array_equal(sample.theta_hat, trace.theta_hat[k])
        assert (sample.rank, sample.sigma_min) == (trace.rank[k], trace.sigma_min[k])


def test_two_runs_are_equal_bit_for_bit(build):
    first, second = (build().run(1.0) for _ in range(2))
    for field in FIELDS:
        np.testing.assert_array_equal(getattr(first, field), getattr(second, field))


def test_warming_up_does_not_change_the_run(build):
    warm = build()
    warm.warm_up()
    np.testing.assert_array_equal(warm.run(0.1).theta_hat, build().run(0.1).theta_hat)


SHORT_RUN = """
import sys
import numpy as np
from adaptive_blf_control.compiled import COMPILED
from adaptive_blf_control.configuration.parameter_file import load_yaml
from adaptive_blf_control.configuration.build_closed_loop import build_closed_loop
assert not COMPILED
trace = build_closed_loop(load_yaml(sys.argv[1])).run(0.3)
np.savez(sys.argv[2], **{name: getattr(trace, name) for name in sys.argv[3:]})
"""


@pytest.mark.skipif(not COMPILED, reason='numba is not installed or switched off')
@pytest.mark.parametrize('config', ['two_link', 'two_link_paper'])
def test_a_run_without_numba_equals_the_compiled_one(build, repository, tmp_path, config):
    path = tmp_path / 'trace.npz'
    package = Path(build_closed_loop.__code__.co_filename).parents[2]
    subprocess.run(
        [sys.executable, '-c', SHORT_RUN, str(repository / 'config' / f'{config}.yaml'), str(path),
         *FIELDS], check=True,
        env={**os.environ, 'NUMBA_DISABLE_JIT': '1', 'PYTHONPATH': str(package)})
    compiled, plain = build(config=config).run(0.3), np.load(path)
    for field in FIELDS:
        np.testing.assert_allclose(getattr(compiled, field), plain[field], rtol=1e-9, atol=1e-9)


def test_a_start_outside_a_set_is_refused(build):
    with pytest.raises(SetViolation, match="'joint1'.*start error outside the performance set"):
        build('arm_driver.initial_position=[0.25, 2.0]')


def test_an_estimate_of_the_wrong_length_is_refused(build):
    with pytest.raises(ParameterError, match=r'controller\.initial_estimate.*length 1 or 5'):
        build('controller.initial_estimate=[0.0, 1.0]')
