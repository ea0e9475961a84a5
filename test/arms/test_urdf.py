# SPDX-License-Identifier: Apache-2.0
"""Facts about the regressors and the forward dynamics of arms from a URDF."""

from __future__ import annotations

from collections.abc import Callable
import copy
import pickle
from typing import Any, NamedTuple

import numpy as np
import pytest

from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.arms.urdf_source import read_urdf
from adaptive_blf_control.errors import ArmError, ParameterError

pin = pytest.importorskip('pinocchio')

ROBOTS = 'package://example-robot-data/robots'
PANDA_JOINTS = tuple(f'panda_joint{i}' for i in range(1, 8))
URDFS = {'panda': (f'{ROBOTS}/panda_description/urdf/panda.urdf', PANDA_JOINTS, 43),
         'ur10': (f'{ROBOTS}/ur_description/urdf/ur10_robot.urdf', None, 36),
         'so101': (f'{ROBOTS}/so_arm_description/urdf/so101.urdf', None, 36),
         # continuous joints
         'kinova': (f'{ROBOTS}/kinova_description/robots/kinova.urdf', None, 36)}
COULOMB_VELOCITY = 0.05
STATES = 50


class Case(NamedTuple):
    """An arm, and Pinocchio's own model of the same joints to compare with."""

    arm: UrdfArm
    model: Any
    data: Any
    friction: np.ndarray

    def configuration(self, q: np.ndarray) -> np.ndarray:
        """Return Pinocchio's configuration, joint by joint."""
        parts = [[value] if joint.nq == 1 else [np.cos(value), np.sin(value)]
                 for value, joint in zip(q, list(self.model.joints)[1:], strict=True)]
        return np.concatenate(parts)

    def friction_torque(self, qd: np.ndarray) -> np.ndarray:
        """Return the friction the arm was built with."""
        viscous, coulomb, offset = self.friction
        return viscous * qd + coulomb * np.tanh(qd / COULOMB_VELOCITY) + offset

    def rnea(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        """Return the torque of Pinocchio's Newton-Euler algorithm with the friction added."""
        torque = pin.rnea(self.model, self.data, self.configuration(q), qd, qdd)
        return torque + self.friction_torque(qd)

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """Return Pinocchio's mass matrix."""
        upper = np.triu(pin.crba(self.model, self.data, self.configuration(q)))
        return upper + np.triu(upper, 1).T


def needs_robots(source: str) -> str:
    try:
        return read_urdf(source)
    except ArmError:
        pytest.skip('example-robot-data is not installed')


@pytest.fixture(scope='module', params=list(URDFS))
def case(request: pytest.FixtureRequest) -> Case:
    source, joints, _ = URDFS[request.param]
    xml = needs_robots(source)
    model = pin.buildModelFromXML(xml)
    names = joints or tuple(list(model.names)[1:])
    locked = [i for i in range(1, model.njoints) if model.names[i] not in names]
    model = pin.buildReducedModel(model, locked, pin.neutral(model))
    friction = np.random.default_rng(1).uniform(0.1, 1.0, (3, len(names)))
    arm = UrdfArm(source, joints, friction_coulomb=True, friction_offset=True,
                  coulomb_velocity=COULOMB_VELOCITY, viscous=friction[0], coulomb=friction[1],
                  offset=friction[2])
    return Case(arm, model, model.createData(), friction)


@pytest.fixture
def states(case: Case) -> np.ndarray:
    """Random positions and three random vectors, shape (50, 4, n)."""
    random = np.random.default_rng(2)
    result = random.uniform(-1.5, 1.5, (STATES, 4, case.arm.n))
    result[:, 0] = random.uniform(-np.pi, np.pi, (STATES, case.arm.n))
    return result


def panda(**options: Any) -> UrdfArm:
    options.setdefault('joints', PANDA_JOINTS)
    needs_robots(URDFS['panda'][0])
    return UrdfArm(URDFS['panda'][0], **options)


def derivative(function: Callable[[float], np.ndarray], step: float = 1e-3) -> np.ndarray:
    """Return the derivative at zero to fourth order."""
    return (8.0 * (function(step) - function(-step))
            - (function(2.0 * step) - function(-2.0 * step))) / (12.0 * step)


def test_regressor_times_parameters_equals_newton_euler(case: Case, states: np.ndarray) -> None:
    for q, qd, qdd, _ in states:
        np.testing.assert_allclose(case.arm.Y(q, qd, qdd) @ case.arm.nominal,
                                   case.rnea(q, qd, qdd), atol=1e-6)


def test_momentum_regressor_equals_mass_matrix_times_velocity(case: Case,
                                                              states: np.ndarray) -> None:
    for q, qd, _, _ in states:
        expected = case.mass_matrix(q) @ qd
        np.testing.assert_allclose(case.arm.Y1(q, qd) @ case.arm.nominal, expected, atol=1e-6)


def test_shared_call_gives_both_regressors(case: Case, states: np.ndarray) -> None:
    for q, qd, _, _ in states:
        y1, y2 = case.arm.Y12(q, qd)
        np.testing.assert_allclose(y1, case.arm.Y1(q, qd), atol=1e-14)
        np.testing.assert_array_equal(y2, case.arm.Y2(q, qd))


def test_momentum_derivative_and_second_regressor_give_the_torque(case: Case,
                                                                  states: np.ndarray) -> None:
    for q, qd, qdd, _ in states:
        change = derivative(lambda t, q=q, qd=qd, qdd=qdd: case.arm.Y1(
            q + t * qd + 0.5 * t * t * qdd, qd + t * qdd))
        torque = (change + case.arm.Y2(q, qd)) @ case.arm.nominal
        np.testing.assert_allclose(torque, case.rnea(q, qd, qdd), atol=1e-6)


def test_second_regressor_is_exact_column_by_column(case: Case, states: np.ndarray) -> None:
    for q, qd, qdd, _ in states[:10]:
        change = derivative(lambda t, q=q, qd=qd, qdd=qdd: case.arm.Y1(
            q + t * qd + 0.5 * t * t * qdd, qd + t * qdd))
        np.testing.assert_allclose(change + case.arm.Y2(q, qd), case.arm.Y(q, qd, qdd), atol=1e-8)


def test_control_regressor_along_the_motion_is_the_inverse_dynamics(case: Case,
                                                                    states: np.ndarray) -> None:
    for q, qd, qdd, _ in states:
        np.testing.assert_allclose(case.arm.X(q, qd, qd, qdd), case.arm.Y(q, qd, qdd),
                                   atol=1e-12)


def test_control_regressor_keeps_the_identity_of_the_protocol(case: Case,
                                                              states: np.ndarray) -> None:
    arm, theta = case.arm, case.arm.nominal
    for q, qd, alpha, alpha_dot in states:
        e2 = qd - alpha
        mass_rate = derivative(lambda t, q=q, qd=qd: case.mass_matrix(q + t * qd))
        rest = (arm.X(q, qd, alpha, alpha_dot) @ theta - case.rnea(q, qd, alpha_dot)
                + 0.5 * mass_rate @ e2)
        assert abs(e2 @ rest) < 1e-6


def coriolis_matrix(case: Case, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
    arm, zero = case.arm, np.zeros(case.arm.n)
    still = arm.X(q, qd, zero, zero) @ arm.nominal  # gravity and friction
    return np.column_stack([arm.X(q, qd, axis, zero) @ arm.nominal - still
                            for axis in np.eye(arm.n)])


def test_coriolis_matrix_is_the_christoffel_one(case: Case, states: np.ndarray) -> None:
    for q, qd, _, _ in states:
        expected = pin.computeCoriolisMatrix(case.model, case.data, case.configuration(q), qd)
        coriolis = coriolis_matrix(case, q, qd)
        np.testing.assert_allclose(coriolis @ qd, expected @ qd, atol=1e-6)
        mass_rate = derivative(lambda t, q=q, qd=qd: case.mass_matrix(q + t * qd))
        skew = mass_rate - 2.0 * coriolis
        np.testing.assert_allclose(skew + skew.T, 0.0, atol=1e-6)


def test_mass_matrix_is_symmetric_and_positive_definite(case: Case, states: np.ndarray) -> None:
    dynamics = case.arm.dynamics(case.arm.nominal)
    for q in states[:, 0]:
        for mass in (case.arm.mass_matrix(q), dynamics.mass_matrix(q)):
            np.testing.assert_allclose(mass, mass.T, atol=1e-12)
            np.testing.assert_allclose(mass, case.mass_matrix(q), atol=1e-6)
            assert np.linalg.eigvalsh(mass)[0] > 0.0


def test_forward_dynamics_inverts_inverse_dynamics(case: Case, states: np.ndarray) -> None:
    dynamics = case.arm.dynamics(case.arm.nominal)
    for q, qd, qdd, _ in states:
        np.testing.assert_allclose(dynamics.acceleration(q, qd, case.rnea(q, qd, qdd)), qdd,
                                   rtol=1e-8, atol=1e-8)


def test_dynamics_of_other_parameters_matches_their_regressor(case: Case,
                                                              states: np.ndarray) -> None:
    arm = case.arm
    inertial = arm.inertial * np.linspace(0.8, 1.3, arm.n)[:, None]
    theta = np.concatenate([arm.base_from_inertial(inertial),
                            1.5 * arm.nominal[arm.base_count:]])
    dynamics = arm.dynamics(theta)
    for q, qd, qdd, _ in states:
        torque = arm.Y(q, qd, qdd) @ theta
        residual = dynamics.mass_matrix(q) @ (dynamics.acceleration(q, qd, torque) - qdd)
        np.testing.assert_allclose(residual, 0.0, atol=1e-6)
        np.testing.assert_allclose(dynamics.mass_matrix(q), arm.mass_matrix(q, theta), atol=1e-6)


def test_base_parameters_are_counted_and_independent(case: Case, states: np.ndarray,
                                                     request: pytest.FixtureRequest) -> None:
    arm = case.arm
    assert arm.base_count == URDFS[request.node.callspec.params['case']][2]
    stack = np.concatenate([arm.Y(*state[:3]) for state in states])
    values = np.linalg.svd(stack / np.linalg.norm(stack, axis=0), compute_uv=False)
    assert values[-1] > 1e-3 * values[0]
    assert len(set(arm.parameters)) == arm.m == arm.base_count + 3 * arm.n


def test_nominal_parameters_give_back_the_urdf_bit_for_bit(case: Case) -> None:
    arm = case.arm
    np.testing.assert_array_equal(arm.to_inertial(arm.nominal), arm.inertial)
    expected = [body.toDynamicParameters() for body in list(case.model.inertias)[1:]]
    np.testing.assert_allclose(arm.inertial, expected, rtol=1e-12, atol=1e-15)


def test_inertial_parameters_map_to_the_base_and_back(case: Case) -> None:
    arm = case.arm
    theta = np.random.default_rng(3).normal(size=arm.m)
    np.testing.assert_allclose(arm.base_from_inertial(arm.to_inertial(theta)),
                               theta[:arm.base_count], atol=1e-12)
    np.testing.assert_array_equal(arm.to_inertial(theta)[:, 0], arm.inertial[:, 0])


def test_joint_order_permutes_rows_and_nothing_else() -> None:
    order = np.array([2, 0, 6, 1, 5, 4, 3])
    straight, shuffled = panda(), panda(joints=[PANDA_JOINTS[i] for i in order])
    assert shuffled.joints == tuple(PANDA_JOINTS[i] for i in order)
    columns = [shuffled.parameters.index(name) for name in straight.parameters]
    q, qd, alpha, alpha_dot = np.random.default_rng(4).uniform(-1.0, 1.0, (4, 7))
    here = [value[order] for value in (q, qd, alpha, alpha_dot)]
    for name, count in (('Y1', 2), ('Y2', 2), ('X', 4), ('Y', 3)):
        expected = getattr(straight, name)(*(q, qd, alpha, alpha_dot)[:count])
        found = getattr(shuffled, name)(*here[:count])
        np.testing.assert_allclose(found[:, columns], expected[order], atol=1e-12)
    np.testing.assert_array_equal(shuffled.inertial, straight.inertial[order])
    np.testing.assert_array_equal(shuffled.torque_limit, straight.torque_limit[order])
    np.testing.assert_array_equal(shuffled.position_lower, straight.position_lower[order])
    np.testing.assert_allclose(shuffled.nominal[columns], straight.nominal, atol=1e-12)
    np.testing.assert_allclose(shuffled.mass_matrix(here[0]),
                               straight.mass_matrix(q)[np.ix_(order, order)], atol=1e-12)
    expected = straight.dynamics(straight.nominal).acceleration(q, qd, alpha)
    found = shuffled.dynamics(shuffled.nominal).acceleration(here[0], here[1], here[2])
    np.testing.assert_allclose(found, expected[order], rtol=1e-9)


def test_joint_order_holds_for_continuous_joints() -> None:
    source = URDFS['kinova'][0]
    needs_robots(source)
    straight = UrdfArm(source)
    order = np.array([5, 1, 3, 0, 2, 4])
    shuffled = UrdfArm(source, [straight.joints[i] for i in order])
    q, qd, qdd = np.random.default_rng(5).uniform(-3.0, 3.0, (3, 6))
    torque = straight.Y(q, qd, qdd) @ straight.nominal
    np.testing.assert_allclose(shuffled.Y(q[order], qd[order], qdd[order]) @ shuffled.nominal,
                               torque[order], atol=1e-9)
    turn = 2.0 * np.pi * np.isinf(straight.position_upper)
    assert turn.any()
    np.testing.assert_allclose(straight.Y2(q + turn, qd), straight.Y2(q, qd), atol=1e-12)


def test_locked_joints_are_held_at_zero_with_their_masses() -> None:
    arm = panda(joints=PANDA_JOINTS[1:5])
    whole = panda()
    q, qd, qdd = np.zeros((3, 7))
    q[1:5], qd[1:5], qdd[1:5] = np.random.default_rng(6).uniform(-1.0, 1.0, (3, 4))
    torque = whole.Y(q, qd, qdd) @ whole.nominal
    np.testing.assert_allclose(arm.Y(q[1:5], qd[1:5], qdd[1:5]) @ arm.nominal, torque[1:5],
                               atol=1e-9)


def test_a_joint_that_mimics_another_is_locked_by_default() -> None:
    needs_robots(URDFS['panda'][0])
    assert UrdfArm(URDFS['panda'][0]).joints == (*PANDA_JOINTS, 'panda_finger_joint1')


def test_energy_is_kept_without_friction_and_torque() -> None:
    arm = panda(friction_viscous=False, gravity=(0.0, 0.0, 0.0))
    dynamics = arm.dynamics(arm.nominal)
    q, qd = np.random.default_rng(7).uniform(-1.0, 1.0, (2, 7))
    before = qd @ dynamics.mass_matrix(q) @ qd
    q, qd = dynamics.advance(q, qd, np.zeros(7), 0.5, 500)
    assert qd @ dynamics.mass_matrix(q) @ qd == pytest.approx(before, rel=1e-8)


def test_integration_is_of_fourth_order() -> None:
    arm = panda(viscous=0.5)
    dynamics = arm.dynamics(arm.nominal)
    q, qd, tau = np.random.default_rng(8).uniform(-1.0, 1.0, (3, 7))
    fine, _ = dynamics.advance(q, qd, tau, 0.1, 2560)
    errors = [np.abs(dynamics.advance(q, qd, tau, 0.1, k)[0] - fine).max() for k in (40, 80)]
    assert 12.0 < errors[0] / errors[1] < 20.0


def test_gravity_turns_with_its_vector() -> None:
    weightless, hanging = panda(gravity=(0.0, 0.0, 0.0)), panda(gravity=(0.0, 0.0, 9.81))
    zero, q = np.zeros(7), np.linspace(-1.0, 1.0, 7)
    np.testing.assert_array_equal(weightless.Y2(q, zero), 0.0)
    arm = panda()
    np.testing.assert_allclose(hanging.Y2(q, zero) @ hanging.nominal,
                               -arm.Y2(q, zero) @ arm.nominal, atol=1e-9)
    assert weightless.base_count < arm.base_count


def test_friction_columns_follow_the_choice() -> None:
    assert panda(friction_viscous=False).m == 43
    arm = panda(friction_coulomb=True)
    assert arm.parameters[43:] == tuple(f'{kind}_{joint}' for kind in ('fv', 'fc')
                                        for joint in PANDA_JOINTS)
    np.testing.assert_array_equal(arm.nominal[43:50], 0.003)  # <dynamics damping> of the URDF
    np.testing.assert_array_equal(arm.torque_limit, [87.0] * 4 + [12.0] * 3)
    assert panda(viscous=0.5).nominal[-1] == 0.5


@pytest.mark.parametrize(('options', 'name'), [
    ({'viscous': [1.0, 2.0]}, 'viscous'), ({'viscous': -1.0}, 'viscous'),
    ({'viscous': float('nan')}, 'viscous'), ({'viscous': 'much'}, 'viscous'),
    ({'coulomb': 1.0}, 'coulomb'), ({'offset': 1.0}, 'offset'),
    ({'coulomb_velocity': 0.0}, 'coulomb_velocity'), ({'gravity': 9.81}, 'gravity'),
    ({'gravity': (0.0, 9.81)}, 'gravity')])
def test_numbers_out_of_range_are_named(options: dict[str, Any], name: str) -> None:
    with pytest.raises(ParameterError) as error:
        panda(**options)
    assert error.value.name == name


def test_impossible_inertias_are_refused() -> None:
    arm = panda()
    theta = arm.nominal.copy()
    theta[arm.parameters.index('panda_joint7.Izz')] = -0.5
    with pytest.raises(ArmError, match='positive definite'):
        arm.dynamics(theta)
    with pytest.raises(ArmError, match='expected 50'):
        arm.dynamics(theta[:-1])
    with pytest.raises(ArmError, match='finite'):
        arm.dynamics(np.full(arm.m, np.nan))
    with pytest.raises(ArmError, match='positive definite'):
        arm.dynamics(np.zeros(arm.m))


def test_link_points_follow_the_joint_frames_from_the_root_on(case: Case,
                                                              states: np.ndarray) -> None:
    model, data = case.model, case.data
    for q in states[:5, 0]:
        points = case.arm.link_points(q)
        pin.forwardKinematics(model, data, case.configuration(q))
        origins = np.array([placement.translation for placement in list(data.oMi)])
        assert points.shape[1] == 3
        np.testing.assert_array_equal(points[0], np.zeros(3))
        for point in points[1:-1]:
            assert np.linalg.norm(origins - point, axis=1).min() < 1e-12


def test_link_points_of_the_panda_end_at_its_hand_whatever_the_order_of_the_joints() -> None:
    q = np.random.default_rng(3).uniform(-1.5, 1.5, 7)
    arm, reverse = panda(), panda(joints=PANDA_JOINTS[::-1])
    points = arm.link_points(q)
    assert points.shape == (9, 3)
    np.testing.assert_allclose(reverse.link_points(q[::-1]), points, atol=1e-12)
    # from the wrist's axis: 0.107 m to the flange and 0.1034 m to the tool's centre
    assert np.linalg.norm(points[-1] - points[-2]) == pytest.approx(0.107 + 0.1034, abs=1e-3)


def test_a_payload_adds_the_torque_of_a_point_mass_at_the_tip(case: Case,
                                                              states: np.ndarray) -> None:
    model = case.model.copy()
    chain = max((list(support) for support in model.supports), key=len)
    tip = max(i for i, frame in enumerate(model.frames) if frame.parentJoint == chain[-1])
    model.appendBodyToJoint(chain[-1], pin.Inertia(2.0, np.zeros(3), np.zeros((3, 3))),
                            model.frames[tip].placement)
    loaded = Case(case.arm, model, model.createData(), case.friction)
    theta = case.arm.nominal + 2.0 * case.arm.payload_direction
    for q, qd, qdd, _ in states[:10]:
        np.testing.assert_allclose(case.arm.Y(q, qd, qdd) @ theta, loaded.rnea(q, qd, qdd),
                                   atol=1e-5)


@pytest.mark.parametrize('duplicate', [copy.deepcopy, lambda arm: pickle.loads(pickle.dumps(arm))])
def test_a_copy_computes_the_same_bits(duplicate: Callable[[UrdfArm], UrdfArm]) -> None:
    arm = panda(friction_coulomb=True)
    other = duplicate(arm)
    q, qd, qdd = np.random.default_rng(4).uniform(-1.0, 1.0, (3, arm.n))
    assert other.parameters == arm.parameters
    np.testing.assert_array_equal(other.X(q, qd, qd, qdd), arm.X(q, qd, qd, qdd))
    np.testing.assert_array_equal(other.link_points(q), arm.link_points(q))
    np.testing.assert_array_equal(other.dynamics(other.nominal).acceleration(q, qd, qdd),
                                  arm.dynamics(arm.nominal).acceleration(q, qd, qdd))
