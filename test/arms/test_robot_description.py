# SPDX-License-Identifier: Apache-2.0
"""The URDF that viewers get is the arm's own, or a chain as the planar arms are drawn."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.arms.load import load_arm
from adaptive_blf_control.arms.robot_description import robot_description
from adaptive_blf_control.arms.three_link import ThreeLinkArm
from adaptive_blf_control.arms.two_link import TwoLinkArm


@pytest.mark.parametrize('arm', [TwoLinkArm(('a', 'b&c')), ThreeLinkArm()])
def test_the_joints_of_a_planar_chain_are_where_the_arm_is_drawn(arm) -> None:
    pinocchio = pytest.importorskip('pinocchio', reason='Pinocchio reads the URDF')
    model = pinocchio.buildModelFromXML(robot_description(arm))
    assert tuple(model.names)[1:] == arm.joints
    q, data = np.linspace(0.4, -1.1, arm.n), model.createData()
    # A continuous joint is cos and sin of its angle in Pinocchio.
    pinocchio.forwardKinematics(model, data, np.column_stack([np.cos(q), np.sin(q)]).ravel())
    drawn = arm.link_points(q)
    for joint, origin in enumerate(drawn[:-1], start=1):
        np.testing.assert_allclose(data.oMi[joint].translation, origin, atol=1e-12)


def test_an_arm_from_a_urdf_is_described_by_that_urdf(pair_urdf) -> None:
    pytest.importorskip('pinocchio', reason='Pinocchio reads the URDF')
    assert robot_description(load_arm(pair_urdf)) == pair_urdf


def test_an_arm_without_a_geometry_has_no_description() -> None:
    class Bare:
        joints = ('joint',)

    assert robot_description(Bare()) is None
