# SPDX-License-Identifier: Apache-2.0
"""The topics of the nodes, each declared once.

From here follow the publishers of controller and identifier, the topics of a simulated bag, what
the recorder records by default, the page docs/topics.md and the SROS 2 policy
(``python -m adaptive_blf_control topics``).
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ['ADAPTATION_TERM', 'ALL', 'BARRIER', 'CLOCK', 'COMMANDS', 'CONSISTENT_MODEL',
           'EXCITATION', 'EXTERNAL_TORQUE', 'GUARANTEE', 'HISTORY_RANK', 'HISTORY_SIGMA_MIN',
           'JOINT_STATES', 'JOINT_TRAJECTORY', 'KINDS', 'OBSTACLES', 'PARAMETER_SET', 'PAYLOAD',
           'PAYLOAD_STD', 'RECORDED', 'REFERENCE', 'RESERVE', 'ROBOT_DESCRIPTION', 'THETA_HAT',
           'THETA_STD', 'TOPICS', 'TRACKING_ERROR', 'Topic', 'published_by']

KINDS = ('arm_driver', 'controller', 'identifier', 'recorder')
"""Kinds of nodes, by which their names are known here."""

ALL = 'all'
"""In the place of a kind: every node publishes the topic."""


@dataclass(frozen=True)
class Topic:
    """One topic.

    Attributes:
        name: Relative to the namespace of the nodes, or absolute.
        type_name: Message type.
        publisher: Kind of the node that publishes it, ALL, or '' if none of these nodes does.
        subscribers: Kinds of the nodes that subscribe to it, besides the recorder.
        content: What its messages mean, in Markdown, with units.
        recorded: Whether the recorder records it by default.
        only_active: Whether there is a publisher only while its node is active.
        only_lockstep: Whether it is published only under ``use_sim_time``.
        lockstep_subscribers: Kinds that subscribe to it only under ``use_sim_time``.
        latched: Whether a late subscriber gets the last message (transient local).
    """

    name: str
    type_name: str
    publisher: str
    subscribers: tuple[str, ...]
    content: str
    recorded: bool = True
    only_active: bool = False
    only_lockstep: bool = False
    lockstep_subscribers: tuple[str, ...] = ()
    latched: bool = False


TOPICS: dict[str, Topic] = {}
"""All topics by name, in the order of the page."""


def _topic(name: str, type_name: str, publisher: str, subscribers: tuple[str, ...], content: str,
           *, recorded: bool = True, only_active: bool = False, only_lockstep: bool = False,
           lockstep_subscribers: tuple[str, ...] = (), latched: bool = False) -> str:
    """Declare a topic and return its name."""
    TOPICS[name] = Topic(name, type_name, publisher, subscribers, content, recorded, only_active,
                         only_lockstep, lockstep_subscribers, latched)
    return name


JOINT_STATES = _topic(
    'joint_states', 'sensor_msgs/msg/JointState', 'arm_driver', ('controller', 'identifier'),
    'position [rad], velocity [rad/s], effort [N·m] = mean torque applied over the interval that '
    '*ends* at `header.stamp`; NaN where nothing was measured')
ROBOT_DESCRIPTION = _topic(
    'robot_description', 'std_msgs/msg/String', 'arm_driver', (),
    'URDF of the simulated arm, for robot_state_publisher and RViz, sent once and kept for late '
    'subscribers; a planar arm is drawn as a chain of cylinders. Not published where the '
    'parameter `urdf` is a topic itself, or where the arm has no URDF', latched=True)
COMMANDS = _topic(
    'effort_controller/commands', 'std_msgs/msg/Float64MultiArray', 'controller', ('arm_driver',),
    "torques [N·m] in the order of `joints`: the interface of ros2_controllers' effort group "
    'controller. It has a publisher only while the controller is active', only_active=True)
THETA_HAT = _topic(
    'identifier/theta_hat', 'sensor_msgs/msg/JointState', 'identifier', ('controller',),
    'named vector: θ̂ by parameter name', lockstep_subscribers=('arm_driver',))
HISTORY_RANK = _topic(
    'identifier/history_rank', 'std_msgs/msg/Int32', 'identifier', (),
    'rank of the history stack; with full rank θ̂ converges (Assumption 2). On every change and '
    'every 200 samples')
HISTORY_SIGMA_MIN = _topic(
    'identifier/history_sigma_min', 'std_msgs/msg/Float64', 'identifier', (),
    'σ_min(H Hᵀ), which sets the rate of convergence. Likewise')
EXCITATION = _topic(
    'identifier/excitation', 'std_msgs/msg/Float64', 'identifier', (),
    'persistence-of-excitation index (21) over `excitation.window`: what the gradient law (20) '
    'needs. Beside the rank it shows why one law converges and the other does not')
EXTERNAL_TORQUE = _topic(
    'identifier/external_torque', 'sensor_msgs/msg/JointState', 'identifier', (),
    'named vector, every `external_torque_decimation` samples: `<joint>`, measured minus '
    'predicted torque behind the filters, which is what acts from outside with the sign turned, '
    'and `<joint>.bound` up to which it means nothing [N·m]. NaN and infinite while the recorded '
    'pairs determine no model')
CONSISTENT_MODEL = _topic(
    'identifier/consistent_model', 'sensor_msgs/msg/JointState', 'identifier', (),
    'named vector, every `model_period`, not in lockstep: the parameters of the physically '
    'consistent model of the recorded pairs, for an arm from a URDF; see '
    '[identification.md](identification.md)')
THETA_STD = _topic(
    'identifier/theta_std', 'sensor_msgs/msg/JointState', 'identifier', (),
    'named vector, likewise: standard deviation of each parameter of θ̂ under the recorded '
    'pairs, infinite where these do not determine it')
PAYLOAD = _topic(
    'identifier/payload', 'geometry_msgs/msg/InertiaStamped', 'identifier', (),
    'every `payload.period` where `payload.frame` is set: the load in that frame, mass [kg], '
    'centre of mass [m], inertia about the centre of mass [kg·m²]; all zero while there is none. '
    'See [identification.md](identification.md#the-load)')
PAYLOAD_STD = _topic(
    'identifier/payload_std', 'geometry_msgs/msg/InertiaStamped', 'identifier', (),
    'likewise: standard deviation of each of these numbers; infinite for centre of mass and '
    'inertia while there is no load')
PARAMETER_SET = _topic(
    'identifier/parameter_set', 'sensor_msgs/msg/JointState', 'identifier', ('controller',),
    'named vector, every `parameter_set.period` where that is not 0: the ellipsoid that holds θ* '
    'if the prior and the bound of the unexplained torque are right, whatever was recorded. '
    'position = its centre, velocity = how far it reaches to either side, by parameter name; then '
    '`size`, the geometric mean of its semi-axes, and `falsified`, how often pairs contradicted '
    'it: it is then the prior again. Then, likewise, the interval of each cause of the prior: '
    '`prior.mass_<joint>`, as a part of the mass in the URDF, `prior.payload` [kg], and '
    '`prior.<parameter>`; the controller takes them with `limits.learn`. See '
    '[limits.md](limits.md)')
ADAPTATION_TERM = _topic(
    'controller/adaptation_term', 'sensor_msgs/msg/JointState', 'controller', ('identifier',),
    'named vector: Xᵀe2 of (37); it acts over the interval that follows its stamp. Joints whose '
    'part would drive their torque further beyond a limit are left out',
    lockstep_subscribers=('arm_driver',))
REFERENCE = _topic(
    'controller/reference', 'sensor_msgs/msg/JointState', 'controller', (),
    'y_d [rad], its velocity [rad/s]; the third array (`effort`) holds its acceleration '
    '[rad/s²]. Every `monitor_decimation` samples')
TRACKING_ERROR = _topic(
    'controller/tracking_error', 'sensor_msgs/msg/JointState', 'controller', (),
    'position = e1 [rad], velocity = e2 [rad/s]; every sample')
BARRIER = _topic(
    'controller/barrier', 'sensor_msgs/msg/JointState', 'controller', (),
    'named vector: the margins of all constraints, and V, whenever the reference is published: '
    '`<joint>.safety_margin`, `<joint>.performance_margin` [rad] and those of '
    '`controller.constraints`, `<body>.<constraint>_margin [unit]`, the smallest since the '
    'previous message; `V` (30)')
RESERVE = _topic(
    'controller/reserve', 'sensor_msgs/msg/JointState', 'controller', (),
    'named vector, with `safety_filter: limits`, whenever the reference is published: '
    '`<joint>.reserve` [N·m], the torque that braking of all joints at once leaves, `clearance` '
    'and `stop_clearance` [m], `path_rate`, each the smallest since the previous message, '
    '`path_off` [rad] and `kind`, the largest: 0 let through, 1 filtered, 2 braking, 3 softened; '
    'see [limits.md](limits.md)')
GUARANTEE = _topic(
    'controller/guarantee', 'sensor_msgs/msg/JointState', 'controller', (),
    'named vector, with `guarantee.mode: bound`: the guarantee of Theorem 2, '
    '`<joint>.error_lower`, `.error_upper` (39), `.output_lower`, `.output_upper` (41), `V0`, '
    '`e2_norm` (40)')
JOINT_TRAJECTORY = _topic(
    'controller/joint_trajectory', 'trajectory_msgs/msg/JointTrajectory', '', ('controller',),
    'points to follow instead of the reference, joined by quintic polynomials. The motion along '
    'them begins 0.1 s after the message arrives (later where computing takes longer); '
    '`header.stamp` is not used. Every joint must be named once, and the last point must be at '
    'rest (velocity and acceleration 0). A first point at 0 s, as MoveIt sends it, must lie '
    'within the performance set around the reference; the motion does not pass through it. The '
    'whole message is refused where names, lengths or times do not fit, where the path leaves '
    'the safety set, or where no motion has begun')
OBSTACLES = _topic(
    'controller/obstacles', 'visualization_msgs/msg/MarkerArray', '', ('controller',),
    'obstacles that move, with `safety_filter: limits`: spheres, cubes and cylinders in the frame '
    '`limits.obstacles.frame`, each known by `ns` and `id` until it is deleted (`action` 2, or 3 '
    'for all). Their velocity is that of the last 0.2 s. A message with anything that cannot be '
    'used is refused as a whole; see [limits.md](limits.md#obstacles-that-move)')
CLOCK = _topic(
    '/clock', 'rosgraph_msgs/msg/Clock', 'arm_driver', KINDS,
    'in lockstep only: the stamp of the state that follows', recorded=False, only_lockstep=True)
_topic('/diagnostics', 'diagnostic_msgs/msg/DiagnosticArray', ALL, (),
       'once a second, see [Diagnostics](interfaces.md#diagnostics)')
_topic('/parameter_events', 'rcl_interfaces/msg/ParameterEvent', ALL, (),
       'every change of a parameter, with its new value')

RECORDED: dict[str, str] = {topic.name: topic.type_name for topic in TOPICS.values()
                            if topic.recorded}
"""Types of the topics that are recorded by default, by name."""


def published_by(kind: str) -> list[Topic]:
    """Return the topics for which a node of this kind has publishers once it is configured."""
    return [topic for topic in TOPICS.values() if topic.publisher == kind
            and not topic.only_active and not topic.only_lockstep]
