# SPDX-License-Identifier: Apache-2.0
"""A URDF without masses becomes an arm whose regressors are those of the robot."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.arms.urdf_inertials import with_inertials
from adaptive_blf_control.arms.urdf_source import urdf_joints
from adaptive_blf_control.errors import ArmError

MASS = '<inertial><mass value="{}"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>' \
       '</inertial>'


def robot(**inside: str) -> str:
    """Return two joints and a fixed tip; what is inside of the links is given."""
    links = ''.join(f'<link name="{name}">{inside.get(name, "<!-- bare -->")}</link>\n'
                    for name in ('base', 'a', 'b', 'tip'))
    joints = ''.join(
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        '<origin xyz="0.5 0 0.1"/><axis xyz="0 1 0"/>'
        '<limit lower="-1" upper="2" effort="9" velocity="3"/></joint>\n'
        for name, kind, parent, child in (('ja', 'revolute', 'base', 'a'),
                                          ('jb', 'revolute', 'a', 'b'),
                                          ('flange', 'fixed', 'b', 'tip')))
    return f'<robot name="r">\n{links}{joints}</robot>\n'


@pytest.mark.parametrize(('inside', 'filled'), [
    ({}, ('a', 'b')), ({'a': MASS.format(2)}, ('b',)), ({'b': MASS.format(2)}, ()),
    ({'tip': MASS.format(2)}, ()), ({'base': MASS.format(2)}, ('a', 'b')),
    ({'a': MASS.format(0), 'b': MASS.format(0)}, ('a', 'b'))])
def test_a_mass_is_given_where_a_joint_moves_none(inside, filled):
    xml = robot(**inside)
    text, links = with_inertials(xml, None)
    assert links == filled
    assert with_inertials(text, None) == (text, ())
    assert (text == xml) == (not filled)
    assert text.count('<!-- bare -->') == xml.count('<!-- bare -->')
    assert urdf_joints(text) == urdf_joints(xml)


def test_a_mass_that_is_no_number_is_none_to_be_replaced():
    with pytest.raises(ArmError, match="link 'b' has the mass 'heavy'"):
        with_inertials(robot(b=MASS.format('heavy')), None)


def test_only_the_joints_of_the_arm_are_looked_at():
    assert with_inertials(robot(), ['jb'])[1] == ('b',)


def test_the_regressors_are_those_of_the_robot():
    pytest.importorskip('pinocchio')
    from adaptive_blf_control.arms.urdf import UrdfArm
    bare = UrdfArm(with_inertials(robot(), None)[0])
    real = UrdfArm(robot(a=MASS.format(3), b=MASS.format(2), tip=MASS.format(1)))
    q, qd, qdd = np.random.default_rng(0).normal(size=(3, 2))
    assert bare.parameters == real.parameters
    np.testing.assert_array_equal(bare.Y(q, qd, qdd), real.Y(q, qd, qdd))
