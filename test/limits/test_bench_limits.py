# SPDX-License-Identifier: Apache-2.0
"""Facts about ``bench limits``: what it looks at, and what moves in its scenes."""

from __future__ import annotations

import numpy as np
import pytest

import adaptive_blf_control as blf
from adaptive_blf_control.bench.limits import (
    _Timed,
    Case,
    Figures,
    moving_sphere,
    MovingSphere,
    row,
)
from adaptive_blf_control.control.safety_filter import FilterSample


def test_every_sample_of_filter_and_governor_is_timed():
    arm = blf.TwoLinkArm()
    controller = blf.Controller(
        arm, safety_filter='limits', torque_limit=[60.0, 15.0],
        safety={'lower': -1.0, 'upper': 1.0}, performance={'lower': -0.1, 'upper': 0.1},
        limits={'velocity': [1.5, 2.0], 'prior': {'mass_error': 0.1, 'friction': [8.0, 2.0]}})
    timed = _Timed(controller.safety_filter)
    for k in range(3):
        controller.update(k * 1e-3, np.zeros(2), np.zeros(2), arm.nominal)
    assert len(timed.times) == len(timed.governing) == len(timed.kinds) == len(timed.off) == 3
    assert sum(controller.safety_filter.counts) == 3


def test_a_sphere_moves_in_every_second_scene_and_is_clear_of_the_start(repository):
    pytest.importorskip('pinocchio')
    config = repository / 'config'
    assert moving_sphere(config, 1) is None
    moving = moving_sphere(config, 2)
    assert 0.05 <= np.linalg.norm(moving.velocity) <= 0.2
    assert moving.velocity[2] == 0.0
    again = moving_sphere(config, 2)
    assert all(np.array_equal(one, other) for one, other in zip(moving, again))


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
    _Timed(inner, moving)
    for k in range(25):
        inner.filtered(FilterSample(0.01 * k, none, none, none, none, none))
    np.testing.assert_allclose(shown, [[1.0, 0.0, 0.0], [0.98, 0.0, 0.0]])


def test_a_row_without_filtered_samples_says_so():
    figures = Figures(worst=np.array([1.0, 2.0, 3.0, np.inf]), progress=[0.5])
    figures.times[0].append(10.0)
    text = row(Case('still', 'Panda', 'governor and filter', lambda seed: {}), figures)
    assert text.endswith('| 10, 10; –; – |')
