# SPDX-License-Identifier: Apache-2.0
"""Facts about the check whether parameters are a robot's."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.runs.model_check import positive_postures
from spatial_arm import spatial_arm


def test_a_described_robot_is_one_in_every_posture() -> None:
    for arm in (spatial_arm(), TwoLinkArm()):
        assert positive_postures(arm, arm.nominal, 200) == 200


def test_postures_in_which_the_mass_matrix_is_indefinite_are_counted() -> None:
    arm = TwoLinkArm()
    theta = np.array([1.0, 0.2, 0.4, 0.0, 0.0])  # p1 p2 − p2² − (p3 cos q2)² changes its sign
    found = positive_postures(arm, theta, 400)
    q2 = np.arccos(np.sqrt(theta[0] * theta[1] - theta[1] ** 2) / theta[2])
    expected = 400 * (np.pi - 2.0 * q2) / np.pi
    assert abs(found - expected) < 50
    assert positive_postures(arm, -arm.nominal, 50) == 0
