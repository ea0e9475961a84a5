# SPDX-License-Identifier: Apache-2.0
"""Facts about the arm that MuJoCo moves: when torques act, what is measured, what changes it."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.errors import ArmError, ParameterError
from adaptive_blf_control.limits.link_spheres import sphere_centres
from adaptive_blf_control.limits.scene import given_spheres
from adaptive_blf_control.simulation.mujoco.library import load_mujoco
from adaptive_blf_control.simulation.mujoco.plant import MujocoPlant
from adaptive_blf_control.simulation.plant import truth_of
from adaptive_blf_control.simulation.rotation import rotation


@pytest.fixture
def made(two_links, two_link_settings):
    """Return ``made(**settings)``: the two links in MuJoCo."""
    return lambda **settings: MujocoPlant(two_link_settings.replace(**settings), two_links)


def scheduled(*changes):
    """Return the settings of a schedule of (time, parameter, value)."""
    times, names, values = zip(*changes)
    return {'schedule': {'time': list(times), 'parameter': list(names), 'value': list(values)}}


def energy(plant):
    """Return kinetic plus potential energy [J]."""
    mujoco, model, data = load_mujoco(), plant.arm_model.model, plant.data
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    mujoco.mj_forward(model, data)
    return data.energy.sum()


def held(plant, q, qdd=0.0):
    """Return the torque that holds the plant at q with an acceleration."""
    return plant.inverse_dynamics(np.array(q), np.zeros(2), np.full(2, qdd))


def test_the_torque_of_a_posture_keeps_the_arm_in_it(made):
    plant = made(initial_position=[0.5, -1.0])
    plant.apply(held(plant, [0.5, -1.0]))
    plant.advance(0.5)
    np.testing.assert_allclose(plant.q, [0.5, -1.0], atol=1e-9)
    assert plant.t == pytest.approx(0.5)


def test_the_first_acceleration_is_that_of_the_torque(made):
    plant = made()
    plant.apply(held(plant, [0.0, 0.0], qdd=2.0))
    plant.advance(1e-4)
    np.testing.assert_allclose(plant.qd, 2e-4, rtol=1e-3)


def test_energy_is_lost_to_damping_alone(made, mjcf):
    plant = made(true_friction={'viscous': [1e-12]}, initial_velocity=[2.0, -3.0],
                 mujoco={'model': mjcf, 'integrator': 'rk4'})
    before = energy(plant)
    plant.advance(2.0)
    assert energy(plant) == pytest.approx(before, rel=1e-6)


def test_a_delay_in_seconds_is_exact_between_samples_and_steps(made):
    plant = made(actuator={'delay': 0.00137})
    plant.apply(np.array([3.0, 0.0]))
    plant.advance(0.001)
    assert not plant.torque.any()
    plant.advance(0.001)
    assert plant.torque.tolist() == [3.0, 0.0]
    mean = plant.measure(np.zeros(2), 0.002).torque
    np.testing.assert_allclose(mean, [3.0 * 0.00063 / 0.002, 0.0], rtol=1e-9)


def test_effort_is_the_mean_or_what_acts_now_without_the_error_of_the_gain(made):
    for effort, expected in (('mean', 1.5), ('instant', 2.0)):
        plant = made(actuator={'effort': effort, 'gain_error': [0.5], 'torque_bias': [0.25]})
        plant.apply(np.array([1.0, 0.0]))
        plant.advance(0.001)
        plant.apply(np.array([2.0, 0.0]))
        plant.advance(0.001)
        measured = plant.measure(np.array([np.nan, np.nan]), 0.002).torque
        np.testing.assert_allclose(measured, [expected + 0.25, 0.25])
        assert plant.torque.tolist() == [3.0, 0.0]


def test_while_the_brakes_hold_no_torque_is_measured(made):
    assert np.isnan(made().measure(np.full(2, np.nan), 0.0).torque).all()


def test_sensors_are_those_of_every_plant(made):
    plant = made(initial_position=[0.123456, 0.0],
                 sensors={'model': 'encoder', 'encoder_counts': 100, 'gear_ratio': 1.0})
    step = 2.0 * np.pi / 100
    assert plant.measured_position()[0] == pytest.approx(round(0.123456 / step) * step)
    assert plant.measure(np.zeros(2), 0.0).q[0] == plant.measured_position()[0]


def test_the_drives_saturate(made):
    plant = made(torque_limit=[4.0])
    plant.apply(np.array([100.0, -100.0]))
    assert plant.torque.tolist() == [4.0, -4.0]


def test_a_simulation_that_diverges_is_an_error_and_no_file(made, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    plant = made(torque_limit=[1e300])
    plant.apply(np.full(2, 1e300))
    with pytest.raises(ArmError, match='MuJoCo diverges at 0.0000 s with the torque'):
        plant.advance(0.001)
    assert list(tmp_path.iterdir()) == []  # MuJoCo's own log


def test_the_brakes_hold_without_torque(made):
    plant = made(initial_velocity=[1.0, 1.0], actuator={'delay': 0.01})
    plant.apply(np.ones(2))
    plant.brake()
    assert not plant.qd.any()
    assert not plant.torque.any()


def test_a_change_acts_from_its_time_on_to_the_step(made):
    """A payload of 3 kg at the tip falls on an arm that was held: from 10.4 ms on, not before."""
    plant = made(**scheduled((0.0104, 'payload', 3.0)))
    plant.apply(held(plant, [0.0, 0.0]))
    plant.advance(0.01)
    before = np.abs(plant.qd).max()
    plant.advance(0.0004)
    assert np.abs(plant.qd).max() == pytest.approx(before, abs=1e-9)
    plant.advance(0.001)
    assert plant.qd[0] > 1e-3  # downwards is positive about +y


def test_a_payload_goes_as_it_came(made):
    plant = made(**scheduled((0.1, 'payload.hand', 2.0), (0.1, 'payload.hand.iyy', 0.1),
                             (0.2, 'payload.hand', 0.0)))
    q = [0.2, 0.3]
    plain = held(made(), q, 1.0)
    for t, same in ((0.0, True), (0.15, False), (0.25, True)):
        torque = plant.inverse_dynamics(np.array(q), np.zeros(2), np.ones(2), t)
        assert np.allclose(torque, plain, atol=1e-12) is same


def test_friction_changes_by_the_names_of_theta(made):
    plant = made(**scheduled((1.0, 'fv_elbow', 5.0), (1.0, 'fc_shoulder', 0.7),
                             (1.0, 'f0_elbow', -0.2)))
    q, qd = np.zeros(2), np.array([-1.0, 2.0])
    change = (plant.inverse_dynamics(q, qd, q, 2.0) - plant.inverse_dynamics(q, qd, q, 0.0))
    np.testing.assert_allclose(change, [-0.7, (5.0 - 0.2) * 2.0 - 0.2], atol=1e-12)


def test_a_constant_friction_is_overcome_by_as_much_torque(made):
    plant = made(true_friction={'offset': [2.0, -1.0]})
    plant.apply(held(made(), [0.0, 0.0]) + [2.0, -1.0])
    plant.advance(0.3)
    np.testing.assert_allclose(plant.q, 0.0, atol=1e-9)


def test_dry_friction_holds_what_it_can(made):
    plant = made(true_friction={'coulomb': [20.0]})
    plant.advance(0.5)
    assert np.abs(plant.q).max() < 1e-3
    plant = made(true_friction={'coulomb': [2.0]})  # 2 kg on 0.4 m need 8 N·m
    plant.advance(0.5)
    assert plant.q[0] > 0.1


def test_a_force_at_a_link_is_balanced_by_its_jacobian(made):
    """10 N upwards at the hand, 0.9 m from the shoulder: 9 and 4 N·m, until it ends."""
    plant = made(**scheduled((0.0, 'force.hand.z', 10.0), (0.5, 'force.hand.z', 0.0)))
    lifted = held(plant, [0.0, 0.0]) + [10.0 * 0.9, 10.0 * 0.4]  # about +y, up is negative
    plant.apply(lifted)
    plant.advance(0.4)
    np.testing.assert_allclose(plant.q, 0.0, atol=1e-6)
    plant.advance(0.2)
    assert np.abs(plant.q).max() > 1e-2


def test_a_torque_on_a_link_is_felt_by_every_joint_before_it(made):
    plant = made(**scheduled((0.0, 'torque.lower.y', 3.0)))
    plant.apply(held(plant, [0.0, 0.0]) - 3.0)
    plant.advance(0.3)
    np.testing.assert_allclose(plant.q, 0.0, atol=1e-6)


@pytest.mark.parametrize('contact', [
    {'shape': 'plane'}, {'shape': 'sphere', 'size': [0.3, 0.1, 0.1]}, {'shape': 'box'}])
def test_an_obstacle_ahead_stops_the_arm_and_goes(made, mjcf, contact):
    plant = made(initial_velocity=[1.0, 0.0], mujoco={
        'model': mjcf, 'contact': {**contact, 'gap': 0.01}},
        **scheduled((0.1, 'contact', 1.0), (0.5, 'contact', 0.0)))
    plant.advance(0.1)
    assert plant.touched == ()
    plant.advance(0.4)
    stopped = plant.q[0]
    (begin, _), *_ = plant.touched
    assert 0.1 < begin < 0.2
    plant.advance(0.5)
    assert plant.touched[-1][1] <= 0.5
    assert plant.q[0] > stopped + 0.1  # it falls on


def test_bounces_are_one_contact_and_a_later_touch_is_another(made):
    plant = made(initial_velocity=[1.0, 0.0], **scheduled(
        (0.0, 'contact', 1.0), (0.3, 'contact', 0.0), (0.5, 'contact', 1.0)))
    plant.advance(0.8)
    (_, end), (again, _) = plant.touched
    assert end <= 0.3
    assert again >= 0.5


def test_an_obstacle_at_a_fixed_place_is_hit_there(made, mjcf):
    """A plane 0.3 m below, tilted by nothing: the tip, a sphere of 5 cm, comes to 0.25 m."""
    plant = made(mujoco={'model': mjcf, 'contact': {
        'place': 'fixed', 'position': [0.0, 0.0, -0.3]}}, **scheduled((0.0, 'contact', 1.0)))
    lowest = 0.0
    for _ in range(400):
        plant.advance(0.005)
        data = plant.data
        lowest = min(lowest, data.geom('sphere that touches').xpos[2])
    assert lowest == pytest.approx(-0.25, abs=0.02)


def test_an_obstacle_stands_as_its_orientation_says(made, mjcf):
    angles = [0.3, -0.5, 0.7]
    plant = made(mujoco={'model': mjcf, 'contact': {
        'place': 'fixed', 'position': [0.0, 1.0, -2.0], 'orientation': angles}},
        **scheduled((0.0, 'contact', 1.0)))
    plant.advance(0.001)
    obstacle = plant.data.geom('obstacle of the schedule')
    np.testing.assert_allclose(obstacle.xpos, [0.0, 1.0, -2.0])
    np.testing.assert_allclose(obstacle.xmat.reshape(3, 3), rotation(np.array(angles)),
                               atol=1e-12)


def test_a_geom_of_the_model_can_be_touched(made):
    plant = made(**scheduled((0.0, 'contact.table', 1.0)))
    for _ in range(200):
        plant.advance(0.005)
    assert plant.touched
    assert made(**scheduled((0.0, 'contact.table', 0.0))).touched == ()


ON_THE_LINKS = [1.0, 0.25, 0.0, 0.0, 0.06, 2.0, 0.4, 0.0, 0.0, 0.05]


def test_what_stands_beside_the_arm_is_touched_by_the_spheres_on_its_links(made, mjcf):
    """The tip falls from 1 m on: a sphere of 5 cm on a plane, and a box under the first link."""
    for standing in ({'half_spaces': [0.0, 0.0, 0.7, 0.0, 0.0, 2.0]},
                     {'boxes': [0.2, 0.0, 0.7, 0.1, 0.1, 0.1]},
                     {'spheres': [0.8, 0.0, 0.7, 0.1]}):
        plant = made(mujoco={'model': mjcf, 'fixtures': {
            **{name: lower(rows) for name, rows in standing.items()},
            'link_spheres': ON_THE_LINKS}})
        plant.advance(1.0)
        (begin, _), *_ = plant.touched
        assert 0.1 < begin < 0.5
    assert made(mujoco={'model': mjcf, 'fixtures': {
        'spheres': [0.8, 0.0, 1.0, 0.1], 'link_spheres': ON_THE_LINKS}}).touched == ()


def lower(rows):
    """Return a row 1 m lower: the model has its shoulder at 0 m, the URDF at 1 m."""
    return [*rows[:2], rows[2] - 1.0, *rows[3:]]


def test_a_sphere_of_a_link_is_where_the_safety_filter_takes_it_to_be(panda, panda_settings):
    rows = [2.0, 0.0, -0.1, 0.05, 0.09, 4.0, -0.08, 0.14, 0.0, 0.07, 7.0, 0.0, 0.03, 0.21, 0.05]
    q = np.array([0.3, -0.7, 0.4, -1.7, -0.5, 1.3, 0.9])
    plant = MujocoPlant(panda_settings.replace(
        initial_position=q.tolist(), mujoco={'fixtures': {'link_spheres': rows}}), panda)
    load_mujoco().mj_kinematics(plant.arm_model.model, plant.data)
    chain = panda.chain.chain
    ours = sphere_centres(chain, given_spheres('', np.array(rows), chain, 7), q)
    theirs = [plant.data.geom(f'link sphere {k}').xpos for k in range(3)]
    np.testing.assert_allclose(theirs, ours, atol=1e-9)


@pytest.mark.parametrize(('standing', 'message'), [
    ({'spheres': [0.1, 0.2]}, 'fixtures.spheres.*4 numbers each'),
    ({'boxes': [0.1, 0.2, 0.3, 0.1, -0.1, 0.1]}, 'sizes > 0 m'),
    ({'half_spaces': [0.0] * 6}, 'a normal that is not zero'),
    ({'link_spheres': [3.0, 0.0, 0.0, 0.0, 0.1]}, 'fixtures.link_spheres.*joints from 1 to 2')])
def test_what_cannot_stand_there_is_refused(made, standing, message):
    with pytest.raises(ParameterError, match=message):
        made(mujoco={'fixtures': standing})


@pytest.mark.parametrize(('change', 'message'), [
    ((1.0, 'payload.gripper', 1.0), "is 'payload.gripper': .*links: upper, lower, hand"),
    ((1.0, 'force.upper', 1.0), "is 'force.upper'"),
    ((1.0, 'contact.wall', 1.0), 'geoms: table'),
    ((1.0, 'fv_wrist', 1.0), 'joints: shoulder, elbow'),
    ((1.0, 'contact', 0.5), '0.0 or 1.0'),
    ((1.0, 'payload.hand', -1.0), 'for payload.hand a finite value >= 0'),
    ((1.0, 'fc_elbow', -1.0), 'for fc_elbow a finite value >= 0')])
def test_a_schedule_of_what_is_not_there_names_what_is(made, change, message):
    with pytest.raises(ParameterError, match=message):
        made(**scheduled(change))


def test_changes_out_of_their_order_are_refused(made):
    with pytest.raises(ParameterError, match='not before the one before it, 2 s'):
        made(**scheduled((2.0, 'payload', 1.0), (1.0, 'payload', 0.0)))


def test_other_settings_are_taken_while_it_moves(made, two_link_settings):
    plant = made(initial_velocity=[1.0, 0.5])
    plant.apply(np.ones(2))
    plant.advance(0.01)
    q, qd = plant.q, plant.qd
    plant.retune(two_link_settings.replace(
        payload=2.0, torque_limit=[0.5], sensors={'model': 'encoder', 'encoder_counts': 4,
                                                  'gear_ratio': 1.0}))
    assert plant.q.tolist() == q.tolist()
    assert plant.qd.tolist() == qd.tolist()
    assert plant.t == pytest.approx(0.01)
    assert plant.torque.tolist() == [1.0, 1.0]
    assert plant.measured_position()[0] == 0.0
    plant.apply(np.ones(2))
    assert plant.torque.tolist() == [0.5, 0.5]
    heavier = held(plant, [0.0, 0.0]) - held(made(), [0.0, 0.0])
    np.testing.assert_allclose(heavier, [-9.81 * 2.0 * 0.5, 0.0])  # the URDF's tip is the elbow


def test_what_was_touched_is_known_after_other_settings(made, two_link_settings):
    plant = made(**scheduled((0.0, 'contact.table', 1.0)))
    while not plant.touched:
        plant.advance(0.01)
    plant.retune(two_link_settings.replace(payload=1.0))
    assert len(plant.touched) == 1


def test_a_schedule_that_cannot_be_taken_changes_nothing(made, two_link_settings):
    plant = made()
    model = plant.arm_model
    with pytest.raises(ParameterError, match='payload.gripper'):
        plant.retune(two_link_settings.replace(
            sensors={'model': 'encoder'}, **scheduled((1.0, 'payload.gripper', 1.0))))
    assert plant.arm_model is model
    assert plant.measured_position()[0] == plant.q[0]


@pytest.mark.parametrize(('settings', 'message'), [
    ({'true_model': 'given', 'true_parameters': [1.0]}, 'nominal: the arm in MuJoCo'),
    ({'schedule': {'time': [1.0, 2.0]}}, 'of the same length'),
    ({'mujoco': {'contact': {'link': 'gripper'}}}, 'contact.link.*one of upper, lower, hand'),
    ({'mujoco': {'step': 0.001}}, '<= 0.00025 s')])
def test_settings_that_cannot_be_are_refused_by_name(made, settings, message):
    with pytest.raises(ParameterError, match=message):
        made(**settings)


def test_theta_is_what_fits_the_inverse_dynamics_best(made, mjcf, two_links):
    text = mjcf.replace(' armature="0.01"', '')
    plant = made(mujoco={'model': text}, true_friction={'rotor_inertia': [0.3, 0.0]},
                 **scheduled((1.0, 'payload', 1.0)))
    (begin, theta), (change, loaded) = truth_of(plant, two_links.parameters)
    assert (begin, change) == (0.0, 1.0)
    assert not np.allclose(theta, loaded)
    q, qd, qdd = np.array([0.3, -0.5]), np.array([1.0, -2.0]), np.array([3.0, 1.0])
    for at, each in ((0.5, theta), (1.5, loaded)):
        np.testing.assert_allclose(two_links.Y(q, qd, qdd) @ each,
                                   plant.inverse_dynamics(q, qd, qdd, at), atol=1e-9)


def test_the_rotor_of_the_first_joint_is_an_inertia_and_that_of_others_is_not(panda,
                                                                            panda_settings):
    """A rotor does not turn with the links before it: base parameters cannot say so."""
    def fitted(rotor_inertia):
        settings = panda_settings.replace(true_friction={'rotor_inertia': rotor_inertia})
        fit, = MujocoPlant(settings, panda).fits(panda.parameters)
        return fit

    assert fitted([0.1, *[0.0] * 6]).residual.max() < 1e-9
    assert np.all(fitted([0.1]).residual[2:] > 0.1)
