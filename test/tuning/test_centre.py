# SPDX-License-Identifier: Apache-2.0
"""Facts about the posture around which a reference moves, where nobody states one."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from adaptive_blf_control.arms.load import load_arm
from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.tuning.centre import centre_between
from adaptive_blf_control.tuning.inertia import mass_matrices, seen_inertia
from adaptive_blf_control.tuning.recipe import Recipe, recipe
from adaptive_blf_control.tuning.robot import Robot

LINK = """<link name="{name}"><inertial><origin xyz="0 0 0.25"/><mass value="2"/>
<inertia ixx="0.05" ixy="0" ixz="0" iyy="0.05" iyz="0" izz="0.0005"/></inertial>
<collision><origin xyz="0 0 0.25"/><geometry><box size="0.06 0.06 0.4"/></geometry></collision>
</link>"""
JOINT = """<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>
<origin xyz="0 0 {height}"/><axis xyz="{axis}"/>
<limit lower="-2.8" upper="2.8" velocity="2" effort="60"/></joint>"""
# A mast: in the middle of its limits, straight up, the axes of turn and roll are one line.
MAST = ('<robot name="mast"><link name="base">{box}</link>'
        + LINK.format(name='post') + LINK.format(name='boom') + LINK.format(name='head')
        + JOINT.format(name='turn', parent='base', child='post', height='0', axis='0 0 1')
        + JOINT.format(name='luff', parent='post', child='boom', height='0.5', axis='0 1 0')
        + JOINT.format(name='roll', parent='boom', child='head', height='0.5', axis='0 0 1')
        + '</robot>')
RANGE = np.array([[-2.8] * 3, [2.8] * 3])  # rad
BOX = ('<collision><origin xyz="{x} 0 1"/><geometry><box size="1 4 1.6"/></geometry>'
       '</collision>')


def mast(box: str = '') -> UrdfArm:
    pytest.importorskip('pinocchio')
    return load_arm(MAST.format(box=box))


def held(arm: UrdfArm, posture: np.ndarray) -> np.ndarray:
    seen = seen_inertia(mass_matrices(arm, arm.nominal, posture[None]))
    return seen.least / seen.coupling


def side(found: Recipe) -> float:
    """Return to which side of the post the reference moves: its x [m] over the boom's length."""
    assert found.motion.centre[0] == 0.0
    return float(np.sin(found.motion.centre[1]))


def test_an_arm_that_is_singular_in_the_middle_of_its_limits_moves_elsewhere_and_says_why(
        ) -> None:
    arm = mast()
    found = recipe(arm, Robot())
    assert abs(side(found)) > 0.3
    assert (held(arm, found.motion.centre) > 3.0 * held(arm, np.zeros(3))).any()
    text = ' '.join(found.assumed)
    assert 'in the middle of the limits turn sees' in text
    assert f'moves around 0, {found.motion.centre[1]:.4g}' in text


@pytest.mark.parametrize('joints', list(itertools.permutations(('turn', 'luff', 'roll'))))
def test_a_singular_middle_is_found_in_whatever_order_the_joints_are_named(
        joints: tuple[str, ...]) -> None:
    pytest.importorskip('pinocchio')
    motion = recipe(load_arm(MAST.format(box=''), joints), Robot()).motion
    assert 'in the middle of the limits turn sees' in motion.moved
    assert motion.centre[joints.index('turn')] == 0.0


def test_with_rotors_it_moves_there_all_the_same() -> None:
    pytest.importorskip('pinocchio')
    heavy = load_arm(MAST.format(box=''), rotor_inertia=True, rotor=1.0)
    np.testing.assert_array_equal(recipe(heavy, Robot()).motion.centre,
                                  recipe(mast(), Robot()).motion.centre)


def test_a_stated_centre_is_taken_even_where_the_arm_is_singular() -> None:
    found = recipe(mast(), Robot(centre=(0.0, 0.0, 0.0)))
    np.testing.assert_array_equal(found.motion.centre, np.zeros(3))
    assert 'in the middle' not in ' '.join(found.assumed)


def test_an_arm_that_is_not_singular_in_the_middle_moves_around_it(arm: UrdfArm) -> None:
    found = recipe(arm, Robot())
    np.testing.assert_array_equal(found.motion.centre, np.zeros(2))
    assert not found.motion.moved


@pytest.mark.parametrize('x', [-1.0, 1.0])
def test_it_moves_where_the_arm_is_clear_of_itself(x: float) -> None:
    assert x * side(recipe(mast(BOX.format(x=0.65 * x)), Robot())) < -0.3


def test_an_arm_that_is_nowhere_clear_of_itself_stays_in_the_middle_and_says_so() -> None:
    box = BOX.format(x=0.65) + BOX.format(x=-0.65)
    found = recipe(mast(box), Robot())
    np.testing.assert_array_equal(found.motion.centre, np.zeros(3))
    assert ('no better posture is clear of the arm itself and above its base: --centre'
            in ' '.join(found.assumed))


def test_in_the_posture_it_moves_around_a_load_turns_no_joint_as_fast_as_in_most() -> None:
    arm = mast()
    weight, rest = arm.payload_direction, np.zeros(3)
    assert weight is not None

    def thrown(q: np.ndarray) -> float:
        return float((np.abs(arm.X(q, rest, rest, rest) @ weight) / held(arm, q)).max())

    centre = recipe(arm, Robot()).motion.centre
    usual = np.median([held(arm, np.array([0.0, luff, 0.0])) for luff in np.linspace(-1, 1, 41)],
                      axis=0)
    as_good = [np.array([0.0, luff, 0.0]) for luff in np.linspace(-1.0, 1.0, 41)
               if (held(arm, np.array([0.0, luff, 0.0])) >= usual).all()]
    assert thrown(centre) <= np.median([thrown(q) for q in as_good])


def test_postures_are_tried_in_the_order_in_which_a_load_turns_no_joint_fast() -> None:
    arm, tried = mast(BOX.format(x=0.65)), []

    def along(posture: np.ndarray) -> np.ndarray:
        tried.append(posture)
        return np.array([[0.0, 1.2, 0.0]])  # in the box: the next one is tried

    upper = np.array([2.5, 1.0, 2.5])
    assert 'no better posture' in centre_between(arm, -upper, upper, RANGE, along).reason
    weight, rest = arm.payload_direction, np.zeros(3)
    assert weight is not None
    each = np.array([held(arm, q) for q in tried])
    thrown = [(np.abs(arm.X(q, rest, rest, rest) @ weight) / holds).max()
              for q, holds in zip(tried, each)]
    assert len(thrown) > 50
    assert (np.diff(thrown) >= 0.0).all()
    usual = np.median([held(arm, np.array([0.0, luff, 0.0])) for luff in np.linspace(-1, 1, 401)],
                      axis=0)
    assert (each > 0.9 * usual).all()


@pytest.mark.parametrize(('luff', 'reason'), [(1.0, 'moves around'), (2.8, 'no better posture')])
def test_a_posture_from_which_the_reference_goes_below_the_base_is_not_taken(
        luff: float, reason: str) -> None:
    upper = np.array([2.5, 1.0, 2.5])
    assert reason in centre_between(
        mast(), -upper, upper, RANGE, lambda _: np.array([[0.0, luff, 0.0]])).reason
