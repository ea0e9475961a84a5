# SPDX-License-Identifier: Apache-2.0
"""Facts about ``bench limits``: what it looks at, and what moves in its scenes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import adaptive_blf_control as blf
from adaptive_blf_control.bench import limits
from adaptive_blf_control.bench.limits import row, runs_of
from adaptive_blf_control.bench.limits_cases import Case, cases
from adaptive_blf_control.bench.limits_runs import loop_of, RunFigures, Timed
from adaptive_blf_control.bench.limits_scenes import moving_sphere, MovingSphere
from adaptive_blf_control.control.safety_filter import FilterSample
from adaptive_blf_control.limits.link_spheres import sphere_centres
from adaptive_blf_control.limits.scene import scene_of


def test_every_sample_of_filter_and_governor_is_timed():
    arm = blf.TwoLinkArm()
    controller = blf.Controller(
        arm, safety_filter='limits', torque_limit=[60.0, 15.0],
        safety={'lower': -1.0, 'upper': 1.0}, performance={'lower': -0.1, 'upper': 0.1},
        limits={'velocity': [1.5, 2.0], 'prior': {'mass_error': 0.1, 'friction': [8.0, 2.0]}})
    timed = Timed(controller.safety_filter)
    for k in range(3):
        controller.update(k * 1e-3, np.zeros(2), np.zeros(2), arm.nominal)
    assert len(timed.times) == len(timed.governing) == len(timed.kinds) == len(timed.off) == 3
    assert sum(controller.safety_filter.counts) == 3


def test_a_sphere_comes_at_the_speed_that_is_asked_for(repository):
    pytest.importorskip('pinocchio')
    config = repository / 'config'
    for slowest, fastest in ((0.05, 0.2), (0.2, 0.5)):
        moving = moving_sphere(config, 2, slowest, fastest)
        assert slowest <= np.linalg.norm(moving.velocity) <= fastest
        assert moving.velocity[2] == 0.0
        again = moving_sphere(config, 2, slowest, fastest)
        assert all(np.array_equal(one, other) for one, other in zip(moving, again))


def test_the_sphere_of_seed_56_leaves_no_posture_of_the_upper_arm_clear(repository):
    """Joints 1 and 2 alone move the first three spheres of the Panda."""
    pytest.importorskip('pinocchio')
    case = next(case for case in cases(repository / 'config', (56,), 1)
                if 'comes at 0.05' in case.name and case.law != 'law alone')
    loop = loop_of(case, repository / 'config', 56)
    scene = scene_of(loop.arm, loop.controller.settings.limits)
    assert (scene.spheres.body[:3] == 2).all()
    moving, q = moving_sphere(repository / 'config', 56, 0.05, 0.2), np.zeros(7)
    lower, upper = loop.controller.safety.lower, loop.controller.safety.upper
    most = -np.inf
    for q[0] in np.linspace(lower[0], upper[0], 121):
        for q[1] in np.linspace(lower[1], upper[1], 61):
            centres = sphere_centres(scene.chain, scene.spheres, q)[:3]
            apart = np.linalg.norm(centres - moving.at(3.2), axis=1) - scene.spheres.radius[:3]
            most = max(most, apart.min() - moving.radius)
    assert -0.02 < most < -0.005


def test_a_sphere_that_moves_is_shown_to_the_filter():
    shown = []

    class Filter:
        governor = None
        report = type('Report', (), {'kind': 0})

        def filtered(self, sample):
            return sample.torque

        def see(self, seen, gone):
            shown.append(seen['ball'].centre[0].tolist())

    moving = MovingSphere(np.array([1.0, 0.0, 0.0]), np.array([-0.1, 0.0, 0.0]), 0.1)
    inner, none = Filter(), np.zeros(1)
    Timed(inner, moving)
    for k in range(25):
        inner.filtered(FilterSample(0.01 * k, none, none, none, none, none))
    np.testing.assert_allclose(shown, [[1.0, 0.0, 0.0], [0.98, 0.0, 0.0]])


def case_of(**changes):
    return Case('still', 'Panda', 'governor and filter', lambda seed: {}, **changes)


def test_a_row_without_filtered_samples_says_so():
    run = RunFigures([0, 0, 0, 0], [1.0, 2.0, 3.0, np.inf], 0.5, counts=[1, 0, 0, 0],
                     times=[[10.0, 12.0], [], []])
    text = row(case_of(), [run])
    assert text.endswith('| 0 / 0 / 0 / – | 1.000, 2.000, 3.000 | 0.50 |  | 1 / 0 / 0 / 0 | '
                         '10, 12; –; – |')


def test_a_row_of_several_runs_has_sums_and_least_margins_and_who_was_refused():
    runs = [RunFigures([0, 1, 0, 2], [1.0, -0.2, 3.0, 0.5], 0.9), RunFigures(refused='too heavy'),
            RunFigures([0, 0, 4, 0], [0.5, 2.0, -3.0, 0.1], 0.7)]
    assert '| 2 | 0 / 1 / 4 / 2 | 0.500, -0.200, -3.000, 0.100 | 0.80 (0.70 to 0.90) (1 refused)' \
        in row(case_of(), runs)
    assert 'refused: too heavy' in row(case_of(), runs[1:2])


def test_runs_that_were_kept_are_not_run_again(tmp_path, monkeypatch):
    ran = []

    def run_of(case, config, duration, seed):
        ran.append((duration, seed))
        return RunFigures([0, 0, 0, 0], [1.0, 1.0, 1.0, float('inf')], 0.1 * seed)

    monkeypatch.setattr(limits, 'run_of', run_of)
    kept, case = tmp_path / 'runs', case_of(seeds=(1, 2))
    first = list(runs_of(case, tmp_path, 8.0, kept))
    assert list(runs_of(case, tmp_path, 8.0, kept)) == first
    assert ran == [(8.0, 1), (8.0, 2)]
    list(runs_of(case_of(seeds=(2, 3)), tmp_path, 8.0, kept))
    assert ran[2:] == [(8.0, 3)]
    list(runs_of(case, tmp_path, 4.0, kept))
    assert ran[3:] == [(4.0, 1), (4.0, 2)]


def test_a_load_that_is_put_on_makes_the_intervals_wrong_for_less_than_a_tenth_of_a_second(
        repository, panda):
    config, put_on = repository / 'config', 1.5
    heavy = next(case for case in cases(config, (0,), 1) if case.name.endswith(
        '30 % and 3 kg, which it carries, no delay, held for 1 ms, short stops, learned'))
    late = {'arm_driver.payload': 0.0, 'arm_driver.schedule.time': [put_on],
            'arm_driver.schedule.parameter': ['payload'], 'arm_driver.schedule.value': [2.0]}
    changes = {**heavy.changes(0), **late}
    loop = loop_of(replace(heavy, changes=lambda seed: changes, speed=1.0), config, 0)
    wrong, widths = [], {}
    for sample in loop.samples(3.5):
        known = loop.controller.safety_filter.model.known
        payload = next(cause for cause in known.causes if cause.name == 'payload')
        true = 2.0 if sample.t >= put_on else 0.0
        if abs(true - payload.middle) > payload.half * (1.0 + 1e-9):
            wrong.append(sample.t)
        widths[round(sample.t, 3)] = 2.0 * payload.half
    assert widths[put_on] < 1.0  # of 3 kg: it is sure that there is none
    assert wrong
    assert put_on <= wrong[0] <= wrong[-1] < put_on + 0.1
    assert widths[3.5] < 2.0  # and learns anew
    assert loop.arm.joints == panda.joints
