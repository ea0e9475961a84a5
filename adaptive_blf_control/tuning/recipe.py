# SPDX-License-Identifier: Apache-2.0
"""From a URDF arm and what is stated about a robot to sets, reference, gains and filters."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from adaptive_blf_control.arms.inverse_dynamics import inverse_dynamics
from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.control.settings import ControllerSettings, PerformanceSettings
from adaptive_blf_control.errors import ArmError
from adaptive_blf_control.tuning.adaptation import (
    Adaptation,
    adaptation_for,
    parameter_deviation,
    stuck_error,
)
from adaptive_blf_control.tuning.expected_error import Start, start_error, static_error
from adaptive_blf_control.tuning.filter_cost import filter_cost
from adaptive_blf_control.tuning.gains import FRICTION, Gains, law_gains
from adaptive_blf_control.tuning.inertia import (
    damping_rate,
    mass_matrices,
    reference_states,
    ReferenceStates,
    seen_inertia,
    SeenInertia,
    viscous_friction,
)
from adaptive_blf_control.tuning.loop_check import joint_phases
from adaptive_blf_control.tuning.motion_design import Motion, motion_within
from adaptive_blf_control.tuning.robot import known_limits, Limits, Robot
from adaptive_blf_control.tuning.sensing import Filters, filters_for, ORDER

__all__ = ['Recipe', 'recipe']

USED = 2.0  # a torque limit that nobody states is so many times what the reference needs
LEAST_TORQUE = 1.0  # N·m, and at least this
START_ROOM, PAYLOAD_ROOM = 2.0, 1.5  # bound over the error of a start from zero, of a payload
UNKNOWN_FRICTION = 0.01  # part of the torque limit that Coulomb friction outside the model may be


@dataclass(frozen=True)
class Recipe:
    """What follows from an arm and from what is stated; arrays of shape (n,) unless said.

    Attributes:
        arm: The arm.
        robot: What was stated.
        limits: Of the joints.
        motion: Sets and reference.
        states: The reference.
        inertia: That the joints see along it, without and with the payload.
        friction: Viscous coefficients of the URDF [N·m·s/rad].
        gains: Of the law.
        adaptation: Gains of the update law.
        filters: Of the identifier.
        substeps: Runge-Kutta steps a sample that simulate the arm and its friction.
        rate: λ_max(M⁻¹ K2) along the reference, without the share of friction in k2 [1/s].
        phase: Phase margins at e1 = 0 [rad].
        torque: Largest |τ| along the reference, payload included [N·m].
        torque_limit: Largest torques to command [N·m].
        coulomb_friction: That is not in the model [N·m].
        friction_error: Error that it leaves [rad].
        start_error: Error of the start, with θ̂ as far off as the URDF usually is, or 0 [rad].
        payload_error: Error after the payload is put on at once, where along the reference it
            weighs most on a joint [rad].
        assumed: What was assumed because neither URDF nor owner says.
    """

    arm: UrdfArm
    robot: Robot
    limits: Limits
    motion: Motion
    states: ReferenceStates
    inertia: SeenInertia
    friction: np.ndarray
    gains: Gains
    adaptation: Adaptation
    filters: Filters
    substeps: int
    rate: float
    phase: np.ndarray
    torque: np.ndarray
    torque_limit: np.ndarray
    coulomb_friction: np.ndarray
    friction_error: np.ndarray
    start_error: np.ndarray
    payload_error: np.ndarray
    assumed: tuple[str, ...]

    @property
    def reserve(self) -> np.ndarray:
        """Part of the torque limit that the reference leaves, shape (n,)."""
        return 1.0 - self.torque / self.torque_limit


def recipe(arm: UrdfArm, robot: Robot) -> Recipe:
    """Return what follows from an arm and from what is stated about it.

    Raises:
        ArmError: a joint sees no inertia along the reference.
        ParameterError: what is stated does not fit the arm.
        SetViolation: a stated centre leaves no room for the sets.
    """
    limits = known_limits(arm, robot)
    found = _within(arm, robot, limits, motion_within(arm, limits, robot))
    needed = START_ROOM * found.start_error if robot.from_zero else np.zeros(arm.n)
    needed = np.maximum(needed, PAYLOAD_ROOM * found.payload_error)
    if (needed <= found.motion.bound).all():
        return found
    return _within(arm, robot, limits, motion_within(arm, limits, robot, needed))


def _within(arm: UrdfArm, robot: Robot, limits: Limits, motion: Motion) -> Recipe:
    states, delay = reference_states(motion.reference), robot.loop
    loaded, friction = _loaded(arm, robot), viscous_friction(arm, arm.nominal)
    masses = _masses(arm, arm.nominal, states)
    inertia = seen_inertia(np.concatenate([masses, _masses(arm, loaded, states)])
                           if robot.payload else masses)
    gains = law_gains(inertia, friction, motion.bound, delay)
    torques = inverse_dynamics(arm, loaded, *states)
    torque = np.abs(torques).max(axis=0)
    torque_limit, assumed = _torque_limit(arm, limits, torque)
    usual = float(np.sqrt(np.mean(torques ** 2)))
    cost = partial(filter_cost, arm, motion.reference, _sliding(arm, loaded, torque_limit))
    filters = filters_for(robot, float(np.sqrt(np.mean(states.qd ** 2, axis=0)).max()),
                          float(inertia.most.max()), usual,
                          partial(cost, ORDER) if _learns_coulomb(arm) else None)
    filters = filters._replace(motion_error=cost(filters.state_order, filters.state_time_constant))
    deviation = parameter_deviation(arm, limits.velocity, torque_limit, robot.payload,
                                    gains.k2 - FRICTION * friction, from_zero=robot.from_zero)
    noise = float(np.hypot(filters.noise, stuck_error(arm, torque_limit)))
    adaptation = adaptation_for(arm, deviation, masses, states, delay, noise, usual)
    coulomb = _coulomb_friction(arm, torque_limit)
    start = Start(mass_matrices(arm, arm.nominal, motion.centre[None])[0],
                  arm.X(motion.centre, *np.zeros((3, arm.n))), gains, motion.bound, friction,
                  friction, adaptation.gamma, delay)
    return Recipe(
        arm=arm, robot=robot, limits=limits, motion=motion, states=states, inertia=inertia,
        friction=friction, gains=gains, adaptation=adaptation, filters=filters,
        substeps=_substeps(robot, masses, friction),
        rate=damping_rate(masses, gains.k2 - FRICTION * friction),
        phase=_phase(inertia.least + friction * delay.total, gains, motion.bound, robot),
        torque=torque, torque_limit=torque_limit, coulomb_friction=coulomb,
        friction_error=static_error(coulomb, motion.bound, *gains),
        start_error=start_error(
            start._replace(known=0.0 * friction) if robot.from_zero else start,
            arm.nominal[:, None] if robot.from_zero else np.diag(deviation)),
        payload_error=_payload_error(start, arm, states, loaded - arm.nominal),
        assumed=(limits.assumed + _moved(motion) + assumed + _stated_friction(arm)
                 + _rotors(arm, inertia)))


def _payload_error(start: Start, arm: UrdfArm, states: ReferenceStates,
                   change: np.ndarray) -> np.ndarray:
    """Return the largest errors at rest in the postures in which it weighs most, (n,) [rad]."""
    if not change.any():
        return np.zeros(arm.n)
    rest = np.zeros(arm.n)
    regressors = np.array([arm.X(q, rest, rest, rest) for q in states.q])
    worst = np.unique(np.abs(regressors @ change).argmax(axis=0))
    masses = mass_matrices(arm, arm.nominal, states.q[worst])
    return np.asarray(np.max([
        start_error(start._replace(mass=mass, regressor=regressors[k]), change[:, None])
        for k, mass in zip(worst, masses)], axis=0))


def _loaded(arm: UrdfArm, robot: Robot) -> np.ndarray:
    direction = arm.payload_direction
    return arm.nominal if direction is None else arm.nominal + robot.payload * direction


def _sliding(arm: UrdfArm, theta: np.ndarray, torque_limit: np.ndarray) -> np.ndarray:
    """Return θ with the usual Coulomb friction where it is learned and the URDF states none."""
    theta = theta.copy()
    if _learns_coulomb(arm):
        columns = [arm.parameters.index(f'fc_{joint}') for joint in arm.joints]
        usual = UNKNOWN_FRICTION * torque_limit
        theta[columns] = np.where(theta[columns] > 0.0, theta[columns], usual)
    return theta


def _learns_coulomb(arm: UrdfArm) -> bool:
    return f'fc_{arm.joints[0]}' in arm.parameters


def _masses(arm: UrdfArm, theta: np.ndarray, states: ReferenceStates) -> np.ndarray:
    masses = mass_matrices(arm, theta, states.q)
    smallest, directions = np.linalg.eigh(masses)
    worst = int(np.argmin(smallest[:, 0]))
    if smallest[worst, 0] <= 0.0:
        joint = arm.joints[int(np.argmax(np.abs(directions[worst, :, 0])))]
        raise ArmError(f'joint {joint!r} sees no inertia: the smallest eigenvalue of the mass '
                       f'matrix is {smallest[worst, 0]:.3g} kg·m²; give the links behind it an '
                       '<inertial> with a mass and an inertia')
    return masses


def _torque_limit(arm: UrdfArm, limits: Limits,
                  torque: np.ndarray) -> tuple[np.ndarray, tuple[str, ...]]:
    unknown = ~np.isfinite(limits.torque)
    if not unknown.any():
        return limits.torque, ()
    assumed = np.ceil(np.maximum(USED * torque, LEAST_TORQUE))
    names = ', '.join(f'{joint} {value:g} N·m' for joint, value, each in zip(
        arm.joints, assumed, unknown) if each)
    return np.where(unknown, assumed, limits.torque), (
        f'no torque limit in the URDF: {USED:g} times what the reference needs assumed, {names}; '
        '--torque-limit states those of the drives',)


def _moved(motion: Motion) -> tuple[str, ...]:
    return (motion.moved,) if motion.moved else ()


def _stated_friction(arm: UrdfArm) -> tuple[str, ...]:
    stated = arm.friction(arm.nominal)[1]
    if not stated.any():
        return ()
    names = ', '.join(f'{joint} {value:g} N·m' for joint, value in zip(arm.joints, stated)
                      if value)
    return (f'the URDF states a Coulomb friction, which is learned: {names} (--no-coulomb leaves '
            'it out)',)


def _rotors(arm: UrdfArm, inertia: SeenInertia) -> tuple[str, ...]:
    if arm.rotor.any() or not any(name.startswith('Ia_') for name in arm.parameters):
        return ()
    light = int(np.argmin(inertia.least))
    return (f'no rotor has an inertia until it is learned: the gains fit the links alone, '
            f'{inertia.least[light]:.2g} kg·m² at {arm.joints[light]}; --rotor-inertia with the '
            'numbers of the drives states them',)


def _coulomb_friction(arm: UrdfArm, torque_limit: np.ndarray) -> np.ndarray:
    """Return the Coulomb torque outside the model: none where it is learned, (n,) [N·m]."""
    return np.zeros(arm.n) if _learns_coulomb(arm) else UNKNOWN_FRICTION * torque_limit


def _substeps(robot: Robot, masses: np.ndarray, friction: np.ndarray) -> int:
    """Return how many steps a sample are stable: a friction F decays with M⁻¹F (RK4: 2.8)."""
    return max(1, int(np.ceil(damping_rate(masses, friction) / robot.rate / 2.0)))


def _phase(inertia: np.ndarray, gains: Gains, bound: np.ndarray, robot: Robot) -> np.ndarray:
    """Return the phase margins at e1 = 0, see `joint_phases`, without the adaptation."""
    settings = ControllerSettings(
        k1=gains.k1, k2=gains.k2, barrier_weight=gains.barrier_weight,
        performance=PerformanceSettings(lower=-bound, upper=bound))
    return joint_phases(settings, inertia, 0.0, robot.loop)
