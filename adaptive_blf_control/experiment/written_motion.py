# SPDX-License-Identifier: Apache-2.0
"""A motion as files: CSV, a JointTrajectory, and the controller's reference."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.experiment.periodic_motion import PeriodicMotion
from adaptive_blf_control.experiment.torque_rows import torque_rows

__all__ = ['csv_lines', 'joint_trajectory', 'reference_parameters']

POINTS = 16  # of a trajectory in a period of the highest harmonic


def csv_lines(arm: UrdfArm, motion: PeriodicMotion, rate: float) -> Iterator[str]:
    """Yield a period as lines of CSV, both ends included.

    Columns: ``t`` [s], then per joint ``NAME_position`` [rad], ``NAME_velocity`` [rad/s],
    ``NAME_acceleration`` [rad/s²], and ``NAME_effort`` [N·m], which the URDF predicts.
    """
    times = np.arange(round(motion.period * rate) + 1) / rate
    states = motion.at(times)
    torque = torque_rows(arm.arrays, *states) @ arm.nominal
    kinds = ('position', 'velocity', 'acceleration', 'effort')
    yield ','.join(['t', *(f'{joint}_{kind}' for kind in kinds for joint in arm.joints)])
    for t, *row in zip(times, *states, torque):
        yield ','.join([f'{t:.9g}', *(f'{value:.9g}' for value in np.concatenate(row))])


def joint_trajectory(arm: UrdfArm, motion: PeriodicMotion, lead: float) -> str:
    """Return a trajectory_msgs/JointTrajectory as YAML: a period, from rest to rest.

    Args:
        arm: Its joints.
        motion: The motion.
        lead: Time to get to its start [s].
    """
    count = POINTS * motion.cosine.shape[1]
    times = np.arange(count + 1) * (motion.period / count)
    states = motion.at(times)
    lines = [f'joint_names: [{", ".join(arm.joints)}]', 'points:']
    for t, q, qd, qdd in zip(lead + times, *states):
        seconds, nanoseconds = divmod(round(1e9 * t), 10 ** 9)
        lines += [f'- time_from_start: {{sec: {seconds}, nanosec: {nanoseconds}}}',
                  f'  positions: {_list(q)}', f'  velocities: {_list(qd)}',
                  f'  accelerations: {_list(qdd)}']
    return '\n'.join(lines) + '\n'


def reference_parameters(arm: UrdfArm, motion: PeriodicMotion) -> str:
    """Return a parameter file with the motion as the controller's reference.

    It is to be given after the file of the arm: a simulated arm starts where the motion does.
    """
    lines = ['/**/arm_driver:', '  ros__parameters:',
             f'    initial_position: {_list(motion.at(np.zeros(1)).q[0])}',
             '/**/controller:', '  ros__parameters:', '    reference:']
    for joint, sinusoid in zip(arm.joints, motion.sinusoids()):
        lines += [f'      {joint}:', f'        offset: {sinusoid.offset!r}',
                  f'        amplitude: {_list(sinusoid.amplitude)}',
                  f'        frequency: [{", ".join(map(repr, sinusoid.frequency.tolist()))}]',
                  f'        phase: {_list(sinusoid.phase)}']
    return '\n'.join(lines) + '\n'


def _list(values: Iterable[float]) -> str:
    """Return numbers as a YAML list of doubles, rounding errors of zero as zero."""
    return '[' + ', '.join(f'{value + 0.0:.9f}' for value in np.round(list(values), 9)) + ']'
