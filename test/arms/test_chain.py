# SPDX-License-Identifier: Apache-2.0
"""Facts about chains: every regressor and the dynamics are Pinocchio's, column by column."""

from __future__ import annotations

from collections.abc import Iterator
import os
import subprocess
import sys
from typing import Any, NamedTuple

import numpy as np
import pytest

from adaptive_blf_control.arms import chain_regressors
from adaptive_blf_control.arms.base_parameters import INERTIAL_NAMES, PER_BODY
from adaptive_blf_control.arms.chain import add_wrench_torque, placements, subtree_ends
from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.arms.urdf_source import read_urdf
from adaptive_blf_control.compiled import COMPILED
from adaptive_blf_control.errors import ArmError, ParameterError

pin = pytest.importorskip('pinocchio')

ROBOTS = 'package://example-robot-data/robots'
BRANCHED = """<robot name="branched">
  <link name="base"/>
  {links}
  <joint name="a" type="revolute"><parent link="base"/><child link="la"/>
    <origin xyz="0.1 0.2 0.3" rpy="0.3 0.2 0.1"/><axis xyz="1 2 3"/>
    <limit lower="-2" upper="2" effort="50" velocity="2"/></joint>
  <joint name="d" type="prismatic"><parent link="la"/><child link="ld"/>
    <origin xyz="0.2 0 0.1" rpy="0 0.5 0"/><axis xyz="0 1 -1"/>
    <limit lower="-1" upper="1" effort="50" velocity="2"/></joint>
  <joint name="c" type="continuous"><parent link="la"/><child link="lc"/>
    <origin xyz="0 -0.2 0.1"/><axis xyz="1 1 0"/></joint>
  <joint name="b" type="prismatic"><parent link="lc"/><child link="lb"/>
    <origin xyz="0.1 0 0" rpy="1 0 0"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="1" effort="50" velocity="2"/></joint>
  <joint name="locked" type="revolute"><parent link="ld"/><child link="le"/>
    <origin xyz="0 0 0.2" rpy="0 1 0"/><axis xyz="0 0 1"/>
    <limit lower="-2" upper="2" effort="50" velocity="2"/></joint>
  <joint name="e" type="revolute"><parent link="ld"/><child link="lf"/>
    <origin xyz="0.1 0.1 0.2" rpy="0.4 1 0"/><axis xyz="-1 0 2"/>
    <limit lower="-2" upper="2" effort="50" velocity="2"/></joint>
</robot>""".format(links=''.join(f"""
  <link name="l{name}"><inertial><mass value="{mass}"/><origin xyz="0.05 -0.02 {0.01 * mass}"/>
    <inertia ixx="0.03" iyy="0.04" izz="0.05" ixy="0.002" ixz="-0.001" iyz="0.003"/>
  </inertial></link>""" for mass, name in enumerate('abcdef', start=1)))
ARM = tuple(f'arm_{i}_joint' for i in range(1, 8))
SHOULDERS = tuple(f'{side}_{joint}' for side in ('left', 'right')
                  for joint in ('s0', 's1', 'e0', 'e1'))
URDFS = {
    'panda': (f'{ROBOTS}/panda_description/urdf/panda.urdf',
              tuple(f'panda_joint{i}' for i in range(1, 8))),
    'panda with a finger': (f'{ROBOTS}/panda_description/urdf/panda.urdf', None),
    'ur5': (f'{ROBOTS}/ur_description/urdf/ur5_robot.urdf', None),
    'ur10': (f'{ROBOTS}/ur_description/urdf/ur10_robot.urdf', None),
    'kinova j2s6s200': (f'{ROBOTS}/kinova_description/robots/kinova.urdf', None),
    'xarm7': (f'{ROBOTS}/xarm_description/urdf/xarm7.urdf', None),
    'z1': (f'{ROBOTS}/z1_description/urdf/z1.urdf', None),
    'so101': (f'{ROBOTS}/so_arm_description/urdf/so101.urdf', None),
    'tiago, torso and arm': (f'{ROBOTS}/tiago_description/robots/tiago.urdf',
                             ('torso_lift_joint', *ARM)),
    'baxter, two arms without wrists': (f'{ROBOTS}/baxter_description/urdf/baxter.urdf',
                                        SHOULDERS),
    'allegro hand': (f'{ROBOTS}/allegro_hand_description/urdf/allegro_right_hand.urdf', None),
    'a tree with skew axes': (BRANCHED, ('a', 'b', 'c', 'd', 'e')),
    'a single joint': (BRANCHED, ('d',)),
}
TOLERANCE = 1e-10
VELOCITY = 0.05  # of Coulomb friction


