# SPDX-License-Identifier: Apache-2.0
"""Facts about what follows from a URDF and from what is stated about a robot."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.arms.inverse_dynamics import inverse_dynamics
from adaptive_blf_control.arms.load import load_arm
from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.errors import ArmError, ParameterError, SetViolation
from adaptive_blf_control.tuning.adaptation import parameter_deviation, stuck_error
from adaptive_blf_control.tuning.filter_cost import filter_cost
from adaptive_blf_control.tuning.gains import adaptation_stiffness, total_rate
from adaptive_blf_control.tuning.inertia import mass_matrices
from adaptive_blf_control.tuning.recipe import recipe
from adaptive_blf_control.tuning.recipe_text import recipe_text
from adaptive_blf_control.tuning.robot import Robot

SENSORS = {'delay': 0.004, 'encoder_counts': 200000, 'torque_noise': 0.05}


def test_sets_and_reference_lie_within_the_limits_of_the_urdf(arm: UrdfArm) -> None:
    found = recipe(arm, Robot())
    motion, states = found.motion, found.states
    assert (motion.safety_lower[0], motion.safety_upper[0]) == pytest.approx((-1.92, 1.92))
    assert (np.abs(states.q - motion.centre) <= 0.5).all()
    assert (states.q - motion.bound > motion.safety_lower).all()
    assert (states.q + motion.bound < motion.safety_upper).all()
    assert (np.abs(states.qd) <= 0.36 * np.array([2.0, 3.0])).all()  # 0.35, and rounding
    assert np.ptp(states.q, axis=0).min() > 0.2


def test_a_stated_centre_is_the_middle_of_the_reference_or_refused(arm: UrdfArm) -> None:
    motion = recipe(arm, Robot(centre=(0.5, -1.0))).motion
    np.testing.assert_array_equal(motion.centre, [0.5, -1.0])
    with pytest.raises(SetViolation, match="joint 'shoulder': --centre leaves no room"):
        recipe(arm, Robot(centre=(1.9, 0.0)))
    with pytest.raises(ParameterError, match='--centre'):
        recipe(arm, Robot(centre=(0.0,)))


def test_what_the_urdf_does_not_say_is_assumed_and_said(urdf: str) -> None:
    silent = urdf.replace('effort="10"', 'effort="0"').replace('velocity="3"', 'velocity="0"')
    found = recipe(load_arm(silent), Robot())
    text = ' '.join(found.assumed)
    assert 'elbow: no position limits: the sets are within -pi .. pi' in text
    assert 'elbow: no speed limit: 1 rad/s assumed' in text
    assert 'elbow 4 N·m; --torque-limit' in text
    assert found.torque_limit.tolist() == [40.0, 4.0]
    assert found.torque[1] == pytest.approx(1.6, abs=0.2)
    stated = recipe(load_arm(silent), Robot(torque_limit=(7.0,)))
    assert stated.torque_limit.tolist() == [7.0, 7.0]
    assert 'torque' not in ' '.join(stated.assumed)


def test_a_massless_link_is_named_and_a_joint_without_inertia_refused(urdf: str) -> None:
    point = urdf.replace('ixx="0.004" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"',
                         'ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"')
    recipe(load_arm(point), Robot())  # a point mass away from the axis has an inertia about it
    on_axis = point.replace('<origin xyz="0.15 0 0"/>', '<origin xyz="0 0 0"/>')
    with pytest.raises(ArmError, match="joint 'elbow' sees no inertia"):
        recipe(load_arm(on_axis), Robot())
    first, second = urdf.index('<link name="upper">'), urdf.index('<link name="lower">')
    massless = urdf[:first] + '<link name="upper"/>' + urdf[second:]
    found = recipe(load_arm(massless), Robot())
    assert 'shoulder: the link behind it has no mass' in ' '.join(found.assumed)


def test_more_delay_gives_lower_gains_and_the_same_margins(arm: UrdfArm) -> None:
    fast, slow = (recipe(arm, Robot(delay=delay)) for delay in (0.001, 0.01))
    assert (slow.gains.k2 < 0.5 * fast.gains.k2).all()
    for found in (fast, slow):
        assert found.rate * 1.1 == pytest.approx(total_rate(found.robot.loop))
        assert np.degrees(found.phase.min()) > 50.0


def test_a_payload_needs_torque_and_lowers_no_inertia(arm: UrdfArm) -> None:
    light, heavy = recipe(arm, Robot()), recipe(arm, Robot(payload=1.0))
    assert (heavy.torque > light.torque + 2.0).all()
    assert (heavy.inertia.most > light.inertia.most).all()
    assert (heavy.inertia.least <= light.inertia.least).all()
    assert (heavy.motion.bound >= 1.5 * heavy.payload_error - 1e-4).all()
    assert not light.payload_error.any()
    loaded = arm.nominal + arm.payload_direction
    np.testing.assert_allclose(
        heavy.torque, np.abs(inverse_dynamics(arm, loaded, *heavy.states)).max(axis=0))
    np.testing.assert_allclose(heavy.reserve, 1.0 - heavy.torque / [40.0, 10.0])


def test_the_adaptation_is_as_stiff_as_its_part_of_the_budget(arm: UrdfArm) -> None:
    found = recipe(arm, Robot(**SENSORS))
    masses = mass_matrices(arm, arm.nominal, found.states.q)
    stiffness = adaptation_stiffness(arm, masses, found.states, found.adaptation.gamma)
    assert stiffness.max() == pytest.approx(total_rate(found.robot.loop) ** 2 / 8.0)


def test_noise_is_weighted_against_what_is_known_of_the_urdf(arm: UrdfArm) -> None:
    """t k_h against Γ⁻¹ is Σ 1/σ² against 1/s² at t = 30 s."""
    found = recipe(arm, Robot(**SENSORS))
    deviation = parameter_deviation(arm, found.limits.velocity, found.torque_limit, 0.0,
                                    found.gains.k2 - 0.5 * found.friction)
    ratio = 30.0 * found.adaptation.kh * found.adaptation.gamma
    torque = inverse_dynamics(arm, arm.nominal, *found.states)
    square = found.filters.noise ** 2 + 25e-10 * np.mean(torque ** 2)
    np.testing.assert_allclose(ratio, deviation ** 2 / square)


def test_parameters_deviate_by_a_quarter_and_by_the_payload(arm: UrdfArm) -> None:
    stated = np.array([2.0, 3.0]), np.array([40.0, 10.0])
    usual = parameter_deviation(arm, *stated, 0.0, np.ones(2))
    by_name = dict(zip(arm.parameters, usual))
    assert by_name['fv_shoulder'] == pytest.approx(0.25)  # half of what the URDF says
    assert by_name['fv_elbow'] == pytest.approx(0.002 * 10.0 / 3.0)
    radius = np.sqrt(0.5 * (0.004 + 2 * (0.01 + 0.15 ** 2)))  # of gyration, about the joint
    assert by_name['elbow.mx'] == pytest.approx(0.25 * radius)
    assert (usual > 0.0).all()
    loaded = parameter_deviation(arm, *stated, 2.0, np.ones(2))
    np.testing.assert_allclose(loaded ** 2 - usual ** 2, (2.0 * arm.payload_direction) ** 2,
                               atol=1e-12)


def test_a_friction_that_the_urdf_does_not_have_is_off_by_half_the_damping_at_most(
        arm: UrdfArm) -> None:
    stated = np.array([2.0, 3.0]), np.array([40.0, 10.0]), 0.0
    light = dict(zip(arm.parameters, parameter_deviation(arm, *stated, np.array([1e-3, 2e-3]))))
    assert light['fv_elbow'] == pytest.approx(1e-3)  # of which the URDF has none
    assert light['fv_shoulder'] == pytest.approx(0.25)  # half of what it says


def test_pairs_of_joints_that_stick_are_no_exact_data(urdf: str) -> None:
    plain, dry = (load_arm(urdf, coulomb=each) for each in (False, True))
    limit = np.array([40.0, 10.0])
    assert stuck_error(plain, limit) == 0.0
    assert stuck_error(dry, limit) == pytest.approx(0.3 * np.hypot(0.08, 0.02) / np.sqrt(2.0))
    assert recipe(dry, Robot()).adaptation.kh < 0.1 * recipe(plain, Robot()).adaptation.kh


def test_a_start_from_zero_gets_bounds_as_wide_as_the_fall_that_it_begins_with(
        arm: UrdfArm) -> None:
    usual, zero = (recipe(arm, Robot(**SENSORS, from_zero=each)) for each in (False, True))
    assert (zero.start_error > 1.5 * usual.start_error).all()
    assert (zero.motion.bound > usual.motion.bound).any()
    same = zero.motion.bound ** 2 / usual.motion.bound ** 2
    np.testing.assert_allclose(zero.gains.barrier_weight / usual.gains.barrier_weight, same,
                               rtol=0.2)


def test_friction_on_a_small_inertia_is_simulated_in_steps_that_are_stable(urdf: str) -> None:
    rough = load_arm(urdf.replace('<limit velocity="3"', '<dynamics damping="200"/>'
                                  '<limit velocity="3"'))
    found = recipe(rough, Robot())
    inertia = found.inertia.least[1]
    assert found.substeps >= 200.0 / inertia / 1000.0 / 2.8
    assert recipe(load_arm(urdf), Robot()).substeps == 1


def test_the_text_says_why(arm: UrdfArm) -> None:
    text = recipe_text(recipe(arm, Robot(**SENSORS, payload=1.0)))
    for part in ('shoulder', 'elbow', 'inertia seen', 'reserve', 'lambda_max(M^-1 k2)',
                 'ms of further delay', 'rad a count', 'assumed', 'collisions'):
        assert part in text
    weak = recipe_text(recipe(arm, Robot(torque_limit=(12.0, 4.0))))
    assert 'of its torque limit' in weak


def test_the_first_filter_of_noisy_sensors_costs_what_it_says(arm: UrdfArm) -> None:
    quiet, noisy = (recipe(arm, Robot(**each)).filters for each in ({}, SENSORS))
    assert quiet.state_order == 0
    assert noisy.state_order == 4
    assert noisy.motion_error == pytest.approx(filter_cost(
        arm, recipe(arm, Robot(**SENSORS)).motion.reference, arm.nominal, noisy.state_order,
        noisy.state_time_constant))
    assert 0.0 < noisy.motion_error < 0.01


@pytest.mark.parametrize(('changes', 'name'), [
    ({'rate': 0.0}, 'loop.rate'), ({'delay': -1.0}, 'loop.delay'),
    ({'encoder_counts': 0}, '--encoder'), ({'payload': -1.0}, '--payload'),
    ({'torque_noise': np.inf}, '--torque-noise'), ({'width': 0.0}, '--width'),
    ({'amplitude': np.nan}, '--amplitude'), ({'torque_limit': (1.0, 2.0, 3.0)}, '--torque-limit'),
    ({'torque_limit': (0.0,)}, '--torque-limit')])
def test_what_no_robot_has_is_refused_by_name(arm: UrdfArm, changes, name) -> None:
    with pytest.raises(ParameterError, match=name):
        recipe(arm, Robot(**changes))


def test_bounds_leave_half_as_much_again_as_a_load_put_on_at_once_needs(arm: UrdfArm) -> None:
    loaded, free = (recipe(arm, Robot(payload=mass, **SENSORS)) for mass in (1.0, 0.0))
    assert (loaded.motion.bound > free.motion.bound).any()
    widest = 0.15 * (loaded.limits.upper - loaded.limits.lower)
    short = 1.5 * loaded.payload_error > loaded.motion.bound * (1.0 + 1e-3)  # bounds are rounded
    assert (np.isclose(loaded.motion.bound, widest, atol=1e-4) | ~short).all()
    assert not short.all()


def _with_friction(urdf: str, shoulder: float, elbow: float) -> str:
    text = urdf.replace('damping="0.5"', f'damping="0.5" friction="{shoulder}"')
    limit = '<limit velocity="3"'
    return text.replace(limit, f'<dynamics friction="{elbow}"/>{limit}')


def test_a_dry_friction_of_the_urdf_gets_the_filter_that_distorts_it_less(urdf: str) -> None:
    rough = load_arm(_with_friction(urdf, 2.0, 0.5), coulomb=True)
    found = recipe(rough, Robot(**SENSORS))
    smooth = recipe(load_arm(urdf), Robot(**SENSORS)).filters
    assert found.filters.state_time_constant < 0.7 * smooth.state_time_constant
    assert found.filters.motion_error < 0.7 * filter_cost(
        rough, found.motion.reference, rough.nominal, smooth.state_order,
        smooth.state_time_constant)


def test_a_dry_friction_that_is_only_learned_is_expected_to_be_a_hundredth_of_the_limit(
        urdf: str) -> None:
    """Its estimate would be too small by what a slow filter takes from it."""
    learned, stated, smooth = (recipe(load_arm(text, coulomb=coulomb), Robot(**SENSORS)).filters
                               for text, coulomb in (
        (urdf, True), (_with_friction(urdf, 0.4, 0.1), True), (urdf, None)))
    assert learned == stated
    assert learned.state_time_constant < 0.7 * smooth.state_time_constant
