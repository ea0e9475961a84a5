# SPDX-License-Identifier: Apache-2.0
"""An arm from a URDF: regressors in base parameters and friction, computed by Pinocchio."""

from __future__ import annotations

from collections.abc import Sequence
import os
from typing import Any

import numpy as np

from adaptive_blf_control.arms.base_parameters import (
    BaseParameters,
    decompose,
    INERTIAL_NAMES,
    PER_BODY,
    preferred_columns,
)
from adaptive_blf_control.arms.inverse_dynamics import described
from adaptive_blf_control.arms.joint_friction import finite_array, JointFriction
from adaptive_blf_control.arms.urdf_dynamics import UrdfDynamics, with_inertias
from adaptive_blf_control.arms.urdf_model import (
    floating_copy,
    JointOrder,
    load_pinocchio,
    reduced_model,
    with_gravity,
)
from adaptive_blf_control.arms.urdf_source import read_urdf
from adaptive_blf_control.errors import ArmError, ParameterError

__all__ = ['UrdfArm']

_STATES = 100


class UrdfArm:
    """A sub-chain of a URDF's joints as an `Arm`; the other joints are locked at zero.

    θ holds base inertial parameters, each named after the inertial parameter whose column stands
    for it (``panda_joint2.Ixx``: of the body that panda_joint2 moves), then per joint in the
    user's order ``fv_`` viscous, ``fc_`` Coulomb and ``f0_`` constant friction, as chosen:

        τ = M q̈ + C q̇ + G + diag(fv) q̇ + diag(fc) tanh(q̇/v_s) + f0

    Attributes:
        joints: Joint names, length n, in the order of every array.
        parameters: Parameter names, length m, in the order of θ.
        nominal: θ of the URDF, shape (m,).
        payload_direction: dθ/d(payload) of a point mass in the last of the link points, (m,).
        inertial: The URDF's inertial parameters per joint, shape (n, 10).
        base_from_standard: Map from ``inertial.ravel()`` to base parameters, shape (b, 10 n).
        torque_limit: Shape (n,) [N·m]; infinite where the URDF gives none or zero.
        velocity_limit: Shape (n,) [rad/s]; infinite where the URDF gives none or zero.
        position_lower: Shape (n,) [rad]; minus infinity for a continuous joint.
        position_upper: Shape (n,) [rad]; infinity for a continuous joint.
        model: Pinocchio model of the sub-chain (joints in the tree's order).
    """

    def __init__(self, source: str | os.PathLike[str], joints: Sequence[str] | None = None, *,
                 friction_viscous: bool = True, friction_coulomb: bool = False,
                 friction_offset: bool = False, coulomb_velocity: float = 0.02,
                 gravity: Sequence[float] | np.ndarray = (0.0, 0.0, -9.81),
                 viscous: float | Sequence[float] | np.ndarray | None = None,
                 coulomb: float | Sequence[float] | np.ndarray | None = None,
                 offset: float | Sequence[float] | np.ndarray | None = None,
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
            coulomb_velocity: v_s [rad/s], > 0.
            gravity: In the URDF's root frame, shape (3,) [m/s²].
            viscous: Nominal coefficients, scalar or shape (n,) [N·m·s/rad]; None takes the
                URDF's ``<dynamics damping>``.
            coulomb: Nominal coefficients, scalar or shape (n,) [N·m]; None takes the URDF's
                ``<dynamics friction>``.
            offset: Nominal torques, scalar or shape (n,) [N·m]; None takes zero.
            package_dirs: Further folders for ``package://``.

        Raises:
            ArmError: If no arm can be made of the URDF and the joints.
            ParameterError: If a number is out of range or of the wrong length.
            MissingExtra: If Pinocchio is not installed.
        """
        self._pin = load_pinocchio()
        model, self.joints = reduced_model(read_urdf(source, package_dirs), joints)
        if np.ndim(gravity) != 1:
            raise ParameterError('gravity', gravity, 'three finite numbers')
        self.model = with_gravity(model, finite_array('gravity', gravity, 3))
        self._order = JointOrder(self.model, self.joints)
        self._set_limits()
        self._set_workspace()
        self._set_base_parameters()
        nominal = _nominal_friction(
            {'viscous': (friction_viscous, viscous), 'coulomb': (friction_coulomb, coulomb),
             'offset': (friction_offset, offset)}, self.model, self._order.rows)
        self._friction = JointFriction(self.joints, nominal, coulomb_velocity)
        self.parameters = (*self._base_names, *self._friction.names)
        self.nominal = np.concatenate([self.base_from_inertial(self.inertial),
                                       self._friction.nominal])
        self.payload_direction: np.ndarray | None = self._payload_direction()

    def __repr__(self) -> str:
        """Name joints and count parameters."""
        return described(self)

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def m(self) -> int:
        """Number of parameters."""
        return len(self.parameters)

    @property
    def base_count(self) -> int:
        """Number of base inertial parameters, the first entries of θ."""
        return int(self._base.independent.size)

    # -- regressors ---------------------------------------------------------------------------

    def Y(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        """Return Y with Y θ = M q̈ + C q̇ + G + F q̇ (2), shape (n, m) [N·m per unit of θ]."""
        order = self._order
        standard = self._pin.computeJointTorqueRegressor(
            self.model, self._data, order.position(q), order.velocity(qd), order.velocity(qdd))
        return self._with_friction(standard.take(self._pick), qd)

    def Y1(self, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """Momentum regressor, Y1 θ = M(q) q̇ (12), shape (n, m) [N·m·s per unit of θ]."""
        order, zero = self._order, self._zero
        out = np.zeros((self.n, self.m))
        out[:, :self.base_count] = self._pin.computeJointTorqueRegressor(
            self._weightless, self._weightless_data, order.position(q), zero,
            order.velocity(qd)).take(self._pick)
        return out

    def Y2(self, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """Y2 θ = −Ṁ q̇ + C q̇ + G + F q̇ (12), shape (n, m) [N·m per unit of θ]."""
        return self.Y12(q, qd)[1]

    def Y12(self, q: np.ndarray, qd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return (Y1, Y2) for less than the price of both.

        −Ṁ q̇ + C q̇ = −Cᵀq̇ = −∂T/∂q with T the kinetic energy. With J_i the axis of joint i and
        h_j the momentum of body j in world coordinates, row i of M q̇ is J_iᵀ Σ_j h_j over the
        bodies that i moves, and ∂T/∂q_i is J̇_iᵀ Σ_j h_j over the same bodies: exact, no
        differences. h_j as a regressor is what a floating base feels while it is held at rest.
        """
        pin, order = self._pin, self._order
        position, velocity = order.position(q), order.velocity(qd)
        self._floating_position[7:] = position
        self._floating_velocity[6:] = velocity
        floating = pin.computeJointTorqueRegressor(
            self._floating, self._floating_data, self._floating_position, self._floating_zero,
            self._floating_velocity)
        pin.computeJointJacobiansTimeVariation(self.model, self._data, position, velocity)
        turning = self._data.dJ.reshape(6, -1).T.take(order.rows, axis=0)
        kinetic = turning @ floating.take(self._pick_momentum)
        weight = pin.computeJointTorqueRegressor(self.model, self._data, position, self._zero,
                                                 self._zero).take(self._pick)
        y1 = np.zeros((self.n, self.m))
        y1[:, :self.base_count] = floating.take(self._pick_floating)
        kinetic *= self._moves
        weight -= kinetic
        return y1, self._with_friction(weight, qd)

    def X(self, q: np.ndarray, qd: np.ndarray, alpha: np.ndarray,
          alpha_dot: np.ndarray) -> np.ndarray:
        """X θ = M α̇ + C α + G + F q̇, shape (n, m) [N·m per unit of θ].

        C is the Christoffel matrix. C(q, v) v = c(v) is quadratic in v, so that
        C(q, q̇) α = c((q̇ + α)/2) − c((q̇ − α)/2): two inverse dynamics make X.
        """
        pin, order = self._pin, self._order
        position = order.position(q)
        mean = order.velocity(0.5 * (qd + alpha))
        difference = order.velocity(0.5 * (qd - alpha))
        standard = pin.computeJointTorqueRegressor(self.model, self._data, position, mean,
                                                   order.velocity(alpha_dot))
        standard -= pin.computeJointTorqueRegressor(self._weightless, self._weightless_data,
                                                    position, difference, self._zero)
        return self._with_friction(standard.take(self._pick), qd)

    # -- parameters ---------------------------------------------------------------------------

    def base_from_inertial(self, inertial: np.ndarray) -> np.ndarray:
        """Return the base parameters of inertial parameters per joint, (n, 10) → (b,)."""
        result: np.ndarray = self.base_from_standard @ np.reshape(inertial, -1)
        return result

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

    def friction(self, theta: np.ndarray) -> np.ndarray:
        """Return viscous, Coulomb and constant friction of θ in rows, shape (3, n)."""
        return self._friction.coefficients(self._checked(theta)[self.base_count:])

    def dynamics(self, theta: np.ndarray) -> UrdfDynamics:
        """Forward dynamics with the parameters ``theta``, shape (m,).

        Raises:
            ArmError: If ``theta`` has the wrong length or no positive definite mass matrix.
        """
        inertial = self.to_inertial(theta)
        model = with_inertias(self.model, inertial[np.argsort(self._order.rows)])
        return UrdfDynamics(model, self._order, self.friction(theta),
                            self._friction.coulomb_velocity)

    def mass_matrix(self, q: np.ndarray, theta: np.ndarray | None = None) -> np.ndarray:
        """Return M(q) for θ (the URDF's by default), shape (n, n) [kg·m²]."""
        base = self.nominal if theta is None else self._checked(theta)
        base, zero = base[:self.base_count], np.zeros(self.n)
        order = self._order
        return np.column_stack([
            self._pin.computeJointTorqueRegressor(
                self._weightless, self._weightless_data, order.position(q), zero,
                order.velocity(axis)).take(self._pick) @ base for axis in np.eye(self.n)])

    def link_points(self, q: np.ndarray) -> np.ndarray:
        """Points to draw the arm through at joint positions q, shape (k, 3) [m], root frame.

        The root, the origins of the joints that carry the last one of the longest chain, and the
        last frame behind it.
        """
        model, data = self.model, self._data
        self._pin.framesForwardKinematics(model, data, self._order.position(q))
        chain, tip = self._chain()
        origins = [data.oMi[joint].translation for joint in chain]  # joint 0 is the root
        return np.array([*origins, data.oMf[tip].translation])

    # -- construction -------------------------------------------------------------------------

    def _set_limits(self) -> None:
        model, rows = self.model, self._order.rows
        self.position_lower, self.position_upper = self._order.limits(
            model.lowerPositionLimit, model.upperPositionLimit)
        self.torque_limit = _limit(model.effortLimit[rows])
        self.velocity_limit = _limit(model.velocityLimit[rows])

    def _set_workspace(self) -> None:
        model = self.model
        self._data = model.createData()
        self._weightless = with_gravity(model, np.zeros(3))
        self._weightless_data = self._weightless.createData()
        self._floating = floating_copy(model)
        self._floating_data = self._floating.createData()
        self._zero = np.zeros(model.nv)
        self._floating_zero = np.zeros(model.nv + 6)
        self._floating_velocity = np.zeros(model.nv + 6)
        self._floating_position = np.zeros(model.nq + 7)
        self._floating_position[6] = 1.0  # the unit quaternion

    def _set_base_parameters(self) -> None:
        model, rows, width = self.model, self._order.rows, PER_BODY * self.n
        base = decompose(self._random_regressors(), preferred_columns(self.n))
        self._base = base
        columns = base.independent
        bodies, kinds = np.divmod(columns, PER_BODY)
        self._pick = rows[:, None] * width + columns
        floating = np.arange(6 + self.n)[:, None] * (width + PER_BODY) + columns + PER_BODY
        self._pick_momentum, self._pick_floating = floating[:6], floating[6 + rows]
        moved = [set(model.subtrees[int(row) + 1]) for row in rows]
        self._moves = np.array([[float(body + 1 in subtree) for body in bodies]
                                for subtree in moved])
        self._base_names = tuple(f'{model.names[int(body) + 1]}.{INERTIAL_NAMES[kind]}'
                                 for body, kind in zip(bodies, kinds, strict=True))
        user = (PER_BODY * rows[:, None] + np.arange(PER_BODY)).reshape(-1)
        self.base_from_standard = base.from_standard[:, user]
        self._user_base = BaseParameters(np.argsort(user)[columns], self.base_from_standard)
        self.inertial = np.array([model.inertias[int(row) + 1].toDynamicParameters()
                                  for row in rows])

    def _chain(self) -> tuple[list[int], int]:
        """Pinocchio's joints of the longest chain from the root on, and its last frame."""
        chain = max((list(support) for support in self.model.supports), key=len)
        return chain, max(i for i, frame in enumerate(self.model.frames)
                          if frame.parentJoint == chain[-1])

    def _payload_direction(self) -> np.ndarray:
        chain, tip = self._chain()
        placement = self.model.frames[tip].placement.translation
        point = self._pin.Inertia(1.0, placement, np.zeros((3, 3)))
        inertial = np.zeros((self.n, PER_BODY))
        inertial[self._order.rows == self.model.joints[chain[-1]].idx_v] = (
            point.toDynamicParameters())
        return np.concatenate([self.base_from_inertial(inertial),
                               np.zeros(len(self._friction.names))])

    def _random_regressors(self) -> np.ndarray:
        # Joint limits are left aside: an identity between regressor columns that holds on an
        # interval holds everywhere, and full turns tell nearly equal columns apart best.
        random = np.random.default_rng(0)
        order, shape = self._order, (_STATES, self.n)
        return np.vstack([  # (which also puts the single row of a single joint back in shape)
            self._pin.computeJointTorqueRegressor(self.model, self._data, order.position(q),
                                                  order.velocity(qd), order.velocity(qdd))
            for q, qd, qdd in zip(random.uniform(-np.pi, np.pi, shape),
                                  random.uniform(-2.0, 2.0, shape),
                                  random.uniform(-5.0, 5.0, shape), strict=True)])

    def _nearest_inertial(self, base: np.ndarray, reference: np.ndarray) -> np.ndarray:
        standard = self._user_base.nearest_standard(base, reference.reshape(-1))
        return standard.reshape(-1, PER_BODY)

    def _with_friction(self, base: np.ndarray, qd: np.ndarray) -> np.ndarray:
        out = np.zeros((self.n, self.m))
        out[:, :self.base_count] = base
        self._friction.fill(out, qd, self.base_count)
        return out

    def _checked(self, theta: np.ndarray) -> np.ndarray:
        theta = np.asarray(theta, dtype=float)
        if theta.shape != (self.m,) or not np.all(np.isfinite(theta)):
            raise ArmError(f'theta has the shape {theta.shape}: expected {self.m} finite '
                           f'parameters ({self.base_count} base parameters and friction)')
        return theta


def _nominal_friction(choice: dict[str, tuple[bool, Any]], model: Any,
                      rows: np.ndarray) -> dict[str, object]:
    dry = getattr(model, 'upperDryFrictionLimit', None)  # named so from Pinocchio 4 on
    from_urdf = {'viscous': model.damping[rows], 'offset': 0.0,
                 'coulomb': (model.friction if dry is None else dry)[rows]}
    nominal: dict[str, object] = {}
    for kind, (enabled, value) in choice.items():
        if enabled:
            nominal[kind] = from_urdf[kind] if value is None else value
        elif value is not None:
            raise ParameterError(kind, value, f'None where friction_{kind} is off')
    return nominal


def _limit(value: np.ndarray) -> np.ndarray:
    # urdfdom and Pinocchio write "no limit" as zero, infinity or the largest double.
    return np.where((value > 0.0) & (value < 1e300), value, np.inf)