class Case(NamedTuple):
    """An arm with all kinds of friction, and Pinocchio's own model of the same joints."""

    arm: UrdfArm
    model: Any
    data: Any

    def ordered(self, values: np.ndarray) -> np.ndarray:
        """Return an array of the joints in Pinocchio's order."""
        return values[[self.arm.joints.index(name) for name in list(self.model.names)[1:]]]

    def configuration(self, q: np.ndarray) -> np.ndarray:
        """Return Pinocchio's configuration, joint by joint."""
        parts = [[value] if joint.nq == 1 else [np.cos(value), np.sin(value)]
                 for value, joint in zip(self.ordered(q), list(self.model.joints)[1:],
                                         strict=True)]
        return np.concatenate(parts)

    def rows(self, values: np.ndarray) -> np.ndarray:
        """Return an array in Pinocchio's order with its rows in the user's."""
        names = list(self.model.names)[1:]
        return values[[names.index(name) for name in self.arm.joints]]

    def columns(self) -> list[tuple[int, int]]:
        """Return Pinocchio's joint and the inertial parameter of each base column."""
        split = [name.rsplit('.', 1) for name in self.arm.parameters[:self.arm.base_count]]
        return [(self.model.getJointId(joint), INERTIAL_NAMES.index(kind))
                for joint, kind in split]

    def regressor(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray,
                  weight: bool = True) -> np.ndarray:
        """Return base columns of Pinocchio's joint torque regressor, in the user's order."""
        model = self.model
        gravity = model.gravity.linear.copy()
        model.gravity.linear = gravity if weight else np.zeros(3)
        standard = pin.computeJointTorqueRegressor(model, self.data, self.configuration(q),
                                                   self.ordered(qd), self.ordered(qdd))
        model.gravity.linear = gravity
        return self.rows(standard.reshape(self.arm.n, -1))[:, [PER_BODY * (joint - 1) + kind
                                       for joint, kind in self.columns()]]

    def friction(self, qd: np.ndarray) -> np.ndarray:
        """Return the columns of friction."""
        n = self.arm.n
        return np.hstack([np.diag(qd), np.diag(np.tanh(qd / VELOCITY)), np.eye(n)])

    def transposed_coriolis(self, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """Return base columns of Cᵀ q̇: one more unit of each parameter, one at a time."""
        model, columns = self.model, []
        square = (self.arm.n, self.arm.n)
        plain = pin.computeCoriolisMatrix(model, self.data, self.configuration(q),
                                          self.ordered(qd)).reshape(square).T @ self.ordered(qd)
        for joint, kind in self.columns():
            body = model.inertias[joint].copy()
            more = body.toDynamicParameters() + np.eye(PER_BODY)[kind]
            model.inertias[joint] = pin.Inertia.FromDynamicParameters(more)
            coriolis = pin.computeCoriolisMatrix(model, self.data, self.configuration(q),
                                                 self.ordered(qd))
            columns.append(self.rows(coriolis.reshape(square).T @ self.ordered(qd) - plain))
            model.inertias[joint] = body
        return np.array(columns).T


def build(source: str, joints: tuple[str, ...] | None, shuffled: bool) -> Case:
    try:
        xml = read_urdf(source)
    except ArmError:
        pytest.skip('example-robot-data is not installed')
    names = UrdfArm(xml, joints).joints
    model = pin.buildModelFromXML(xml)
    locked = [i for i in range(1, model.njoints) if model.names[i] not in names]
    if locked:
        model = pin.buildReducedModel(model, locked, pin.neutral(model))
    random = np.random.default_rng(1)
    if shuffled:
        names = tuple(random.permutation(names).tolist())
    viscous, coulomb, offset = random.uniform(0.1, 1.0, (3, len(names)))
    arm = UrdfArm(xml, names, friction_coulomb=True, friction_offset=True, viscous=viscous,
                  coulomb=coulomb, offset=offset, coulomb_velocity=VELOCITY,
                  gravity=(1.0, -2.0, -9.0))
    model.gravity.linear = np.array([1.0, -2.0, -9.0])
    return Case(arm, model, model.createData())


@pytest.fixture(scope='module', params=[(name, shuffled) for name in URDFS
                                        for shuffled in (False, True)],
                ids=lambda param: param[0] + (', shuffled' if param[1] else ''))
def case(request: pytest.FixtureRequest) -> Case:
    name, shuffled = request.param
    return build(*URDFS[name], shuffled)


def states(case: Case, count: int = 10) -> Iterator[np.ndarray]:
    """Yield q, q̇ and two more random vectors."""
    random = np.random.default_rng(2)
    for _ in range(count):
        yield random.uniform(-3.0, 3.0, (4, case.arm.n))


def same(found: np.ndarray, expected: np.ndarray) -> None:
    """Compare to 1e-10 of the largest element, which is about one for regressors."""
    scale = max(1.0, np.abs(expected).max())
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=TOLERANCE * scale)


