# SPDX-License-Identifier: Apache-2.0
"""The parameters of the safety filter ``limits``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.parameters.declaration import group, parameter
from adaptive_blf_control.parameters.settings import Settings

__all__ = ['LimitSettings', 'ObstacleSettings', 'PriorSettings', 'rows_of']


_WIDTHS = {'spheres': 4, 'capsules': 7, 'boxes': 6, 'half_spaces': 6}


def rows_of(name: str, value: np.ndarray, width: int) -> list[list[float]]:
    """Return the rows of a list that has ``width`` numbers for each; [0.0] has none.

    Raises:
        ParameterError: the last row lacks some.
    """
    if value.tolist() == [0.0]:
        return []
    if value.size % width:
        raise ParameterError(name, value.tolist(), f'{width} numbers each, or [0.0] for none')
    rows: list[list[float]] = value.reshape(-1, width).tolist()
    return rows


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PriorSettings(Settings, where='controller.limits.prior'):
    """What is known of θ* for sure before any motion."""

    mass_error: float = parameter(
        0.3, 'How wrong the mass of a link may be, as a part of that of the URDF, its centre and '
        'the shape of its inertia being right.', '', 0.0, 0.95)
    payload: float = parameter(0.0, 'Largest load at the tip; the least is none.', 'kg', 0.0)
    friction: np.ndarray = parameter(
        [0.0], 'Largest friction parameter of each joint, the least is none; 0 takes it within '
        'mass_error of the nominal one.', 'N*m*s/rad or N*m', 0.0, length='joints')
    unexplained: np.ndarray = parameter(
        [0.1], 'Largest torque that no parameters explain.', 'N*m', 0.0, exclusive=True,
        length='joints')


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ObstacleSettings(Settings, where='controller.limits.obstacles'):
    """Obstacles that stand still, in the frame of the arm's base, each kind in one list.

    A list of one zero, as a ROS parameter cannot be empty, has none.
    """

    spheres: np.ndarray = parameter(
        [0.0], 'x, y, z of the centre and the radius of each sphere.', 'm', live=True)
    capsules: np.ndarray = parameter(
        [0.0], 'x, y, z of both ends and the radius of each capsule.', 'm', live=True)
    boxes: np.ndarray = parameter(
        [0.0], 'x, y, z of the centre and the three sides of each box along the axes of the base.',
        'm', live=True)
    half_spaces: np.ndarray = parameter(
        [0.0], 'A point of each plane, x, y, z, and its normal, which points to the free side.',
        'm', live=True)
    frame: str = parameter(
        'base_link', 'Frame of the markers on controller/obstacles: that of the base of the arm.')
    speed: float = parameter(
        1.0, 'Largest velocity that an obstacle is taken to have.', 'm/s', 0.0, live=True)
    least_speed: float = parameter(
        0.02, 'Slower than this an obstacle on controller/obstacles counts as standing: what is '
        'seen of things that stand moves a little.', 'm/s', 0.0, live=True)
    timeout: float = parameter(
        0.5, 'Without a message on controller/obstacles for this long the reference comes to '
        'rest, where such obstacles are known.', 's', 0.0, exclusive=True, live=True)
    margin: float = parameter(
        0.02, 'How much farther than the arm the reference keeps from obstacles.', 'm', 0.0,
        live=True)

    def _check(self) -> None:
        for name in _WIDTHS:
            self.rows(name)

    def rows(self, name: str) -> list[list[float]]:
        """Return the obstacles of a kind; ParameterError where one lacks numbers."""
        return rows_of(f'{self._where}.{name}', getattr(self, name), _WIDTHS[name])


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class LimitSettings(Settings, where='controller.limits'):
    """What the safety filter ``limits`` keeps, beside the safety set and the torque limit."""

    velocity: np.ndarray = parameter(
        [0.0], 'Largest velocity of each joint; 0 takes the limit of the URDF.', 'rad/s', 0.0,
        length='joints', live=True)
    braking: np.ndarray = parameter(
        [0.0], 'How hard each joint can brake at any time; 0 takes what the torque limits allow '
        'in all postures at rest.', 'rad/s^2', 0.0, length='joints', live=True)
    braking_rule: str = parameter(
        'equal', 'How braking is derived: equal: of every joint the same part of what its torque '
        'limit allows; short_stops: the shortest ways on which the joints stop from their largest '
        'velocities, for arms whose wrist has little torque left; the governor then leads the arm '
        'slowly through postures that leave little torque, where it else stops.',
        choices=('equal', 'short_stops'), live=True)
    period: float = parameter(
        0.0, 'Longest time that a torque is held; 0: the period of loop.rate.', 's', 0.0)
    govern: bool = parameter(
        True, 'Slow the reference down where velocity, torque or e1 ask for it, and lead it round '
        'obstacles.')
    prior: PriorSettings = group(PriorSettings)
    learn: bool = parameter(
        False, 'Whether what the identifier is sure of narrows the prior: the intervals on '
        'identifier/parameter_set, which need its parameter_set.period and a prior with the same '
        'causes there. Sure only for an arm that does not change: a load that is put on counts '
        'as not there until the identifier notices it.')
    learn_timeout: float = parameter(
        1.0, 'Without news of these intervals for this long it is the prior again.', 's', 0.0,
        exclusive=True)
    link_spheres: np.ndarray = parameter(
        [0.0], 'Spheres on the links that keep away from obstacles: the number of the joint that '
        'moves the link, from 1, and x, y, z of the centre in its frame and the radius. [0.0]: '
        'along the lines between the joints, with link_radius.', 'm', live=True)
    link_radius: float = parameter(
        0.08, 'Radius of the spheres where link_spheres gives none.', 'm', 0.0, exclusive=True,
        live=True)
    self_collision: bool = parameter(
        False, 'Keep spheres of links apart that have at least three joints between them.',
        live=True)
    obstacles: ObstacleSettings = group(ObstacleSettings)

    def _check(self) -> None:
        rows_of(f'{self._where}.link_spheres', self.link_spheres, 5)
