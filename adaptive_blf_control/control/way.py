# SPDX-License-Identifier: Apache-2.0
"""A planner's points as the way to follow from a given moment on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from adaptive_blf_control.control.controller import Controller
from adaptive_blf_control.control.reference import Reference, ReferencePoint
from adaptive_blf_control.control.sets import check_inside, check_performance_inside_safety
from adaptive_blf_control.control.settings import ReferenceSettings
from adaptive_blf_control.control.trajectory import JoinedReference, PointReference
from adaptive_blf_control.errors import ParameterError

__all__ = ['way_through']


def way_through(points: Sequence[tuple[float, ReferencePoint]], controller: Controller,
                t: float) -> Reference:
    """Return the reference that leaves the present one at ``t`` and goes through the points.

    The end is at rest and is held. A first point at 0 s says where the planner believes the arm
    to be: it is checked, not gone through.

    Args:
        points: At least one, each with its time after ``t`` [s].
        controller: Of the motion.
        t: When the way begins [s] since the start of the motion.

    Raises:
        ParameterError: times or values do not fit.
        ParameterError: the points ask for more than ``velocity_limit`` or ``acceleration_limit``.
        SetViolation: the way there, with the performance set around it, leaves the safety set, or
            the first point is at 0 s and not within the performance set around the reference.
    """
    joints, performance = controller.arm.joints, controller.performance
    here = controller.reference.at(t)
    if len(points) > 1 and points[0][0] == 0.0:
        check_inside(performance.lower, performance.upper,
                     points[0][1].position - here.position, joints,
                     'first point, at 0 s, outside the performance set around the reference')
        points = points[1:]
    way = PointReference([0.0, *(time for time, _ in points)],
                         [here, *(point for _, point in points)])
    check_performance_inside_safety(controller.safety, performance, way.range(), joints)
    _check_demand(way, controller.settings.reference, joints)
    return JoinedReference(controller.reference, t, way)


def _check_demand(way: PointReference, limits: ReferenceSettings, joints: tuple[str, ...]) -> None:
    for order, unit, limit, name in (
            (1, 'rad/s', limits.velocity_limit, 'velocity_limit'),
            (2, 'rad/s²', limits.acceleration_limit, 'acceleration_limit')):
        demand = np.abs(way.extremes(order)).max(axis=0)
        i = int(np.argmax(demand))
        if demand[i] > limit:
            raise ParameterError('joint_trajectory.points', (
                f'{demand[i]:.4g} {unit} of joint {joints[i]!r} on the way'),
                f'at most {limit:g} {unit}, reference.{name}: more time between the points')