def test_momentum_regressor(case: Case) -> None:
    zero = np.zeros(case.arm.n)
    for q, qd, _, _ in states(case):
        expected = np.hstack([case.regressor(q, zero, qd, weight=False),
                              np.zeros((case.arm.n, 3 * case.arm.n))])
        for found in (case.arm.Y12(q, qd)[0], case.arm.Y1(q, qd)):
            same(found, expected)


def test_second_regressor_is_weight_and_friction_less_the_gradient_of_kinetic_energy(
        case: Case) -> None:
    zero = np.zeros(case.arm.n)
    for q, qd, _, _ in states(case, 4):
        base = case.regressor(q, zero, zero) - case.transposed_coriolis(q, qd)
        expected = np.hstack([base, case.friction(qd)])
        for found in (case.arm.Y12(q, qd)[1], case.arm.Y2(q, qd)):
            same(found, expected)


def test_torque_regressor(case: Case) -> None:
    for q, qd, qdd, _ in states(case):
        expected = np.hstack([case.regressor(q, qd, qdd), case.friction(qd)])
        same(case.arm.Y(q, qd, qdd), expected)


def test_control_regressor_is_the_bilinear_form_of_the_quadratic_one(case: Case) -> None:
    zero = np.zeros(case.arm.n)
    for q, qd, alpha, alpha_dot in states(case):
        base = (case.regressor(q, 0.5 * (qd + alpha), alpha_dot)
                - case.regressor(q, 0.5 * (qd - alpha), zero, weight=False))
        same(case.arm.X(q, qd, alpha, alpha_dot), np.hstack([base, case.friction(qd)]))


def test_mass_matrix(case: Case) -> None:
    dynamics = case.arm.dynamics(case.arm.nominal)
    for q, _, _, _ in states(case):
        mass = pin.crba(case.model, case.data, case.configuration(q))
        upper = np.triu(mass.reshape(case.arm.n, -1))
        expected = case.rows(case.rows(upper + np.triu(upper, 1).T).T)
        same(dynamics.mass_matrix(q), expected)


