# SPDX-License-Identifier: Apache-2.0
"""The parameter tables of the four nodes: the single place where a parameter is declared."""

from __future__ import annotations

from dataclasses import replace

from adaptive_blf_control.control.controller import COUPLINGS
from adaptive_blf_control.identification.update_law import UPDATE_LAWS
from adaptive_blf_control.messages.topics import TOPICS
from adaptive_blf_control.parameters.table import Parameter, Table

__all__ = ['ARM', 'TABLES']

ARM: Table = (
    Parameter('arm', 'string', 'two_link', 'Which arm the regressors describe.',
              choices=('two_link', 'three_link', 'urdf')),
    Parameter('joints', 'string_array', ['joint1', 'joint2'],
              'Joint names in the order of every array; for a URDF a sub-chain may be named.'),
    Parameter('urdf', 'string', '',
              'URDF of the arm: a path, package://..., or topic:NAME to receive it as a '
              'std_msgs/String, e.g. topic:robot_description.'),
    Parameter('gravity', 'double_array', [0.0, 0.0, -9.81],
              'Gravity in the base frame of the URDF.', 'm/s^2', length=3),
    Parameter('friction.viscous', 'bool', True, 'Learn a viscous coefficient per joint (URDF).'),
    Parameter('friction.coulomb', 'bool', False, 'Learn a Coulomb torque per joint (URDF).'),
    Parameter('friction.offset', 'bool', False, 'Learn a constant torque per joint (URDF).'),
    Parameter('friction.coulomb_velocity', 'double', 0.02,
              'v_s of the smooth Coulomb friction tanh(qd/v_s).', 'rad/s', 0.0, exclusive=True),
)

def _with_defaults(table: Table, defaults: dict[str, float]) -> Table:
    return tuple(replace(parameter, default=defaults[parameter.name])
                 if parameter.name in defaults else parameter for parameter in table)


RUNTIME: Table = (
    Parameter('executor', 'string', 'direct',
              'direct: the loop waits on the data alone; plain: everything through the '
              'executor of rclpy, slower.', choices=('direct', 'plain')),
    Parameter('niceness', 'int', 0,
              'Nice value of the loop: what can wait must not delay control.', '', 0, 19),
    Parameter('realtime.priority', 'int', 0,
              'SCHED_FIFO priority of the process where the system permits it; 0 runs as usual.',
              '', 0, 99),
    Parameter('realtime.cpus', 'string', '',
              "Processors the process keeps to, e.g. '0,2-3'; empty: all."),
    Parameter('realtime.slice', 'double', 0.0001,
              'Length of a turn asked of the ordinary scheduler: a short one comes sooner (Linux '
              '6.12 and later); 0 does not ask.', 's', 0.0, 0.1),
    Parameter('realtime.lock_memory', 'bool', False,
              'Keep the memory from being swapped out where the system permits it.'),
)

MANAGED: Table = RUNTIME + (
    Parameter('autostart', 'bool', True,
              'Configure and activate by itself; false waits for lifecycle requests.'),
    Parameter('ramp_time', 'double', 0.2, 'Time over which the torque goes to zero on '
              'deactivation; the controller takes longer where torque_rate_limit asks for it.',
              's', 0.0, 5.0, read_only=False),
)

