# SPDX-License-Identifier: Apache-2.0
"""Facts about where a URDF may come from and what is wrong with a bad one."""

from __future__ import annotations

from pathlib import Path
import re
import sys

import numpy as np
import pytest

from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.arms.urdf_source import (
    read_urdf,
    resolve_package,
    select_joints,
    urdf_joints,
    UrdfJoint,
)
from adaptive_blf_control.errors import ArmError, MissingExtra

INERTIAL = ('<inertial><origin xyz="0.1 0 0"/><mass value="{mass}"/><inertia ixx="0.01" ixy="0" '
            'ixz="0" iyy="0.02" iyz="0" izz="0.03"/></inertial>')


def link(name: str, mass: float | str | None = 1.0) -> str:
    return f'<link name="{name}">{"" if mass is None else INERTIAL.format(mass=mass)}</link>'


def joint(name: str, parent: str, child: str, kind: str = 'revolute', inside: str = '') -> str:
    return (f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            '<origin xyz="0.5 0 0"/><axis xyz="0 1 0"/>'
            f'<limit lower="-1" upper="2" effort="9" velocity="3"/>{inside}</joint>')


def robot(*parts: str) -> str:
    return f'<?xml version="1.0"?>\n<robot name="r">{"".join(parts)}</robot>'


GOOD = robot(link('base'), link('a'), link('b'), joint('ja', 'base', 'a'), joint('jb', 'a', 'b'))


