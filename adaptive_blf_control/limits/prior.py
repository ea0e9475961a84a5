# SPDX-License-Identifier: Apache-2.0
"""What is known of θ* before any motion: a centre, and how far each cause can move it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.errors import ParameterError

__all__ = ['inertia_range', 'Prior', 'prior_of']


class Prior(NamedTuple):
    """θ* = centre + generators z with every |z_i| ≤ 1: a zonotope.

    Attributes:
        centre: Shape (m,).
        generators: How each cause moves θ*, shape (m, ν).
    """

    centre: np.ndarray
    generators: np.ndarray

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
    columns = [mass_error * column for column in _shares(arm)]
    most = _largest_friction(arm, np.broadcast_to(friction, arm.n))
    given = most > 0.0
    columns = [np.where(given, 0.0, column) for column in columns]
    columns += [0.5 * most[i] * np.eye(arm.m)[i] for i in np.flatnonzero(given)]
    centre[given] = 0.5 * most[given]
    if payload > 0.0:
        if arm.payload_direction is None:
            raise ParameterError('prior.payload', payload, '0.0: the arm has no tip to load')
        columns.append(0.5 * payload * arm.payload_direction)
        centre += 0.5 * payload * arm.payload_direction
    kept = [column for column in columns if np.any(column)]
    if not kept:
        raise ParameterError('prior.mass_error', mass_error,
                             'something that may be wrong: a mass, a payload or friction')
    return Prior(centre, np.column_stack(kept))


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


def _shares(arm: Arm) -> list[np.ndarray]:
    """Return the part of each link, and of each friction parameter, in the nominal θ."""
    if not isinstance(arm, UrdfArm):
        return [value * axis for value, axis in zip(arm.nominal, np.eye(arm.m))]
    shares = []
    for joint in range(arm.n):
        alone = np.zeros_like(arm.inertial)
        alone[joint] = arm.inertial[joint]
        shares.append(np.concatenate([arm.base_from_inertial(alone),
                                      np.zeros(arm.m - arm.base_count)]))
    return shares + [value * axis for value, axis in
                     zip(arm.nominal[arm.base_count:], np.eye(arm.m)[arm.base_count:])]


def _largest_friction(arm: Arm, friction: np.ndarray) -> np.ndarray:
    """Return the largest viscous and Coulomb friction of each joint in its places of θ, (m,)."""
    of_joint = dict(zip(arm.joints, friction.tolist()))
    return np.array([of_joint.get(name[3:], 0.0) if name.startswith(('fv_', 'fc_')) else 0.0
                     for name in arm.parameters])