ARM_DRIVER: Table = ARM + MANAGED + (
    Parameter('rate', 'double', 1000.0, 'Rate of the joint states.', 'Hz', 1.0, 10000.0,
              read_only=False),
    Parameter('initial_position', 'double_array', [0.0], 'Joint positions at the start.', 'rad',
              length='joints'),
    Parameter('initial_velocity', 'double_array', [0.0], 'Joint velocities at the start.',
              'rad/s', length='joints'),
    Parameter('true_model', 'string', 'nominal',
              'Where theta* of the simulated arm comes from: the nominal values of the arm, or '
              'given as true_parameters.', choices=('nominal', 'given')),
    Parameter('true_parameters', 'double_array', [0.0],
              'theta* for true_model: given, p1 p2 p3 fv_joint1 fv_joint2 of two_link.',
              length='parameters', read_only=False),
    Parameter('payload', 'double', 0.0,
              'Point mass at the tip of the true arm, on top of true_model (three_link, urdf).',
              'kg', 0.0, read_only=False),
    Parameter('true_friction.viscous', 'double_array', [0.0],
              'True viscous coefficients of a URDF arm.', 'N*m*s/rad', 0.0, length='joints'),
    Parameter('true_friction.coulomb', 'double_array', [0.0],
              'True Coulomb torques of a URDF arm.', 'N*m', 0.0, length='joints'),
    Parameter('true_friction.offset', 'double_array', [0.0],
              'True constant torques of a URDF arm.', 'N*m', length='joints'),
    Parameter('schedule.time', 'double_array', [0.0],
              'Times, ascending, at which the true arm changes.', 's', 0.0, read_only=False),
    Parameter('schedule.parameter', 'string_array', [''],
              'What changes then: a parameter of the true arm, or payload; an empty name does '
              'nothing.', read_only=False),
    Parameter('schedule.value', 'double_array', [0.0], 'Its new value; the payload in kg.',
              read_only=False),
    Parameter('sensors.model', 'string', 'perfect',
              'perfect: the true state; encoder: counts, and velocities from their differences.',
              choices=('perfect', 'encoder'), read_only=False),
    Parameter('sensors.encoder_counts', 'int', 2000, 'Encoder counts per motor turn.', '', 1,
              read_only=False),
    Parameter('sensors.gear_ratio', 'double', 100.0, 'Motor turns per joint turn.', '', 0.0,
              exclusive=True, read_only=False),
    Parameter('sensors.velocity_time_constant', 'double', 0.005,
              'First-order filter behind the position difference; 0 leaves it bare.', 's', 0.0,
              read_only=False),
    Parameter('sensors.torque_noise', 'double', 0.0,
              'Standard deviation of the measured torque.', 'N*m', 0.0, read_only=False),
    Parameter('sensors.seed', 'int', 0, 'Seed of the noise.', '', 0, read_only=False),
    Parameter('dead_time', 'int', 0, 'Whole samples after which a command acts.', '', 0, 1000,
              read_only=False),
    Parameter('substeps', 'int', 1, 'Runge-Kutta steps per sample.', '', 1, 1000, read_only=False),
    Parameter('torque_limit', 'double_array', [200.0],
              'Torque at which the simulated drives saturate.', 'N*m', 0.0, exclusive=True,
              length='joints', read_only=False),
    Parameter('duration', 'double', 0.0,
              'End the run after this time; 0 runs until stopped.', 's', 0.0, read_only=False),
    Parameter('command_timeout', 'double', 0.1,
              'Without a new command for this long the torque goes to zero.', 's', 0.0, 60.0,
              exclusive=True, read_only=False),
    Parameter('timeout_action', 'string', 'zero',
              'What the drives do after command_timeout: zero: no torque; damping: a torque '
              'against the motion.', choices=('zero', 'damping'), read_only=False),
    Parameter('damping', 'double_array', [5.0], 'Damping of timeout_action: damping.',
              'N*m*s/rad', 0.0, length='joints', read_only=False),
    Parameter('lockstep.rate', 'double', 0.0,
              'Under use_sim_time: times real time; 0 goes as fast as the nodes answer.', '', 0.0,
              1000.0, read_only=False),
    Parameter('lockstep.answers', 'string_array', ['controller', 'identifier'],
              'Under use_sim_time: the nodes that have to answer every state.',
              choices=('controller', 'identifier')),
    Parameter('lockstep.timeout', 'double', 10.0,
              'Under use_sim_time: how long one of them may take.', 's', 0.0, exclusive=True),
    Parameter('wait_for_subscribers', 'int', 0,
              'Publish the first state only when joint_states has this many subscribers.', '', 0),
    Parameter('frame_id', 'string', 'base_link', 'Frame of the joint states.'),
)

