# SPDX-License-Identifier: Apache-2.0
"""The parameters of an arm in MuJoCo, beside those that every simulated arm has."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adaptive_blf_control.parameters.declaration import group, parameter
from adaptive_blf_control.parameters.settings import Settings

__all__ = ['ContactSettings', 'FixtureSettings', 'MujocoSettings']


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ContactSettings(Settings, where='arm_driver.mujoco.contact'):
    """The obstacle that ``contact`` in the schedule lets appear (1) and go (0)."""

    shape: str = parameter(
        'plane', 'Shape of the obstacle.', choices=('plane', 'sphere', 'box'))
    size: np.ndarray = parameter(
        [0.1, 0.1, 0.1], 'Half the edges of a box; the first value is the radius of a sphere.',
        'm', 0.0, exclusive=True, length=3)
    place: str = parameter(
        'ahead',
        'ahead: in front of the sphere that touches, across its motion; fixed: at position with '
        'orientation.', choices=('ahead', 'fixed'))
    gap: float = parameter(
        0.005, 'Free distance to an obstacle that appears ahead.', 'm', 0.0)
    position: np.ndarray = parameter(
        [0.0, 0.0, 0.0], 'Centre of the obstacle, or a point of the plane, in the base frame.',
        'm', length=3)
    orientation: np.ndarray = parameter(
        [0.0, 0.0, 0.0], 'Roll, pitch, yaw of the obstacle; a plane faces along its z axis.',
        'rad', length=3)
    link: str = parameter(
        '', 'Link that carries the sphere that touches, at its origin; empty: at the tip.')
    radius: float = parameter(
        0.05, 'Radius of the sphere that touches.', 'm', 0.0, exclusive=True)
    friction: float = parameter(
        0.5, 'Coefficient of the sliding friction of a contact.', '', 0.0)
    time_constant: float = parameter(
        0.02, "Time constant of a contact as a damped spring (MuJoCo's solref).", 's', 0.001)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class FixtureSettings(Settings, where='arm_driver.mujoco.fixtures'):
    """What stands beside the arm all the time, and what touches it; [0.0] has none."""

    spheres: np.ndarray = parameter(
        [0.0], 'x, y, z of the centre and the radius of each sphere.', 'm')
    boxes: np.ndarray = parameter(
        [0.0], 'x, y, z of the centre of each box and half its edges.', 'm')
    half_spaces: np.ndarray = parameter(
        [0.0], 'x, y, z of a point of each plane, and of its normal, on whose side it is free.',
        'm')
    link_spheres: np.ndarray = parameter(
        [0.0], 'What touches them: the number of the joint that moves the link, from 1, and x, y, '
        'z of the centre in its frame and the radius of each sphere, as '
        'controller.limits.link_spheres.', 'm')


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class MujocoSettings(Settings, where='arm_driver.mujoco'):
    """The arm in MuJoCo."""

    model: str = parameter(
        '',
        'URDF or MJCF of the arm in MuJoCo: a path or package://...; empty: the URDF of the arm. '
        'Joints that are not those of the arm are locked.')
    joints: tuple[str, ...] = parameter(
        [''],
        "Names of the arm's joints in the model, in the arm's order, where they have others "
        'there.')
    step: float = parameter(
        0.00025, 'Longest time step.', 's', 1e-6, 0.00025)
    integrator: str = parameter(
        'implicitfast', 'Integrator of MuJoCo; rk4 costs four times as much.',
        choices=('implicitfast', 'rk4'))
    tolerance: float = parameter(
        0.001,
        'Largest accepted distance [m] and angle [rad] between the joint axes of the model and '
        "those of the arm's URDF.", '', 0.0, exclusive=True)
    contact: ContactSettings = group(ContactSettings)
    fixtures: FixtureSettings = group(FixtureSettings)
