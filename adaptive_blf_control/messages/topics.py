# SPDX-License-Identifier: Apache-2.0
"""The topics between the nodes, relative to their namespace, with their types."""

from __future__ import annotations

__all__ = ['ADAPTATION_TERM', 'BARRIER', 'COMMANDS', 'EXCITATION', 'GUARANTEE', 'HISTORY_RANK',
           'HISTORY_SIGMA_MIN', 'JOINT_STATES', 'JOINT_TRAJECTORY', 'REFERENCE', 'THETA_HAT',
           'TOPICS', 'TRACKING_ERROR']

JOINT_STATES = 'joint_states'
COMMANDS = 'effort_controller/commands'
THETA_HAT = 'identifier/theta_hat'
HISTORY_RANK = 'identifier/history_rank'
HISTORY_SIGMA_MIN = 'identifier/history_sigma_min'
EXCITATION = 'identifier/excitation'
ADAPTATION_TERM = 'controller/adaptation_term'
REFERENCE = 'controller/reference'
TRACKING_ERROR = 'controller/tracking_error'
BARRIER = 'controller/barrier'
GUARANTEE = 'controller/guarantee'
JOINT_TRAJECTORY = 'controller/joint_trajectory'

TOPICS: dict[str, str] = {
    JOINT_STATES: 'sensor_msgs/msg/JointState',
    COMMANDS: 'std_msgs/msg/Float64MultiArray',
    THETA_HAT: 'sensor_msgs/msg/JointState',
    HISTORY_RANK: 'std_msgs/msg/Int32',
    HISTORY_SIGMA_MIN: 'std_msgs/msg/Float64',
    EXCITATION: 'std_msgs/msg/Float64',
    ADAPTATION_TERM: 'sensor_msgs/msg/JointState',
    REFERENCE: 'sensor_msgs/msg/JointState',
    TRACKING_ERROR: 'sensor_msgs/msg/JointState',
    BARRIER: 'sensor_msgs/msg/JointState',
    GUARANTEE: 'sensor_msgs/msg/JointState',
    JOINT_TRAJECTORY: 'trajectory_msgs/msg/JointTrajectory',
    '/diagnostics': 'diagnostic_msgs/msg/DiagnosticArray',
    '/parameter_events': 'rcl_interfaces/msg/ParameterEvent',
}
