# SPDX-License-Identifier: Apache-2.0
"""Facts about the check that gravity acts along the direction that was told."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from adaptive_blf_control.arms.link_weights import LinkWeights
from adaptive_blf_control.arms.load import load_arm
from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.identification.gravity_check import (
    gravity_check_of,
    GravityCheck,
    GravityMisfit,
    WATCHED,
)
from adaptive_blf_control.runs.simulation import simulate
from adaptive_blf_control.simulation.rotation import rotation

PANDA = 'package://panda_description/urdf/panda.urdf'
JOINTS = [f'panda_joint{i}' for i in range(1, 8)]
POSTURE = np.array([0.0, -0.3, 0.0, -1.9, 0.0, 1.9, 0.5])
TOLD = np.array([0.0, 0.0, -9.81])
DT = 0.001


@pytest.fixture(scope='module')
def panda() -> UrdfArm:
    pytest.importorskip('pinocchio')
    return load_arm(PANDA, JOINTS)


def _holding(arm: UrdfArm, theta: np.ndarray | None = None) -> np.ndarray:
    """Return the torque that holds an arm in the posture."""
    rest = np.zeros(arm.n)
    return np.asarray(arm.X(POSTURE, rest, rest, rest) @ (arm.nominal if theta is None else theta))


def _tilted(angles: list[float]) -> UrdfArm:
    return load_arm(PANDA, JOINTS, gravity=rotation(np.radians(angles)).T @ TOLD)


def _at_rest(arm: UrdfArm, torque: np.ndarray, seconds: float = 1.0,
             begin: float = 0.0) -> GravityMisfit | None:
    """Return what is found while ``torque`` holds the arm from ``begin`` [s] on."""
    check, before = GravityCheck(arm), _holding(arm)
    for t in np.arange(0.0, seconds, DT):
        check.take(float(t), POSTURE, np.zeros(arm.n), before if t < begin else torque)
    return check.misfit


@pytest.mark.parametrize('angles', [[20.0, 0.0, 0.0], [-30.0, 0.0, 0.0], [0.0, 30.0, 0.0]])
def test_a_tilted_base_is_found_with_its_angle_within_a_fifth_of_a_second(
        panda: UrdfArm, angles: list[float]) -> None:
    tilted = _tilted(angles)
    misfit = _at_rest(panda, _holding(tilted))
    assert misfit is not None
    assert misfit.t < 0.2
    assert np.degrees(misfit.tilt) == pytest.approx(np.abs(angles).max(), abs=3.0)
    np.testing.assert_allclose(misfit.gravity, tilted.model.gravity.linear, atol=0.7)
    assert f'tilted by about {np.degrees(misfit.tilt):.0f}°' in misfit.text()
    assert 'N·m' in misfit.text()
    assert misfit.joint in misfit.text()


def test_the_torque_it_names_is_that_of_the_joint(panda: UrdfArm) -> None:
    torque = _holding(_tilted([30.0, 0.0, 0.0]))
    misfit = _at_rest(panda, torque)
    assert misfit is not None
    beyond = (torque - _holding(panda))[JOINTS.index(misfit.joint)]
    assert misfit.torque == pytest.approx(beyond, rel=0.02)


@pytest.mark.parametrize('seed', range(10))
def test_links_that_are_a_quarter_off_are_no_tilt(panda: UrdfArm, seed: int) -> None:
    scale = np.exp(np.random.default_rng(seed).normal(0.0, 0.25, (panda.n, 1)))
    theta = np.concatenate([panda.base_from_inertial(panda.inertial * scale),
                            panda.nominal[panda.base_count:]])
    assert _at_rest(panda, _holding(panda, theta)) is None


def test_a_load_and_friction_are_no_tilt(panda: UrdfArm) -> None:
    loaded = panda.nominal + 2.0 * panda.payload_direction
    assert _at_rest(panda, _holding(panda, loaded)) is None
    rubbing = 0.02 * panda.torque_limit * np.array([1, -1, 1, 1, -1, 1, -1])
    assert _at_rest(panda, _holding(panda) + rubbing) is None


def test_drives_that_show_no_torque_are_no_tilt(panda: UrdfArm) -> None:
    assert _at_rest(panda, np.zeros(panda.n)) is None
    assert _at_rest(panda, np.full(panda.n, np.nan)) is None


@pytest.fixture(scope='module')
def rubbing_panda() -> UrdfArm:
    """Return a Panda whose friction may be so large that no size of a misfit proves anything."""
    pytest.importorskip('pinocchio')
    return UrdfArm(PANDA, JOINTS, friction_coulomb=True, coulomb=8.0)


def test_where_friction_may_be_large_the_shape_of_the_torques_shows_a_tilt(
        rubbing_panda: UrdfArm, monkeypatch: pytest.MonkeyPatch) -> None:
    tilt = _holding(_tilted([30.0, 0.0, 0.0])) - _holding(_tilted([0.0, 0.0, 0.0]))
    torque = _holding(rubbing_panda) + tilt
    misfit = _at_rest(rubbing_panda, torque)
    assert misfit is not None
    assert misfit.t < 0.2
    monkeypatch.setattr('adaptive_blf_control.identification.gravity_check.ALIKE', -1.0)
    assert _at_rest(rubbing_panda, torque) is None  # its size alone does not


@pytest.mark.parametrize('seed', range(10))
def test_friction_and_links_that_are_off_do_not_look_like_a_tilt(
        rubbing_panda: UrdfArm, seed: int) -> None:
    random = np.random.default_rng(seed)
    scale = np.exp(random.normal(0.0, 0.25, (rubbing_panda.n, 1)))
    theta = np.concatenate([rubbing_panda.base_from_inertial(rubbing_panda.inertial * scale),
                            rubbing_panda.nominal[rubbing_panda.base_count:]])
    torque = _holding(rubbing_panda, theta) + random.uniform(-8.0, 8.0, rubbing_panda.n)
    assert _at_rest(rubbing_panda, torque) is None


@pytest.mark.filterwarnings('ignore:.*encountered:RuntimeWarning')
@pytest.mark.parametrize('size', [1e30, 1e200, 1e308])
def test_numbers_beyond_reason_end_the_check_and_nothing_else(
        panda: UrdfArm, size: float) -> None:
    for place in range(3):
        check = GravityCheck(panda)
        for k in range(100):
            states = [POSTURE, np.zeros(7), _holding(panda)]
            if k > 5:
                states[place] = np.full(7, size * (-1.0) ** k)
            check.take(DT * k, *states)
        assert check.misfit is None


def test_a_turn_about_the_vertical_makes_no_torque(panda: UrdfArm) -> None:
    assert _at_rest(panda, _holding(_tilted([0.0, 0.0, 40.0]))) is None


def test_what_comes_after_the_first_moments_is_no_tilt(panda: UrdfArm) -> None:
    torque = _holding(_tilted([30.0, 0.0, 0.0]))
    assert _at_rest(panda, torque, begin=0.02) is not None
    assert _at_rest(panda, torque, begin=0.2) is None


def test_only_the_beginning_of_a_motion_is_looked_at_and_another_one_again(
        panda: UrdfArm) -> None:
    torque = _holding(_tilted([30.0, 0.0, 0.0]))
    assert _at_rest(panda, torque, WATCHED + 1.0, begin=WATCHED + 0.1) is None
    check = GravityCheck(panda)
    for _ in range(2):
        check.restart()
        assert check.watching
        found = [check.take(DT * k, POSTURE, np.zeros(7), torque) for k in range(300)]
        assert found.count(True) == 1
        assert not check.watching


def test_arms_that_cannot_tell_are_not_looked_at(panda: UrdfArm) -> None:
    assert not GravityCheck(panda.without_gravity()).watching
    assert not GravityCheck(load_arm(PANDA, JOINTS[:3])).watching
    assert gravity_check_of(simulate('two_link', 0.002).loop.arm) is None


def test_the_weights_of_the_links_add_up_to_what_holds_the_arm(panda: UrdfArm) -> None:
    tilted = _tilted([20.0, -10.0, 0.0])
    weights = LinkWeights(panda).at(POSTURE)
    total = np.einsum('a,aik->i', tilted.model.gravity.linear, weights)
    np.testing.assert_allclose(total, _holding(tilted), atol=1e-9)


@pytest.fixture
def run(panda: UrdfArm) -> Callable[[float], object]:
    return lambda degrees: simulate('panda', 0.4, **{
        'arm_driver.mounting': [np.radians(degrees), 0.0, 0.0]})


def test_a_run_says_it_before_a_set_is_left_and_says_nothing_of_an_upright_base(run) -> None:
    tilted, upright = run(30.0), run(0.0)
    assert upright.gravity_misfit is None
    assert upright.figures['gravity_misfit'] is None
    assert 'gravity as told' not in repr(upright)
    misfit = tilted.gravity_misfit
    assert misfit is not None
    assert 'gravity as told does not fit' in repr(tilted)
    assert tilted.figures['gravity_misfit'] == misfit.text()
    assert np.degrees(misfit.tilt) == pytest.approx(30.0, abs=5.0)
    sets = tilted.controller.performance
    outside = ((tilted.e1 <= sets.lower) | (tilted.e1 >= sets.upper)).any(axis=1)
    assert misfit.t < tilted.t[outside][0]
