# SPDX-License-Identifier: Apache-2.0
"""Facts about the points a planar arm is drawn through."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.arms.planar import planar_points
from adaptive_blf_control.arms.two_link import TwoLinkArm


def test_a_stretched_arm_lies_along_x():
    points = planar_points(np.zeros(3), (0.4, 0.4, 0.35))
    np.testing.assert_allclose(points[:, 0], [0.0, 0.4, 0.8, 1.15])
    np.testing.assert_array_equal(points[:, 1:], 0.0)


def test_angles_count_from_the_link_before():
    points = planar_points(np.array([np.pi / 2, -np.pi / 2]), (2.0, 1.0))
    np.testing.assert_allclose(points, [[0, 0, 0], [0, 2, 0], [1, 2, 0]], atol=1e-12)


def test_the_two_link_arm_is_drawn_with_the_lengths_it_states():
    points = TwoLinkArm().link_points(np.array([0.3, -1.1]))
    np.testing.assert_allclose(np.linalg.norm(np.diff(points, axis=0), axis=1), [0.5, 0.4])
