# SPDX-License-Identifier: Apache-2.0
"""Which joints move, and what is refused: a URDF or an MJCF as the source of an arm in MuJoCo."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.errors import ArmError, MissingExtra, ParameterError
from adaptive_blf_control.simulation.mujoco import library
from adaptive_blf_control.simulation.mujoco.plant import MujocoPlant
from adaptive_blf_control.simulation.mujoco.source import arm_spec

LINK = """<robot name="r"><link name="base"/><link name="a"><inertial><mass value="2"/>
<origin xyz=".2 0 0" rpy="0.3 0.5 -0.7"/>
<inertia ixx=".1" ixy="0.01" ixz="0" iyy=".12" iyz="0.02" izz=".15"/></inertial></link>
<joint name="j" type="continuous"><parent link="base"/><child link="a"/><axis xyz="0 1 0"/>
</joint></robot>"""
INERTIA = np.array([[0.1, 0.01, 0.0], [0.01, 0.12, 0.02], [0.0, 0.02, 0.15]])


def test_an_inertia_keeps_its_attitude_against_the_link():
    # Rz(−0.7) Ry(0.5) Rx(0.3), as URDF defines rpy.
    def turn(axis: int, angle: float) -> np.ndarray:
        i, j = (axis + 1) % 3, (axis + 2) % 3
        matrix = np.eye(3)
        matrix[i, i] = matrix[j, j] = np.cos(angle)
        matrix[j, i], matrix[i, j] = np.sin(angle), -np.sin(angle)
        return matrix

    attitude = turn(2, -0.7) @ turn(1, 0.5) @ turn(0, 0.3)
    model = arm_spec(LINK, ['j']).compile()
    body, matrix = model.body('a').id, np.zeros(9)
    library.load_mujoco().mju_quat2Mat(matrix, model.body_iquat[body])
    axes = matrix.reshape(3, 3)
    np.testing.assert_allclose(axes @ np.diag(model.body_inertia[body]) @ axes.T,
                               attitude @ INERTIA @ attitude.T, atol=1e-14)


def test_joints_that_are_not_named_are_locked(two_links, two_link_settings):
    model = MujocoPlant(two_link_settings, two_links).arm_model.model
    assert [model.joint(i).name for i in range(model.njnt)] == ['shoulder', 'elbow']
    assert model.body('hand').mass[0] == pytest.approx(0.2)
    assert model.nu == 0


def test_joints_may_have_other_names_in_the_model(mjcf, two_links, two_link_settings):
    text = mjcf.replace('"shoulder"', '"j1"').replace('"elbow"', '"j2"')
    plant = MujocoPlant(two_link_settings.replace(
        mujoco={'model': text, 'joints': ['j1', 'j2']}, initial_position=[0.1, 0.2],
        schedule={'time': [0.0], 'parameter': ['fv_elbow'], 'value': [7.0]}), two_links)
    assert plant.data.joint('j2').qpos[0] == 0.2
    assert plant.arm_model.model.dof_damping.tolist() == [0.3, 7.0]
    with pytest.raises(ParameterError, match='mujoco.joints.*shoulder, elbow in the model'):
        MujocoPlant(two_link_settings.replace(mujoco={'model': text, 'joints': ['j1']}),
                    two_links)


def test_armature_and_damping_of_an_mjcf_stay_unless_others_are_given(two_links,
                                                                     two_link_settings):
    model = MujocoPlant(two_link_settings, two_links).arm_model.model
    assert model.dof_damping.tolist() == [0.3, 0.2]
    assert model.dof_armature.tolist() == [0.0, 0.01]
    changed = two_link_settings.replace(true_friction={'viscous': [1.0],
                                                       'rotor_inertia': [0.5, 0.1]})
    model = MujocoPlant(changed, two_links).arm_model.model
    assert model.dof_damping.tolist() == [1.0, 1.0]
    assert model.dof_armature.tolist() == [0.5, 0.1]


def test_a_file_finds_what_it_includes(tmp_path, two_links, two_link_settings):
    text = two_link_settings.mujoco.model
    inside = text.partition('<worldbody>')[2].partition('</worldbody>')[0]
    (tmp_path / 'arm.xml').write_text(f'<mujocoinclude>{inside}</mujocoinclude>')
    scene = tmp_path / 'scene.xml'
    scene.write_text('<mujoco><worldbody><include file="arm.xml"/></worldbody></mujoco>')
    settings = two_link_settings.replace(mujoco={'model': str(scene)})
    assert MujocoPlant(settings, two_links).arm_model.model.nv == 2


@pytest.mark.parametrize(('source', 'message'), [
    ('<mujoco><worldbody/></mujoco>', "model with the hinge or slide joint 'j': it has none"),
    ('<mujoco><worldbody><body><joint name="j" type="ball"/><geom size="1"/></body></worldbody>'
     '</mujoco>', "the hinge or slide joint 'j'"),
    ('<robot name="r"><link name="base"/></robot>', "no joint 'j'"),
    ('<sdf/>', 'a URDF .* or an MJCF .*, not <sdf>'),
    ('<robot', 'well-formed XML'),
    ('/nowhere/robot.xml', 'a readable URDF or MJCF'),
    ('<mujoco><worldbody><body><joint name="j"/></body></worldbody><sensor><x/></sensor></mujoco>',
     'MuJoCo cannot read the model')])
def test_a_model_that_cannot_be_the_arm_is_refused_with_the_reason(source, message):
    with pytest.raises((ParameterError, ArmError), match=message):
        arm_spec(source, ['j'])


def test_a_link_that_moves_without_mass_is_refused(two_links, two_link_settings):
    text = two_link_settings.mujoco.model.replace('mass="1"', 'mass="0"')
    with pytest.raises(ArmError, match='MuJoCo cannot simulate the model'):
        MujocoPlant(two_link_settings.replace(mujoco={'model': text}), two_links)


def test_without_mujoco_the_extra_is_named(monkeypatch, two_links, two_link_settings):
    monkeypatch.setitem(__import__('sys').modules, 'mujoco', None)
    with pytest.raises(MissingExtra, match=r'arm_driver.plant: mujoco needs .*\[mujoco\]'):
        MujocoPlant(two_link_settings, two_links)
