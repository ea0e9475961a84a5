# SPDX-License-Identifier: Apache-2.0
"""An arm from a URDF: read by Pinocchio, regressors in base parameters and friction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import os
from typing import Any

import numpy as np

from adaptive_blf_control.arms.arm import ClosedArm
from adaptive_blf_control.arms.base_parameters import (
    BaseParameters,
    decompose,
    INERTIAL_NAMES,
    PER_BODY,
    preferred_columns,
)
from adaptive_blf_control.arms.chain import chain_of_model, Link
from adaptive_blf_control.arms.chain_dynamics import ChainInertias
from adaptive_blf_control.arms.chain_regressors import (
    chain_parameters,
    chain_X,
    chain_Y12,
    ChainParameters,
)
from adaptive_blf_control.arms.joint_friction import FRICTION_KINDS, JointFriction
from adaptive_blf_control.arms.pseudo_inertia import pseudo_inertias
from adaptive_blf_control.arms.urdf_dynamics import UrdfDynamics
from adaptive_blf_control.arms.urdf_model import (
    JointOrder,
    load_pinocchio,
    reduced_model,
    with_gravity,
)
from adaptive_blf_control.arms.urdf_nominal import checked_gravity, nominal_friction, nominal_rotor
from adaptive_blf_control.arms.urdf_source import read_urdf, UrdfSource
from adaptive_blf_control.arrays import (
    are_vectors,
    checked_array,
    checked_theta,
    checked_vectors,
    dimensions,
)
from adaptive_blf_control.calls import checked_call
from adaptive_blf_control.errors import ArmError

__all__ = ['UrdfArm']

_STATES = 100


class UrdfArm(ClosedArm, instead={
        **dict.fromkeys(('M', 'inertia'), 'mass_matrix(q)'),
        **dict.fromkeys(('jacobian', 'frames', 'placement'),
                        'link_points(q) has positions; model is the arm in Pinocchio'),
        'gravity': 'load_arm(urdf, gravity=...) takes the vector, model.gravity has it; '
                   'inverse_dynamics(arm, theta, q, 0 * q, 0 * q) is the torque at rest',
        **dict.fromkeys(('to_urdf', 'export_urdf'),
                        'xml is its text; identify(log, urdf).urdf(path) writes what was learned'),
        **dict.fromkeys(('masses', 'mass'),
                        'inertial[:, 0] has the masses of the URDF by joint')}):
    """A sub-chain of a URDF's joints as an `Arm`; the other joints are locked at zero.

    θ holds base inertial parameters, each named after the inertial parameter whose column stands
    for it (``panda_joint2.Ixx``: of the body that panda_joint2 moves; ``Ia_panda_joint4``: inertia
    of its rotor, seen from the joint, where a torque tells it from that of the link), then per
    joint in the user's order ``fv_`` viscous, ``fc_`` Coulomb, ``f0_`` constant and ``fs_``
    square-root friction, as chosen:

        τ = (M + diag(Ia)) q̈ + C q̇ + G + diag(fv) q̇ + diag(fc + fs √|q̇|) tanh(q̇/v_s) + f0

    A rotor's own motion through space is left out: with a gear of ratio r it matters r times less.

    Attributes:
        joints: Joint names, length n, in the order of every array.
        parameters: Parameter names, length m, in the order of θ.
        nominal: θ of the URDF, shape (m,).
        payload_direction: dθ/d(payload) of a point mass in the last of the link points, (m,).
        inertial: The URDF's inertial parameters per joint, shape (n, 10).
        rotor: Nominal inertia of each joint's rotor, seen from the joint, shape (n,) [kg·m²].
        base_from_standard: Map from ``inertial.ravel()`` to base parameters, shape (b, 10 n).
        base_from_rotor: Map from ``rotor`` to base parameters, shape (b, n); zero where rotor
            inertia is not learned.
        dissipates: Which of the friction parameters, the last ones of θ, are ≥ 0 in a passive
            joint, shape (m − b,).
        torque_limit: Shape (n,) [N·m]; infinite where the URDF gives none or zero.
        velocity_limit: Shape (n,) [rad/s]; infinite where the URDF gives none or zero.
        position_lower: Shape (n,) [rad]; minus infinity for a continuous joint.
        position_upper: Shape (n,) [rad]; infinity for a continuous joint.
        xml: Text of the URDF.
        model: Pinocchio model of the sub-chain (joints in the tree's order).
        chain: The same arm as arrays, what compiled functions take.
    """

    @checked_call
    def __init__(self, source: UrdfSource, joints: Sequence[str] | None = None, *,
                 friction_viscous: bool = True, friction_coulomb: bool = False,
                 friction_offset: bool = False, friction_square_root: bool = False,
                 rotor_inertia: bool = False, coulomb_velocity: float = 0.02,
                 gravity: Sequence[float] | np.ndarray = (0.0, 0.0, -9.81),
                 viscous: float | Sequence[float] | np.ndarray | None = None,
                 coulomb: float | Sequence[float] | np.ndarray | None = None,
                 offset: float | Sequence[float] | np.ndarray | None = None,
                 square_root: float | Sequence[float] | np.ndarray | None = None,
                 rotor: float | Sequence[float] | np.ndarray | None = None,
                 package_dirs: Sequence[str | os.PathLike[str]] = ()) -> None:
        """Read a URDF and find its base parameters.

        Args:
            source: Path, ``package://package/path`` or XML text (see `read_urdf`).
            joints: Names in the order of every array; None takes every single-axis joint that
                does not mimic another, from the base outwards. Continuous joints are angles
                like any other.
            friction_viscous: Whether θ has viscous friction.
            friction_coulomb: Whether θ has Coulomb friction tanh(q̇/v_s).
            friction_offset: Whether θ has a constant torque per joint.
            friction_square_root: Whether θ has friction √|q̇| tanh(q̇/v_s).
            rotor_inertia: Whether θ has the inertias of the rotors.
            coulomb_velocity: v_s [rad/s], > 0.
            gravity: In the URDF's root frame, shape (3,) [m/s²].
            viscous: Nominal coefficients, scalar or shape (n,) [N·m·s/rad]; None takes the
                URDF's ``<dynamics damping>``.
            coulomb: Nominal coefficients, scalar or shape (n,) [N·m]; None takes the URDF's
                ``<dynamics friction>``.
            offset: Nominal torques, scalar or shape (n,) [N·m]; None takes zero.
            square_root: Nominal coefficients, scalar or shape (n,) [N·m·(s/rad)^½]; None takes
                zero.
            rotor: Nominal inertias, scalar or shape (n,) [kg·m²]; None takes zero.
            package_dirs: Further folders for ``package://``.

        Raises:
            ArmError: If no arm can be made of the URDF and the joints.
            ParameterError: If a number is out of range or of the wrong length.
            MissingExtra: If Pinocchio is not installed.
        """
        load_pinocchio()  # what is missing is said before the URDF is looked for
        self._options: dict[str, Any] = {
            'friction_viscous': friction_viscous, 'friction_coulomb': friction_coulomb,
            'friction_offset': friction_offset, 'friction_square_root': friction_square_root,
            'rotor_inertia': rotor_inertia, 'coulomb_velocity': coulomb_velocity,
            'viscous': viscous, 'coulomb': coulomb, 'offset': offset,
            'square_root': square_root, 'rotor': rotor}
        self.xml = read_urdf(source, package_dirs)
        model, self.joints = reduced_model(self.xml, joints)
        self._shape = (len(self.joints),)
        self.model = with_gravity(model, checked_gravity(gravity))
        self._order = JointOrder(self.model, self.joints)
        self._data = self.model.createData()
        self._set_limits()
        self.rotor = nominal_rotor(rotor, rotor_inertia, self.n)
        self._set_base_parameters(rotor_inertia)
        self._set_parameters()
        self.payload_direction: np.ndarray | None = self._payload_direction()
        self.chain: ChainParameters = chain_parameters(
            chain_of_model(self.model, self.joints), self._base.independent, self._friction)

    @property
    def base_count(self) -> int:
        """Number of base parameters, rotor inertias included: the first entries of θ."""
        return int(self._base.independent.size)

    @property
    def arrays(self) -> ChainParameters:
        """The arm as compiled functions take it, see `arms.regressors`."""
        return self.chain

    # -- regressors ---------------------------------------------------------------------------

    def Y(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        """Return Y with Y θ = M q̈ + C q̇ + G + F q̇ (2), shape (n, m) [N·m per unit of θ]."""
        return self.X(q, qd, qd, qdd)

    @checked_call
    def Y1(self, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """Momentum regressor, Y1 θ = M(q) q̇ (12), shape (n, m) [N·m·s per unit of θ]."""
        return self.Y12(q, qd)[0]

    @checked_call
    def Y2(self, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """Y2 θ = −Ṁ q̇ + C q̇ + G + F q̇ (12), shape (n, m) [N·m per unit of θ]."""
        return self.Y12(q, qd)[1]

    @checked_call
    def Y12(self, q: np.ndarray, qd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return (Y1, Y2); see `chain_Y12`.

        Raises:
            ParameterError: An array is not of shape (n,).
        """
        if not are_vectors(self._shape, q, qd):
            q, qd = checked_vectors(self.joints, q=q, qd=qd)
        return chain_Y12(self.chain, q, qd)

    @checked_call
    def X(self, q: np.ndarray, qd: np.ndarray, alpha: np.ndarray,
          alpha_dot: np.ndarray) -> np.ndarray:
        """X θ = M α̇ + C α + G + F q̇, shape (n, m) [N·m per unit of θ]; see `chain_X`.

        Raises:
            ParameterError: An array is not of shape (n,).
        """
        if not are_vectors(self._shape, q, qd, alpha, alpha_dot):
            q, qd, alpha, alpha_dot = checked_vectors(self.joints, q=q, qd=qd, alpha=alpha,
                                                      alpha_dot=alpha_dot)
        return chain_X(self.chain, q, qd, alpha, alpha_dot)

    # -- parameters ---------------------------------------------------------------------------

    def base_from_inertial(self, inertial: np.ndarray,
                           rotor: np.ndarray | None = None) -> np.ndarray:
        """Return the base parameters of inertial parameters, (n, 10) and (n,) → (b,).

        Args:
            inertial: Ten per joint, of the body that it moves.
            rotor: Inertia of each joint's rotor [kg·m²]; none where None.
        """
        result: np.ndarray = self.base_from_standard @ np.reshape(inertial, -1)
        return result if rotor is None else result + self.base_from_rotor @ rotor

    def to_inertial(self, theta: np.ndarray) -> np.ndarray:
        """Return inertial parameters with the dynamics of θ, shape (n, 10).

        One of infinitely many sets: those that no torque shows stay as in the URDF (where a
        massless link comes to need a mass it gets 1 kg of those), the nominal θ gives the URDF's
        own set bit for bit. It need not be a set that a rigid body can have.

        Args:
            theta: Parameters, shape (m,).

        Raises:
            ArmError: If ``theta`` has the wrong length or is not finite.
        """
        base = self._checked(theta)[:self.base_count]
        result = self._nearest_inertial(base, self.inertial)
        massless = (result[:, 0] == 0.0) & result.any(axis=1)
        if massless.any():
            reference = self.inertial.copy()
            reference[massless, 0] = 1.0
            result = self._nearest_inertial(base, reference)
        return result

    def rotor_inertia(self, theta: np.ndarray) -> np.ndarray:
        """Return the inertia of each rotor in θ, the nominal one where θ has none, shape (n,)."""
        base = self._checked(theta)
        column = self.chain.rotor
        return np.where(column >= 0, base[column], self.rotor)

    def friction(self, theta: np.ndarray) -> np.ndarray:
        """Return viscous, Coulomb, constant and square-root friction of θ in rows, (4, n)."""
        return self._friction.coefficients(self._checked(theta)[self.base_count:])

    @checked_call
    def dynamics(self, theta: np.ndarray) -> UrdfDynamics:
        """Forward dynamics with the parameters ``theta``, shape (m,).

        Raises:
            ArmError: If ``theta`` has the wrong length or no positive definite mass matrix.
        """
        chain = self.chain.chain
        inertias = pseudo_inertias(self.to_inertial(theta)[chain.place])
        return UrdfDynamics(ChainInertias(
            chain, inertias, self.friction(theta), self.chain.coulomb_velocity,
            self.rotor_inertia(theta)), self.joints)

    def mass_matrix(self, q: np.ndarray, theta: np.ndarray | None = None) -> np.ndarray:
        """Return M(q) for θ (the URDF's by default), shape (n, n) [kg·m²]."""
        theta = self.nominal if theta is None else self._checked(theta)
        return np.column_stack([self.Y1(q, axis) @ theta for axis in np.eye(self.n)])

    def link_points(self, q: np.ndarray) -> np.ndarray:
        """Points to draw the arm through at joint positions q, shape (k, 3) [m], root frame.

        The root, the origins of the joints that carry the last one of the longest chain, and the
        last frame behind it.
        """
        model, data = self.model, self._data
        q, = checked_vectors(self.joints, q=q)
        load_pinocchio().framesForwardKinematics(model, data, self._order.position(q))
        chain, tip = self._chain()
        origins = [data.oMi[joint].translation for joint in chain]  # joint 0 is the root
        return np.array([*origins, data.oMf[tip].translation])

    def without_gravity(self) -> UrdfArm:
        """Return the same arm where nothing weighs anything."""
        return UrdfArm(self.xml, self.joints, gravity=(0.0, 0.0, 0.0), **self._options)

    def links(self) -> dict[str, Link]:
        """Return the links that move, by name: where they are on the bodies of ``chain.chain``."""
        body = load_pinocchio().FrameType.BODY
        return {frame.name: Link(int(frame.parentJoint), np.array(frame.placement.translation))
                for frame in self.model.frames if frame.type == body and frame.parentJoint > 0}

    # -- construction -------------------------------------------------------------------------

    def _set_limits(self) -> None:
        model, rows = self.model, self._order.rows
        self.position_lower, self.position_upper = self._order.limits(
            model.lowerPositionLimit, model.upperPositionLimit)
        self.torque_limit = _limit(model.effortLimit[rows])
        self.velocity_limit = _limit(model.velocityLimit[rows])

    def _set_parameters(self) -> None:
        options = self._options
        nominal = nominal_friction(
            {kind: (options[f'friction_{kind}'], options[kind]) for kind in FRICTION_KINDS},
            self.model, self._order.rows)
        self._friction = JointFriction(self.joints, nominal, options['coulomb_velocity'])
        self.dissipates = self._friction.dissipates
        self.parameters = (*self._base_names, *self._friction.names)
        self.nominal = np.concatenate([self.base_from_inertial(self.inertial, self.rotor),
                                       self._friction.nominal])

    def _set_base_parameters(self, rotors: bool) -> None:
        model, rows = self.model, self._order.rows
        count = PER_BODY * self.n
        stack, order = self._random_regressors(), preferred_columns(self.n)
        if rotors:  # tried last: what a link's inertia can stand for is the link's
            stack = np.hstack([stack, self._random_rotor_regressors()])
            order = np.append(order, count + np.arange(self.n))
        base = self._base = decompose(stack, order)
        bodies, kinds = np.divmod(base.independent[base.independent < count], PER_BODY)
        kept = base.independent[base.independent >= count] - count
        self._base_names = (
            *(f'{model.names[int(body) + 1]}.{INERTIAL_NAMES[kind]}'
              for body, kind in zip(bodies, kinds, strict=True)),
            *(f'Ia_{model.names[int(joint) + 1]}' for joint in kept))
        user = (PER_BODY * rows[:, None] + np.arange(PER_BODY)).reshape(-1)
        self.base_from_standard = base.from_standard[:, user]
        self.base_from_rotor = (base.from_standard[:, count + rows] if rotors else
                                np.zeros((base.independent.size, self.n)))
        self._user_base = BaseParameters(np.argsort(user)[base.independent[:bodies.size]],
                                         self.base_from_standard[:bodies.size])
        self.inertial = np.array([model.inertias[int(row) + 1].toDynamicParameters()
                                  for row in rows])

    def _chain(self) -> tuple[list[int], int]:
        """Pinocchio's joints of the longest chain from the root on, and its last frame."""
        chain = max((list(support) for support in self.model.supports), key=len)
        return chain, max(i for i, frame in enumerate(self.model.frames)
                          if frame.parentJoint == chain[-1])

    @property
    def last_body(self) -> int:
        """Row of ``inertial`` of the body that carries a load: the last of the longest chain."""
        last = self.model.joints[self._chain()[0][-1]].idx_v
        return int(np.flatnonzero(self._order.rows == last)[0])

    def _payload_direction(self) -> np.ndarray:
        chain, tip = self._chain()
        placement = self.model.frames[tip].placement.translation
        point = load_pinocchio().Inertia(1.0, placement, np.zeros((3, 3)))
        inertial = np.zeros((self.n, PER_BODY))
        inertial[self.last_body] = point.toDynamicParameters()
        return np.concatenate([self.base_from_inertial(inertial),
                               np.zeros(len(self._friction.names))])

    def _random_states(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        # Joint limits are left aside: an identity between regressor columns that holds on an
        # interval holds everywhere, and full turns tell nearly equal columns apart best.
        random, shape = np.random.default_rng(0), (_STATES, self.n)
        return (random.uniform(-np.pi, np.pi, shape), random.uniform(-2.0, 2.0, shape),
                random.uniform(-5.0, 5.0, shape))

    def _random_regressors(self) -> np.ndarray:
        order = self._order
        regressor = load_pinocchio().computeJointTorqueRegressor
        return np.vstack([  # (which also puts the single row of a single joint back in shape)
            regressor(self.model, self._data, order.position(q), order.velocity(qd),
                      order.velocity(qdd))
            for q, qd, qdd in zip(*self._random_states(), strict=True)])

    def _random_rotor_regressors(self) -> np.ndarray:
        order = self._order
        return np.vstack([np.diag(order.velocity(qdd)) for qdd in self._random_states()[2]])

    def _nearest_inertial(self, base: np.ndarray, reference: np.ndarray) -> np.ndarray:
        links = self._user_base.independent.size
        base = (base - self.base_from_rotor @ self.rotor)[:links]
        standard = self._user_base.nearest_standard(base, reference.reshape(-1))
        return standard.reshape(-1, PER_BODY)

    def _checked(self, theta: np.ndarray) -> np.ndarray:
        if isinstance(getattr(theta, 'estimate', theta), Mapping):
            theta = checked_theta('theta', theta, self.parameters)
        theta = checked_array('theta', theta, np.shape(theta)) if dimensions(theta) == 1 else (
            np.empty(0))
        if theta.shape != (self.m,) or not np.all(np.isfinite(theta)):
            raise ArmError(f'theta has the shape {theta.shape}: expected {self.m} finite '
                           f'parameters ({self.base_count} base parameters and friction)')
        return theta


def _limit(value: np.ndarray) -> np.ndarray:
    # urdfdom and Pinocchio write "no limit" as zero, infinity or the largest double.
    return np.where((value > 0.0) & (value < 1e300), value, np.inf)