def test_text_path_and_package_give_the_same_arm(tmp_path: Path,
                                                 monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / 'prefix' / 'share' / 'my_arm' / 'urdf' / 'arm.urdf'
    path.parent.mkdir(parents=True)
    path.write_text(GOOD, encoding='utf-8')
    uri = 'package://my_arm/urdf/arm.urdf'
    assert read_urdf(GOOD) == read_urdf(path) == read_urdf(str(path)) == GOOD
    assert read_urdf(f'file://{path}') == GOOD
    assert read_urdf('\n  ' + GOOD) == GOOD
    assert read_urdf(uri, [path.parents[2]]) == read_urdf(uri, [path.parents[1]]) == GOOD
    with pytest.raises(ArmError, match='my_arm'):
        read_urdf(uri)
    monkeypatch.setenv('AMENT_PREFIX_PATH', f'{tmp_path}/none:{tmp_path}/prefix')
    assert resolve_package(uri) == path


def test_prefix_of_this_python_is_searched(tmp_path: Path,
                                           monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / 'share' / 'my_arm' / 'arm.urdf'
    path.parent.mkdir(parents=True)
    path.write_text(GOOD, encoding='utf-8')
    monkeypatch.setattr(sys, 'prefix', str(tmp_path))
    assert resolve_package('package://my_arm/arm.urdf') == path


@pytest.mark.parametrize(('source', 'message'), [
    ('', 'empty'), ('no/such/arm.urdf', 'does not exist'), ('.', 'cannot be read'),
    ('package://', 'not an address'), ('package://only_a_name', 'not an address'),
    ('package://no_such_package/arm.urdf', 'not found in'), ('x' * 5000, 'cannot be read')])
def test_source_that_cannot_be_found_is_named(source: str, message: str) -> None:
    with pytest.raises(ArmError, match=message):
        read_urdf(source)


@pytest.mark.parametrize(('xml', 'message'), [
    ('<robot name="r"><link name="a">', 'well-formed'),
    ('<sdf version="1.6"/>', '<sdf>'),
    ('<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arm/></robot>', 'xacro'),
    ('<robot name="r" xmlns:xacro="http://ros.org/wiki/xacro"><xacro:arm/></robot>', 'xacro'),
    ('<robot name="r" xmlns:x="http://wiki.ros.org/xacro"><x:arm/></robot>', 'xacro'),
    ('<robot name="r" xmlns="http://www.ros.org/wiki/xacro"><arm/></robot>', 'xacro'),
    ('<robot name="r"><xacro:include filename="a"/></robot>', 'xacro'),
    ('<robot name="r"><link name="${n}"/></robot>', 'xacro'),
    ('<robot name="r"><link name="a"/><include filename="$(find p)/a"/></robot>', 'xacro'),
    ('<robot name="r"><link name="a">${body}</link></robot>', 'xacro'),
    (robot(link('base'), joint('j', 'base', 'ghost')), "child link 'ghost'"),
    *((GOOD.replace('xyz="0 1 0"', f'xyz="{x}"'), f"joint 'ja' has the axis '{x}'")
      for x in ('0 0 0', '0 1', 'x 0 1', 'nan 0 1')),
    *((robot(link('base'), link('a', mass), joint('j', 'base', 'a')),
       f"link 'a' has the mass '{mass}'") for mass in (-1.0, 'heavy', 'nan', 'inf', '')),
    (robot('<link name="a"><inertial><mass value="0"/></inertial><inertial><mass/></inertial>'
           '</link>'),
     "link 'a' has the mass ''"),
    *((robot(link('base'), link('a'), re.sub('<limit[^>]*>', '', joint('j', 'base', 'a', kind))),
       f"joint 'j' is {kind} and has no <limit>") for kind in ('revolute', 'prismatic')),
    *((robot(link('base'), link('a'), re.sub('<limit[^>]*>', limit, joint('j', 'base', 'a'))),
       words) for limit, words in (
        ('<limit lower="1" upper="-1" effort="1" velocity="1"/>', 'the limits 1 to -1'),
        ('<limit lower="nan" upper="1" effort="1" velocity="1"/>', "the limit lower = 'nan'"),
        ('<limit upper="1" effort="much" velocity="1"/>', "the limit effort = 'much'"))),
    *((robot(link('base'), re.sub('<inertia ', f'<inertia ixz="{value}" ', link('a')).replace(
        'ixz="0"', ''), joint('j', 'base', 'a')),
       f"link 'a' has the inertia ixz = '{value}'") for value in ('inf', 'none')),
    (robot(link('base'), link('a'), '<joint name="j" type="fixed"><child link="a"/></joint>'),
     'parent link None'),
    (robot(link('base'), link('a'), joint('j', 'base', 'a', 'ball')), "type 'ball'"),
    (robot(link('base'), link('a'), link('b'), joint('j', 'base', 'a'), joint('j', 'a', 'b')),
     "two joints named 'j'")])
def test_malformed_urdf_is_explained(xml: str, message: str) -> None:
    with pytest.raises(ArmError, match=message):
        urdf_joints(xml)


def test_a_massless_link_and_a_turntable_without_limits_are_none_the_worse() -> None:
    turns = re.sub('<limit[^>]*>', '', joint('j', 'base', 'a', 'continuous'))
    assert urdf_joints(robot(link('base', None), link('a', 0.0), turns)) == (
        UrdfJoint('j', 'continuous', None),)


def test_joints_are_selected_in_the_order_asked_for() -> None:
    joints = urdf_joints(GOOD)
    assert joints == (UrdfJoint('ja', 'revolute', None), UrdfJoint('jb', 'revolute', None))
    assert select_joints(joints, None) == ('ja', 'jb')
    assert select_joints(joints, ['jb', 'ja']) == ('jb', 'ja')


@pytest.mark.parametrize(('wanted', 'message'), [
    (['ja', 'nope'], "no joint 'nope'.*ja, jb"), (['ja', 'ja'], 'twice'), ([], 'list of names'),
    ('ja', 'list of names'), (['fix'], "'fix' is fixed"), (['fly'], "'fly' is floating"),
    (['slave'], "mimics 'ja'"), (None, "'fly' is floating")])
def test_joint_that_cannot_be_driven_is_named(wanted: list[str] | None, message: str) -> None:
    available = [*urdf_joints(GOOD), UrdfJoint('fix', 'fixed', None),
                 UrdfJoint('slave', 'revolute', 'ja'), UrdfJoint('fly', 'floating', None)]
    with pytest.raises(ArmError, match=message):
        select_joints(available, wanted)


def test_git_lfs_pointer_is_told_from_a_urdf(tmp_path: Path) -> None:
    path = tmp_path / 'arm.urdf'
    path.write_text('version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n')
    with pytest.raises(ArmError, match='git lfs pull'):
        read_urdf(path)


def test_a_urdf_that_xacro_has_made_is_no_xacro_file() -> None:
    made = GOOD.replace('name="r"', 'name="r" xmlns:xacro="http://www.ros.org/wiki/xacro"')
    assert urdf_joints(made) == urdf_joints(GOOD)


def test_zero_axis_of_a_fixed_joint_says_nothing() -> None:
    fixed = robot(link('base'), link('a'), joint('j', 'base', 'a', 'fixed'))
    assert urdf_joints(fixed.replace('0 1 0', '0 0 0')) == (UrdfJoint('j', 'fixed', None),)


def test_arm_without_inertia_is_refused() -> None:
    pytest.importorskip('pinocchio')
    bare = robot(link('base'), link('a', None), link('b', None), joint('ja', 'base', 'a'),
                 joint('jb', 'a', 'b'))
    with pytest.raises(ArmError, match='no inertia'):
        UrdfArm(bare)
    with pytest.raises(ArmError, match="behind joint 'jb'"):
        UrdfArm(bare.replace(link('a', None), link('a')))


def test_unconnected_tree_is_refused() -> None:
    pytest.importorskip('pinocchio')
    with pytest.raises(ArmError, match='cannot read this URDF'):
        UrdfArm(GOOD.replace('<link name="base">', '<link name="alone"/><link name="base">'))


def test_prismatic_and_continuous_joints_make_an_arm() -> None:
    pytest.importorskip('pinocchio')
    arm = UrdfArm(robot(link('base'), link('a'), link('b'),
                        joint('slide', 'base', 'a', 'prismatic'),
                        joint('spin', 'a', 'b', 'continuous')))
    # Two masses move along the slide: it sees their sum only.
    assert [name for name in arm.parameters if name.endswith('.m')] == ['spin.m']
    np.testing.assert_array_equal(arm.position_upper, [2.0, np.inf])
    np.testing.assert_array_equal(arm.position_lower, [-1.0, -np.inf])
    np.testing.assert_array_equal(arm.torque_limit, [9.0, 9.0])
    np.testing.assert_array_equal(arm.velocity_limit, [3.0, 3.0])
    assert arm.mass_matrix(np.zeros(2))[0, 0] == pytest.approx(2.0)


@pytest.mark.parametrize('written', ['1.7976931348623157e+308', '1e301', '0'])
def test_a_limit_of_the_largest_double_or_zero_is_none(written: str) -> None:
    pytest.importorskip('pinocchio')
    arm = UrdfArm(GOOD.replace('effort="9"', f'effort="{written}"'))
    np.testing.assert_array_equal(arm.torque_limit, np.inf)
    np.testing.assert_array_equal(arm.velocity_limit, 3.0)


def test_massless_link_between_two_joints_can_be_simulated() -> None:
    pytest.importorskip('pinocchio')
    arm = UrdfArm(GOOD.replace(link('a'), link('a', None)))
    tau = arm.Y(np.ones(2), np.ones(2), np.ones(2)) @ arm.nominal
    np.testing.assert_allclose(
        arm.dynamics(arm.nominal).acceleration(np.ones(2), np.ones(2), tau), 1.0)
    theta = 1.1 * arm.nominal
    tau = arm.Y(np.ones(2), np.ones(2), np.ones(2)) @ theta
    np.testing.assert_allclose(
        arm.dynamics(theta).acceleration(np.ones(2), np.ones(2), tau), 1.0)


def test_heavy_link_without_mass_left_is_refused() -> None:
    pytest.importorskip('pinocchio')
    arm = UrdfArm(robot(link('base'), link('a'), joint('slide', 'base', 'a', 'prismatic')))
    assert arm.parameters == ('slide.m', 'fv_slide')
    q, qd, qdd = np.ones((3, 1))
    assert arm.Y1(q, qd) @ arm.nominal == pytest.approx(1.0)
    np.testing.assert_allclose(arm.Y2(q, qd), [[0.0, 1.0]], atol=1e-12)
    np.testing.assert_allclose(arm.X(q, qd, qd, qdd), [[1.0, 1.0]], atol=1e-12)
    np.testing.assert_allclose(arm.dynamics(arm.nominal).acceleration(q, qd, qdd), [1.0])
    with pytest.raises(ArmError, match='positive definite|no positive mass'):
        arm.dynamics(np.array([-1.0, 0.0]))


def test_missing_pinocchio_is_explained(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, 'pinocchio', None)
    with pytest.raises(MissingExtra, match='pinocchio'):
        UrdfArm(GOOD)
