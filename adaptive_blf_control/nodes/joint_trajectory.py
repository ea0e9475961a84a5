# SPDX-License-Identifier: Apache-2.0
"""``controller/joint_trajectory``: a planner's points as the reference from now on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from trajectory_msgs.msg import JointTrajectory

from adaptive_blf_control.control.controller import Controller
from adaptive_blf_control.control.reference import Reference, ReferencePoint
from adaptive_blf_control.control.sets import check_inside, check_performance_inside_safety
from adaptive_blf_control.control.trajectory import JoinedReference, PointReference
from adaptive_blf_control.errors import ParameterError

__all__ = ['reference_through']


def _row(values: Sequence[float], order: list[int], name: str, k: int) -> np.ndarray:
    """One array of a point in the order of the joints; zeros where it is empty."""
    if not len(values):
        return np.zeros(len(order))
    if len(values) != len(order):
        raise ParameterError(f'joint_trajectory.points[{k}].{name}', len(values),
                             f'{len(order)} values, one for each joint')
    return np.array([values[i] for i in order], dtype=float)


def reference_through(message: JointTrajectory, controller: Controller, t: float) -> Reference:
    """Return the reference that leaves the present one at ``t`` [s] and goes through the points.

    ``header.stamp`` is not used: the points begin as soon as they can. Velocities and
    accelerations that are not given are zero. The end is at rest and is held. A first point at 0 s
    says where the planner believes the arm to be: it is checked, not gone through.

    Raises:
        ParameterError: names, lengths, times or values do not fit, as ros2_controllers has it.
        SetViolation: the way there, with the performance set around it, leaves the safety set, or
            the first point is at 0 s and not within the performance set around the reference.
    """
    joints = controller.arm.joints
    names = list(message.joint_names)
    if sorted(names) != sorted(joints):
        raise ParameterError('joint_trajectory.joint_names', names,
                             f'each of {", ".join(joints)} once')
    if not message.points:
        raise ParameterError('joint_trajectory.points', [], 'at least one point')
    order = [names.index(joint) for joint in joints]
    times, points = [0.0], [controller.reference.at(t)]
    for k, point in enumerate(message.points):
        if not len(point.positions):
            raise ParameterError(f'joint_trajectory.points[{k}].positions', [], 'a position each')
        goal = ReferencePoint(*(_row(getattr(point, name), order, name, k)
                                for name in ('positions', 'velocities', 'accelerations')))
        time = point.time_from_start.sec + point.time_from_start.nanosec * 1e-9
        if k == 0 and time == 0.0 and len(message.points) > 1:
            check_inside(controller.performance.lower, controller.performance.upper,
                         goal.position - points[0].position, joints,
                         'first point, at 0 s, outside the performance set around the reference')
            continue
        times.append(time)
        points.append(goal)
    way = PointReference(times, points)
    check_performance_inside_safety(controller.safety, controller.performance, way.range(), joints)
    return JoinedReference(controller.reference, t, way)