IDENTIFIER: Table = ARM + _with_defaults(RUNTIME, {'niceness': 5}) + (
    Parameter('initial_estimate', 'double_array', [0.0], 'theta_hat at the start.',
              length='parameters'),
    Parameter('initial_estimate_file', 'string', '',
              'YAML written by ~/save_estimate to start from instead.'),
    Parameter('estimate_file', 'string', '',
              'Where theta_hat is written, by ~/save_estimate and every estimate_period. Empty: '
              'adaptive_blf_control/NAMESPACE/theta_hat.yaml in ROS_HOME, else in ~/.ros.',
              read_only=False),
    Parameter('estimate_period', 'double', 5.0,
              'The estimate is written to estimate_file this often while learning; 0 only on '
              '~/save_estimate.', 's', 0.0, 3600.0, read_only=False),
    Parameter('resume_within', 'double', 0.0,
              'Start from estimate_file if it was written less than this long ago: an identifier '
              'that was killed goes on where it was; 0 never.', 's', 0.0, 1e9),
    Parameter('gamma', 'double_array', [1.0], 'Diagonal of the adaptation gain Gamma.', '', 0.0,
              exclusive=True, length='parameters', read_only=False),
    Parameter('kt', 'double', 10.0, 'Gain on the present data, k_t.', '', 0.0, read_only=False),
    Parameter('kh', 'double', 10.0, 'Gain on the recorded data, k_h.', '', 0.0, read_only=False),
    Parameter('filter.time_constant', 'double', 0.001, 'Time constant k of the torque filter.',
              's', 0.0, 100.0, exclusive=True, read_only=False),
    Parameter('filter.gap', 'double', 0.05,
              'After a longer interval between samples the filter restarts.', 's', 0.0, 3600.0,
              exclusive=True, read_only=False),
    Parameter('filter.settle', 'double', 5.0,
              'Filter time constants after a (re)start during which nothing is recorded.', '',
              0.0, 1000.0, read_only=False),
    Parameter('filter.state_order', 'int', 0,
              'Order N of the low-pass on position and torque that also gives the velocity, for '
              'coarse encoders; 0 uses the measured velocity. Changing it restarts the filters.',
              '', 0, 8, read_only=False),
    Parameter('filter.state_time_constant', 'double', 0.03,
              'Time constant T of each of its N stages. Changing it restarts the filters.', 's',
              0.0, 100.0, exclusive=True, read_only=False),
    Parameter('change.window', 'double', 0.1,
              'Window of the monitor that empties the history when the arm has changed; 0 is off.',
              's', 0.0, 3600.0, read_only=False),
    Parameter('change.threshold', 'double', 25.0,
              'Mean square residual, in units of the recorded one, that counts as a change.', '',
              1.0, 1e9, exclusive=True, read_only=False),
    Parameter('change.resolution', 'double', 0.01,
              'Part of the torque below which a change does not matter.', '', 0.0, 1.0,
              read_only=False),
    Parameter('history.size', 'int', 20,
              'Number of recorded pairs, P. With fewer the best pairs are kept: one leaves with '
              'every sample.', '', 1, 100000, read_only=False),
    Parameter('history.epsilon', 'double', 0.1,
              'Relative difference of a new pair to the last one taken, epsilon; the first pair '
              'of all differs by 1.', '', 0.0, 1.0, read_only=False),
    Parameter('history.minimum_growth', 'double', 0.0,
              'Part of sigma_min by which a replacement in a full history must raise it; 0 asks '
              'only that it does not fall, as Algorithm 1 does. Keeps a history of noisy pairs '
              'from hunting outliers for ever.', '', 0.0, 1e6, read_only=False),
    Parameter('history.noise', 'double', 0.0,
              'Remark 3: standard deviation of the noise put on recorded regressors, relative to '
              'them, while the measured pairs lack rank. It fabricates data: theta_hat is biased '
              'until those pairs are gone. 0 is off.', '', 0.0, 100.0, read_only=False),
    Parameter('history.noise_seed', 'int', 0, 'Seed of that noise.', '', 0, read_only=False),
    Parameter('excitation.window', 'double', 10.0,
              'Window T of the persistence-of-excitation index (21); 0 switches it off.', 's',
              0.0, 3600.0, read_only=False),
    Parameter('update_law', 'string', 'ablf_concurrent',
              'gradient (20): present data only; concurrent (22): recorded data as well; '
              'ablf_concurrent (37): the stabilising term X^T e2 as well.', choices=UPDATE_LAWS,
              read_only=False),
    Parameter('adaptation_term_timeout', 'double', 0.1,
              'An adaptation term older than this (by stamp) counts as zero.', 's', 0.0,
              3600.0, exclusive=True, read_only=False),
)

