# SPDX-License-Identifier: Apache-2.0
"""``controller/joint_trajectory``: the points of a planner's message."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from trajectory_msgs.msg import JointTrajectory

from adaptive_blf_control.control.reference import ReferencePoint
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.messages.trajectory_reader import Trajectory

__all__ = ['points_of']


def _row(values: Sequence[float], order: list[int], name: str, k: int) -> np.ndarray:
    """Return one array of a point in the order of the joints; zeros if it is empty."""
    if not len(values):
        return np.zeros(len(order))
    if len(values) != len(order):
        raise ParameterError(f'joint_trajectory.points[{k}].{name}', len(values),
                             f'{len(order)} values, one for each joint')
    return np.array([values[i] for i in order], dtype=float)


def points_of(message: JointTrajectory | Trajectory,
              joints: tuple[str, ...]) -> list[tuple[float, ReferencePoint]]:
    """Return the points in the order of ``joints``, each with ``time_from_start`` [s].

    ``header.stamp`` is not used: the points begin as soon as they can. Velocities and
    accelerations that are not given are zero.

    Raises:
        ParameterError: names or lengths do not fit, by the rules of ros2_controllers.
    """
    names = list(message.joint_names)
    if sorted(names) != sorted(joints):
        raise ParameterError('joint_trajectory.joint_names', names,
                             f'each of {", ".join(joints)} once')
    if not message.points:
        raise ParameterError('joint_trajectory.points', [], 'at least one point')
    order, points = [names.index(joint) for joint in joints], []
    for k, point in enumerate(message.points):
        if not len(point.positions):
            raise ParameterError(f'joint_trajectory.points[{k}].positions', [], 'a position each')
        goal = ReferencePoint(*(_row(getattr(point, name), order, name, k)
                                for name in ('positions', 'velocities', 'accelerations')))
        points.append((point.time_from_start.sec + point.time_from_start.nanosec * 1e-9, goal))
    return points
