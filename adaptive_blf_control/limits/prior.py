# SPDX-License-Identifier: Apache-2.0
"""What is known of θ* before any motion: a centre, and how far each cause can move it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.control.limit_settings import PriorSettings
from adaptive_blf_control.errors import ParameterError

__all__ = ['Cause', 'inertia_range', 'Prior', 'prior_of', 'stated_prior']


class Cause(NamedTuple):
    """Something about the arm that is not known: its value is middle + half z with |z| ≤ 1.

    Attributes:
        name: ``mass_<joint>``, the mass of the link that a joint moves, as a part of that of the
            URDF; ``payload`` [kg]; or the name of a parameter of θ, in its unit.
        middle: Between the least and the largest value.
        half: From there to either of them, > 0.
        inertial: Whether more of it is more kinetic energy in every motion, as of a mass.
    """

    name: str
    middle: float
    half: float
    inertial: bool


class Prior(NamedTuple):
    """θ* = centre + generators z with every |z_i| ≤ 1: a zonotope.

    Attributes:
        centre: Shape (m,).
        generators: How each cause moves θ*, shape (m, ν).
        causes: What each column of the generators is due to, as many as there are columns; empty
            where nobody asks for their values.
    """

    centre: np.ndarray
    generators: np.ndarray
    causes: tuple[Cause, ...] = ()

    def narrowed(self, least: np.ndarray, most: np.ndarray) -> Prior:
        """Return what is left where each z is known to be between two values.

        Args:
            least: Smallest z of each cause, shape (ν,), ≥ −1.
            most: Largest z of each cause, shape (ν,), ≥ ``least`` and ≤ 1.
        """
        middle, half = 0.5 * (most + least), 0.5 * (most - least)
        causes = tuple(
            cause._replace(middle=cause.middle + cause.half * at, half=cause.half * part)
            for cause, at, part in zip(self.causes, middle.tolist(), half.tolist()))
        return Prior(self.centre + self.generators @ middle, self.generators * half, causes)

    def support(self, rows: np.ndarray) -> np.ndarray:
        """Return the largest value of |a (θ* − centre)| for each row a, shape (k,).

        Args:
            rows: Shape (k, m).
        """
        return np.asarray(np.abs(rows @ self.generators).sum(axis=1))

    def contains(self, theta: np.ndarray) -> bool:
        """Whether θ, shape (m,), is one of the values that the prior allows.

        Exact where no more generators than parameters are independent, as with masses of links;
        otherwise it may say no to a θ that a search over z would find.
        """
        z, *_ = np.linalg.lstsq(self.generators, theta - self.centre, rcond=None)
        rest = np.abs(self.generators @ z - (theta - self.centre)).max()
        scale = np.abs(theta).max(initial=1.0)
        return bool(np.abs(z).max(initial=0.0) <= 1.0 + 1e-9 and rest <= 1e-9 * scale)


def prior_of(arm: Arm, *, mass_error: float = 0.3, payload: float = 0.0,
             friction: float | np.ndarray = 0.0) -> Prior:
    """Return the prior of an arm.

    Args:
        arm: The arm; its nominal parameters are the centre but for payload and friction.
        mass_error: How wrong the mass of a link may be, as a part of it, its centre of mass and
            the shape of its inertia being right. Where an arm does not tell links apart, how wrong
            each of its parameters may be.
        payload: Largest load at the tip [kg], from none.
        friction: Largest of the friction parameters of each joint, one for all or shape (n,),
            from none (N·m·s/rad viscous, N·m Coulomb); 0 takes friction within ``mass_error`` of
            nominal.

    Raises:
        ParameterError: a value is out of range, or a payload is asked of an arm without a tip.
    """
    for name, value in (('prior.mass_error', mass_error), ('prior.payload', payload),
                        ('prior.friction', friction)):
        if not (np.isfinite(value).all() and np.min(value) >= 0.0):
            raise ParameterError(name, value, 'a finite number >= 0')
    centre = np.array(arm.nominal, dtype=float)
    most = _largest_friction(arm, np.broadcast_to(friction, arm.n))
    given = most > 0.0
    found: list[tuple[Cause, np.ndarray]] = []
    for cause, share in _shares(arm):
        column = np.where(given, 0.0, mass_error * share)
        found.append((cause._replace(half=mass_error * cause.half), column))
    for i in np.flatnonzero(given):
        half = 0.5 * float(most[i])
        found.append((Cause(arm.parameters[i], half, half, False), half * np.eye(arm.m)[i]))
    centre[given] = 0.5 * most[given]
    if payload > 0.0:
        if arm.payload_direction is None:
            raise ParameterError('prior.payload', payload, '0.0: the arm has no tip to load')
        found.append((Cause('payload', 0.5 * payload, 0.5 * payload, True),
                      0.5 * payload * arm.payload_direction))
        centre += 0.5 * payload * arm.payload_direction
    kept = [(cause, column) for cause, column in found if np.any(column)]
    if not kept:
        raise ParameterError('prior.mass_error', mass_error,
                             'something that may be wrong: a mass, a payload or friction')
    return Prior(centre, np.column_stack([column for _, column in kept]),
                 tuple(cause for cause, _ in kept))


def stated_prior(arm: Arm, stated: PriorSettings) -> Prior:
    """Return the prior of an arm that parameters state; see `prior_of`."""
    return prior_of(arm, mass_error=stated.mass_error, payload=stated.payload,
                    friction=stated.friction)


def inertia_range(arm: Arm, *, mass_error: float = 0.3,
                  payload: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Return the θ, each (m,), of the arm with the least and with the most mass of the prior.

    Kinetic energy is linear and increasing in each mass. So where every mass is within
    ``mass_error`` of nominal, with centres and shapes as they are, M(θ_least) ⪯ M(θ*) ⪯ M(θ_most)
    in every posture, the order being that of quadratic forms. Friction is not looked at.

    Args:
        arm: The arm.
        mass_error: As in `prior_of`; below 1.
        payload: Largest load at the tip [kg].

    Raises:
        ParameterError: a mass could be zero.
    """
    if not 0.0 <= mass_error < 1.0:
        raise ParameterError('prior.mass_error', mass_error, 'a number >= 0 and < 1: no mass is '
                                                             'zero')
    nominal = np.array(arm.nominal, dtype=float)
    most = (1.0 + mass_error) * nominal
    if payload > 0.0 and arm.payload_direction is not None:
        most = most + payload * arm.payload_direction
    return (1.0 - mass_error) * nominal, most


def _shares(arm: Arm) -> list[tuple[Cause, np.ndarray]]:
    """Return the part of each link, and of each friction parameter, in the nominal θ.

    The half of each cause is its whole value, as if it could be wrong by all of it.
    """
    alone = [(Cause(name, value, abs(value), False), abs(value) * axis)
             for name, value, axis in zip(arm.parameters, arm.nominal.tolist(), np.eye(arm.m))]
    if not isinstance(arm, UrdfArm):
        return alone
    links = []
    for joint, name in enumerate(arm.joints):
        body = np.zeros_like(arm.inertial)
        body[joint] = arm.inertial[joint]
        links.append((Cause(f'mass_{name}', 1.0, 1.0, True), np.concatenate([
            arm.base_from_inertial(body), np.zeros(arm.m - arm.base_count)])))
    return links + alone[arm.base_count:]


def _largest_friction(arm: Arm, friction: np.ndarray) -> np.ndarray:
    """Return the largest viscous and Coulomb friction of each joint in its places of θ, (m,)."""
    of_joint = dict(zip(arm.joints, friction.tolist()))
    return np.array([of_joint.get(name[3:], 0.0) if name.startswith(('fv_', 'fc_')) else 0.0
                     for name in arm.parameters])