def accelerations(case: Case, q: np.ndarray, qd: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """Return Pinocchio's, of its articulated-body algorithm."""
    drive = tau - case.friction(qd) @ case.arm.nominal[case.arm.base_count:]
    return case.rows(pin.aba(case.model, case.data, case.configuration(q), case.ordered(qd),
                             case.ordered(drive)))


def test_forward_dynamics(case: Case) -> None:
    dynamics = case.arm.dynamics(case.arm.nominal)
    for q, qd, tau, _ in states(case):
        same(dynamics.acceleration(q, qd, tau), accelerations(case, q, qd, tau))


def test_one_step_of_the_integrator(case: Case) -> None:
    dynamics, h = case.arm.dynamics(case.arm.nominal), 1e-3
    for q, qd, tau, _ in states(case, 3):
        def slope(state: np.ndarray, tau: np.ndarray = tau) -> np.ndarray:
            return np.array([state[1], accelerations(case, *state, tau)])

        state = np.array([q, qd])
        k1 = slope(state)
        k2 = slope(state + 0.5 * h * k1)
        k3 = slope(state + 0.5 * h * k2)
        k4 = slope(state + h * k3)
        expected = state + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        for found, wanted in zip(dynamics.advance(q, qd, tau, h, 1), expected, strict=True):
            same(found, wanted)


def test_frames_of_the_joints(case: Case) -> None:
    for q, _, _, _ in states(case, 3):
        frames, axes = placements(case.arm.chain.chain, q)
        pin.computeJointJacobians(case.model, case.data, case.configuration(q))
        for frame, expected in zip(frames, list(case.data.oMi), strict=True):
            same(frame, np.column_stack([expected.rotation, expected.translation]))
        same(axes, case.data.J.reshape(6, -1).T)


def test_a_wrench_on_a_link_is_moved_to_the_joints_by_its_jacobian(case: Case) -> None:
    frames = {frame.name: i for i, frame in enumerate(case.model.frames)}
    for q, first, second, _ in states(case, 2):
        wrench = np.concatenate([first, second, np.ones(6)])[:6]
        for name, link in case.arm.links().items():
            torque = np.zeros(case.arm.n)
            add_wrench_torque(torque, case.arm.chain.chain, q, link.body, link.origin, wrench)
            jacobian = pin.computeFrameJacobian(
                case.model, case.data, case.configuration(q), frames[name],
                pin.ReferenceFrame.LOCAL_WORLD_ALIGNED).reshape(6, -1)
            same(torque, case.rows(jacobian.T @ wrench))


def test_a_joint_carries_the_joints_of_its_subtree() -> None:
    parent = np.array([0, 1, 2, 1, 4, 0, 6])  # two branches on joint 1, and a second tree
    assert subtree_ends(parent).tolist() == [5, 3, 3, 5, 5, 7, 7]


def test_vectors_of_another_length_are_refused() -> None:
    arm = build(*URDFS['a tree with skew axes'], shuffled=False).arm
    dynamics = arm.dynamics(arm.nominal)
    right = np.zeros(5)
    for wrong in (np.zeros(4), np.zeros(6), np.zeros((5, 1)), 0.0):
        for call in (lambda v: arm.Y12(v, right), lambda v: arm.X(right, v, right, right),
                     lambda v: arm.X(right, right, right, v), lambda v: arm.Y(right, right, v),
                     lambda v: dynamics.acceleration(right, right, v), dynamics.mass_matrix,
                     lambda v: dynamics.advance(right, v, right, 1e-3, 1)):
            with pytest.raises(ParameterError, match=r'expected .*shape \(5,\)'):
                call(wrong)


@pytest.mark.skipif(not COMPILED, reason='numba is not installed or switched off')
def test_views_lists_and_frozen_arrays_compile_nothing_more() -> None:
    arm = build(*URDFS['a tree with skew axes'], shuffled=False).arm
    q, qd = np.random.default_rng(3).uniform(-1.0, 1.0, (2, 5))
    expected = arm.Y12(q, qd)
    before = len(chain_regressors.chain_Y12.signatures)
    frozen = q.copy()
    frozen.setflags(write=False)
    for form in (frozen, q.tolist(), np.column_stack([q, q])[:, 0]):
        np.testing.assert_array_equal(arm.Y12(form, qd), expected)
    assert len(chain_regressors.chain_Y12.signatures) == before


WARM = """
import sys
import numpy as np
from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.compiled import before_each_compilation
with before_each_compilation(lambda: print('compiled')):
    arm = UrdfArm(sys.argv[1])
    state = np.zeros(arm.n)
    arm.Y12(state, state)
    arm.X(state, state, state, state)
    dynamics = arm.dynamics(arm.nominal)
    dynamics.acceleration(state, state, state)
    dynamics.advance(state, state, state, 1e-3, 1)
"""


@pytest.mark.skipif(not COMPILED, reason='numba is not installed or switched off')
def test_a_second_process_compiles_nothing() -> None:
    runs = [subprocess.run([sys.executable, '-c', WARM, BRANCHED], check=True,
                           capture_output=True, text=True,
                           env={**os.environ, 'PYTHONPATH': os.pathsep.join(sys.path)})
            for _ in range(2)]
    assert runs[-1].stdout == ''