CONTROLLER: Table = ARM + MANAGED + (
    Parameter('k1', 'double_array', [40.0], 'Gains of the stabilising function (27).',
              '1/(s*rad^4)', 0.0, exclusive=True, length='joints', read_only=False),
    Parameter('k2', 'double_array', [30.0], 'Gains on e2 in (38).', 'N*m*s/rad', 0.0,
              exclusive=True, length='joints', read_only=False),
    Parameter('coupling', 'string', 'per_joint',
              'How the barrier acts on the torque: per_joint (smooth) or the pseudoinverse of '
              'the paper.', choices=COUPLINGS, read_only=False),
    Parameter('torque_limit', 'double_array', [100.0], 'Largest commanded torque.', 'N*m', 0.0,
              exclusive=True, length='joints', read_only=False),
    Parameter('torque_rate_limit', 'double_array', [10000.0],
              'Largest change of the commanded torque.', 'N*m/s', 0.0, exclusive=True,
              length='joints', read_only=False),
    Parameter('model', 'string', 'estimated',
              'estimated: theta_hat from the identifier (38); known: known_parameters (34).',
              choices=('estimated', 'known')),
    Parameter('known_parameters', 'double_array', [0.0], 'theta* for model: known.',
              length='parameters'),
    Parameter('initial_estimate', 'double_array', [0.0],
              'theta_hat until the identifier publishes one.', length='parameters'),
    Parameter('estimate_limit', 'double_array', [1000.0],
              'Largest absolute value of an element of theta_hat that is believed; an estimate '
              'beyond it is refused and the last good one kept.', '', 0.0, exclusive=True,
              length='parameters', read_only=False),
    Parameter('safety.lower', 'double_array', [-3.14], 'Lower end of the safety set, k_c (7).',
              'rad', length='joints', read_only=False),
    Parameter('safety.upper', 'double_array', [3.14], 'Upper end of the safety set, k_d (7).',
              'rad', length='joints', read_only=False),
    Parameter('performance.lower', 'double_array', [-0.15],
              'Lower end of the performance set, -k_a (8). Equal and opposite to the upper end it '
              'gives the symmetric barrier (SBLF) for that joint.', 'rad', length='joints',
              read_only=False),
    Parameter('performance.upper', 'double_array', [0.15],
              'Upper end of the performance set, k_b (8).', 'rad', length='joints',
              read_only=False),
    Parameter('on_violation', 'string', 'continue',
              'When a joint leaves a set: continue: the barrier pushes back; stop: the torque '
              'goes to zero and the node is deactivated.', choices=('continue', 'stop'),
              read_only=False),
    Parameter('reference.<joint>.offset', 'double', 0.0, 'Centre of the sinusoids.', 'rad',
              read_only=False),
    Parameter('reference.<joint>.amplitude', 'double_array', [0.0],
              'Amplitudes of the sinusoids.', 'rad', read_only=False),
    Parameter('reference.<joint>.frequency', 'double_array', [1.0],
              'Angular frequencies of the sinusoids.', 'rad/s', read_only=False),
    Parameter('reference.<joint>.phase', 'double_array', [0.0], 'Phases of the sinusoids.',
              'rad', read_only=False),
    Parameter('reference.smooth_start', 'double', 2.0,
              'Time over which the measured posture is joined to the reference and the '
              'performance set grows to its width; 0 starts on the reference.', 's', 0.0,
              read_only=False),
    Parameter('reference.resume_time', 'double', 2.0,
              'Time over which the measured posture is joined to the reference when the motion '
              'begins anew, after joint states were lost or the clock jumped ahead.', 's', 0.0,
              exclusive=True, read_only=False),
    Parameter('guarantee.mode', 'string', 'off',
              'bound: state at the start what Theorem 2 promises and watch it, from the three '
              'bounds below; off: nothing is known about the arm.', choices=('off', 'bound'),
              read_only=False),
    Parameter('guarantee.theta_error', 'double', 10.0,
              'Bound on the norm of the parameter error at the start.', '', 0.0, read_only=False),
    Parameter('guarantee.smallest_gamma', 'double', 1.0,
              'Smallest element of Gamma of the identifier.', '', 0.0, exclusive=True,
              read_only=False),
    Parameter('guarantee.mass', 'double_array', [0.1, 10.0],
              'Bounds on the smallest and the largest eigenvalue of the inertia matrix.', 'kg*m^2',
              0.0, exclusive=True, length=2, read_only=False),
    Parameter('state_timeout', 'double', 0.1,
              'Without a new joint state for this long a zero torque is commanded.', 's', 0.0,
              60.0, exclusive=True, read_only=False),
    Parameter('monitor_decimation', 'int', 10,
              'Publish reference and barrier every this many samples, with the smallest margins '
              'since the last time; the tracking error goes out with every sample.', '', 1,
              read_only=False),
)

# It wakes a hundred times a second: no short turns.
RECORDER: Table = _with_defaults(RUNTIME, {'niceness': 10, 'realtime.slice': 0.0}) + (
    Parameter('bag', 'string', 'bag', 'Folder of the bag; must not exist.'),
    Parameter('topics', 'string_array', list(TOPICS), 'Topics to record.'),
    Parameter('flush_period', 'double', 0.5, 'A chunk reaches the disk at least this often.', 's',
              0.01, 1.0),
)

TABLES: dict[str, Table] = {
    'arm_driver': ARM_DRIVER,
    'identifier': IDENTIFIER,
    'controller': CONTROLLER,
    'recorder': RECORDER,
}
