# SPDX-License-Identifier: Apache-2.0
"""A model whose joint axes are not those of the arm's URDF is refused, the worst one named."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.simulation.mujoco.kinematics import largest_difference
from adaptive_blf_control.simulation.mujoco.plant import MujocoPlant
from adaptive_blf_control.simulation.settings import PlantSettings


def test_the_arm_may_stand_anywhere(two_links, two_link_settings):
    # The base of the URDF is 1 m below the shoulder, which is the origin of the MJCF.
    difference = largest_difference(two_links, MujocoPlant(two_link_settings,
                                                           two_links).arm_model)
    assert max(difference.distance, difference.angle) < 1e-12
    np.testing.assert_allclose(difference.base[[0, 2]], [0.0, -1.0], atol=1e-12)


def test_another_length_of_a_link_is_named_in_metres(two_links, two_link_settings):
    text = two_link_settings.mujoco.model.replace('pos=".5 0 0"', 'pos=".53 0 0"')
    with pytest.raises(ParameterError, match=r'that of elbow is 0\.03 m and \S+ degrees away'):
        MujocoPlant(two_link_settings.replace(mujoco={'model': text}), two_links)
    accepted = two_link_settings.replace(mujoco={'model': text, 'tolerance': 0.05})
    assert MujocoPlant(accepted, two_links).arm_model.model.nv == 2


def test_an_axis_that_turns_the_other_way_is_named(two_links, two_link_settings):
    text = two_link_settings.mujoco.model.replace('name="elbow" axis="0 1 0"',
                                                  'name="elbow" axis="0 -1 0"')
    with pytest.raises(ParameterError, match='elbow is .* m and 180 degrees away'):
        MujocoPlant(two_link_settings.replace(mujoco={'model': text}), two_links)


def test_a_panda_whose_shoulder_is_lifted_by_a_centimetre_is_told_from_its_urdf(panda,
                                                                               panda_settings):
    text = panda.xml.replace('xyz="0 -0.316 0"', 'xyz="0 -0.326 0"')
    assert text != panda.xml
    settings = panda_settings.replace(mujoco={'model': text})
    with pytest.raises(ParameterError, match=r'that of panda_joint\d is 0\.01\d* m'):
        MujocoPlant(settings, panda)


def test_prismatic_joints_are_compared_by_direction():
    urdf = """<robot name="r"><link name="base"/><link name="a"><inertial><mass value="2"/>
    <inertia ixx=".1" ixy="0" ixz="0" iyy=".1" iyz="0" izz=".1"/></inertial></link>
    <joint name="j" type="prismatic"><parent link="base"/><child link="a"/>
    <axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""
    arm = UrdfArm(urdf, ['j'])
    assert MujocoPlant(PlantSettings(), arm).q.shape == (1,)
    with pytest.raises(ParameterError, match='j is 0 m and 90 degrees away'):
        MujocoPlant(PlantSettings(mujoco={'model': urdf.replace('"0 0 1"', '"0 1 0"')}), arm)
