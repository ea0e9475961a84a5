# SPDX-License-Identifier: Apache-2.0
"""Parameters of running nodes: set by service as ``ros2 param set`` and rqt do, used at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping
import math
from typing import Any

import numpy as np
import pytest
from rcl_interfaces.srv import DescribeParameters, SetParameters, SetParametersAtomically
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from adaptive_blf_control.arms.three_link import ThreeLinkArm
from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.configuration.node_settings import TABLES
from adaptive_blf_control.control.barrier import barrier
from adaptive_blf_control.control.reference import SumOfSinusoids
from adaptive_blf_control.messages.topics import COMMANDS, GUARANTEE, JOINT_STATES, THETA_HAT
from adaptive_blf_control.nodes.arm_driver import ArmDriver
from adaptive_blf_control.nodes.controller import ControllerNode
from adaptive_blf_control.nodes.identifier import IdentifierNode
from adaptive_blf_control.nodes.recorder import Recorder
from adaptive_blf_control.parameters.table import per_joint
from adaptive_blf_control.simulation.sensors import Encoder, PerfectSensor
from patience import PATIENCE

KINDS = {'arm_driver': ArmDriver, 'identifier': IdentifierNode, 'controller': ControllerNode,
         'recorder': Recorder}
THETA = [3.473, 0.196, 0.242, 5.3, 1.1]
TASK = {  # a controller whose states come when the test sends them
    'initial_estimate': THETA, 'state_timeout': 60.0, 'reference__smooth_start': 0.0,
    'reference__resume_time': 0.5, 'k2': [10.0, 4.0],
    'performance__lower': [-0.15], 'performance__upper': [0.15],
    'reference__joint1__amplitude': [0.3], 'reference__joint1__frequency': [0.5],
    'reference__joint2__amplitude': [0.2], 'reference__joint2__frequency': [0.8],
}
ERROR, QD = np.array([0.05, -0.06]), [0.1, 0.2]
TRUE = ThreeLinkArm().nominal.tolist()
ARM = {  # a driver in which everything that can change is in use
    'arm': 'three_link', 'joints': ['joint1', 'joint2', 'joint3'], 'true_model': 'given',
    'true_parameters': TRUE, 'rate': 50.0, 'command_timeout': 60.0,
    'sensors__model': 'encoder', 'schedule__time': [5000.0], 'schedule__parameter': ['payload'],
    'schedule__value': [20.0],
}

# A valid new value of everything that may change while a node runs.
NEW: dict[str, dict[str, Any]] = {
    'arm_driver': {
        'ramp_time': 0.5, 'rate': 80.0, 'true_parameters': [1.1 * x for x in TRUE],
        'payload': 2.0, 'schedule.time': [4000.0],
        'schedule.parameter': [ThreeLinkArm().parameters[0]], 'schedule.value': [30.0],
        'sensors.model': 'perfect', 'sensors.encoder_counts': 500,
        'sensors.gear_ratio': 50.0, 'sensors.velocity_time_constant': 0.01,
        'sensors.torque_noise': 0.2, 'sensors.seed': 7, 'dead_time': 3, 'substeps': 2,
        'torque_limit': [30.0, 20.0, 10.0], 'duration': 5000.0, 'command_timeout': 30.0,
        'timeout_action': 'damping', 'damping': [1.0, 2.0, 3.0], 'lockstep.rate': 2.0,
    },
    'identifier': {
        'estimate_period': 60.0, 'model_period': 90.0,
        'gamma': [1.0, 2.0, 3.0, 4.0, 5.0], 'kt': 3.0, 'kh': 4.0, 'filter.time_constant': 0.01,
        'filter.gap': 0.2, 'filter.settle': 1.0, 'filter.state_order': 3,
        'filter.state_time_constant': 0.01, 'change.window': 0.3, 'change.threshold': 30.0,
        'change.resolution': 0.05, 'history.size': 12, 'history.epsilon': 0.02,
        'history.minimum_growth': 0.1, 'history.noise': 0.01, 'history.noise_seed': 5,
        'excitation.window': 3.0, 'update_law': 'gradient', 'adaptation_term_timeout': 0.5,
        'filter.effort': 'instant', 'change.suspicion': 4.0, 'change.settle': 2.0,
        'change.patience': 1.0, 'change.adapt': True, 'known_contact': True,
        'position_limit_margin': 0.1, 'filter.distortion': 0.02,
        'external_torque_decimation': 3, 'composed_decimation': 3,
    },
    'controller': {
        'ramp_time': 0.5, 'k1': [50.0, 60.0], 'k2': [5.0, 3.0], 'coupling': 'pseudoinverse',
        'torque_limit': [50.0, 40.0], 'torque_rate_limit': [5000.0],
        'estimate_limit': [500.0, 400.0, 300.0, 200.0, 100.0],
        'safety.lower': [-3.0, -2.0], 'safety.upper': [2.5], 'performance.lower': [-0.2],
        'performance.upper': [0.1, 0.3], 'on_violation': 'stop',
        'reference.joint1.offset': 0.1, 'reference.joint1.amplitude': [0.2],
        'reference.joint1.frequency': [0.7], 'reference.joint1.phase': [0.3],
        'reference.joint2.offset': -0.1, 'reference.joint2.amplitude': [0.1],
        'reference.joint2.frequency': [0.3], 'reference.joint2.phase': [-0.2],
        'reference.smooth_start': 1.0, 'reference.resume_time': 1.5, 'guarantee.mode': 'bound',
        'guarantee.theta_error': 5.0, 'guarantee.smallest_gamma': 0.5,
        'guarantee.mass': [0.2, 5.0], 'state_timeout': 30.0, 'monitor_decimation': 3,
        'slotine_li.gamma': [100.0], 'barrier_weight': [0.5, 0.2], 'coupling_reach': 0.8,
        'composed_decimation': 3,
        'reference.velocity_limit': 9.0, 'reference.acceleration_limit': 90.0,
        # Of the safety filter, which is not in use here.
        'limits.velocity': [2.0, 3.0], 'limits.braking': [5.0],
        'limits.braking_rule': 'short_stops', 'limits.link_radius': 0.1,
        'limits.link_spheres': [2.0, 0.0, 0.0, 0.1, 0.05],
        'limits.obstacles.spheres': [0.5, 0.0, 0.5, 0.1], 'limits.obstacles.margin': 0.03,
        'limits.obstacles.capsules': [0.5, 0.0, 0.5, 0.5, 0.0, 0.9, 0.1],
        'limits.obstacles.boxes': [0.5, 0.0, 0.5, 0.1, 0.1, 0.1],
        'limits.obstacles.half_spaces': [0.0, 0.0, 0.1, 0.0, 0.0, 1.0],
        'limits.obstacles.speed': 0.5, 'limits.obstacles.timeout': 0.2,
        'limits.obstacles.least_speed': 0.05,
        'limits.self_collision': True,
    },
    'recorder': {},
}
# Read where they are needed, each time: then the node's values are what is in use.
READ_EACH_TIME = {
    'arm_driver': {'ramp_time', 'duration', 'command_timeout', 'timeout_action', 'damping',
                   'lockstep.rate'},
    'identifier': {'adaptation_term_timeout', 'composed_decimation'},
    'controller': {'ramp_time', 'on_violation', 'reference.resume_time', 'state_timeout',
                   'reference.smooth_start', 'guarantee.mode', 'guarantee.theta_error',
                   'reference.velocity_limit', 'reference.acceleration_limit',
                   'guarantee.smallest_gamma', 'guarantee.mass', 'monitor_decimation',
                   'composed_decimation'},
}


def _driver_uses(node: ArmDriver) -> dict[str, Any]:
    plant, arm = node.plant, ThreeLinkArm()
    first, *later = plant.epochs
    theta = np.array([first.parameters[name] for name in arm.parameters])
    sensors = plant.settings.sensors
    model = {PerfectSensor: 'perfect', Encoder: 'encoder'}[type(
        getattr(plant.sensor, 'sensor', plant.sensor))]
    changed = [name for name in arm.parameters
               if later[0].parameters[name] != first.parameters[name]]
    payload = node.settings.payload
    return {
        'rate': 1e9 / node.grid.period_ns, 'payload': payload if np.allclose(
            theta, node.settings.true_parameters + payload * arm.payload_direction,
            rtol=1e-15) else None,
        'true_parameters': theta - payload * arm.payload_direction,
        'schedule.time': [epoch.t for epoch in later],
        'schedule.parameter': changed if len(changed) == 1 else ['payload'],
        'schedule.value': [
            later[0].parameters[changed[0]] if len(changed) == 1 else
            (later[0].parameters[changed[0]] - theta[arm.parameters.index(changed[0])])
            / arm.payload_direction[arm.parameters.index(changed[0])]],
        'sensors.model': model,
        'sensors.encoder_counts': sensors.encoder_counts,
        'sensors.gear_ratio': sensors.gear_ratio,
        'sensors.velocity_time_constant': sensors.velocity_time_constant,
        'sensors.torque_noise': sensors.torque_noise, 'sensors.seed': sensors.seed,
        # Nothing public tells the torques that are delayed from the setting.
        'dead_time': len(plant._line.commands) * (plant.settings.dead_time > 0),
        'substeps': plant.settings.substeps,
        'torque_limit': plant.torque_limit,
    }


def _identifier_uses(node: IdentifierNode) -> dict[str, Any]:
    identifier, settings = node.identifier, node.identifier.settings
    return {
        'estimate_period': node.saver.period,
        'model_period': node.model.period,
        'gamma': settings.gamma, 'kt': settings.kt, 'kh': settings.kh,
        **{f'filter.{name}': value for name, value in settings.filter.values().items()},
        'filter.state_order': round((identifier.memory - settings.filter.time_constant)
                                    / settings.filter.state_time_constant),
        **{f'change.{name}': value for name, value in settings.change.values().items()},
        **{f'history.{name}': value for name, value in settings.history.values().items()},
        'history.size': identifier.stack.size,
        'excitation.window': settings.excitation.window, 'update_law': settings.update_law,
        'known_contact': settings.known_contact,
        'position_limit_margin': settings.position_limit_margin,
        'external_torque_decimation': node._stream.decimation,  # nothing public tells it
    }


def _gains(node: ControllerNode) -> tuple[list[float], list[float]]:
    return node.settings.k1.tolist(), node.settings.k2.tolist()


def _controller_uses(node: ControllerNode) -> dict[str, Any]:
    controller, settings = node.motion.controller, node.motion.controller.settings
    uses = {
        'k1': settings.k1, 'k2': settings.k2, 'coupling': settings.coupling,
        'barrier_weight': settings.barrier_weight, 'coupling_reach': settings.coupling_reach,
        'torque_limit': settings.torque_limit, 'torque_rate_limit': settings.torque_rate_limit,
        'estimate_limit': node.estimates.gate.limit,
        'slotine_li.gamma': settings.slotine_li.gamma,
        **{f'limits.{name}': value for name, value in settings.limits.values().items()},
        'safety.lower': controller.safety.lower, 'safety.upper': controller.safety.upper,
        'performance.lower': node.output.bounds.lower,
        'performance.upper': node.output.bounds.upper,
    }
    for i, joint in enumerate(('joint1', 'joint2')):
        values = [np.array(node.settings.values()[f'reference.{joint}.{name}'])
                  for name in ('offset', 'amplitude', 'frequency', 'phase')]
        offset, *terms = values
        law = SumOfSinusoids(offset.reshape(1), *(x.reshape(1, -1) for x in terms))
        t = node.motion.t
        follows = np.allclose([x[i] for x in node.output.reference], np.array(law.at(t))[:, 0],
                              rtol=1e-12)
        uses.update({f'reference.{joint}.{name}': value if follows else None for name, value in
                     zip(('offset', 'amplitude', 'frequency', 'phase'), values)})
    return uses


USES: dict[str, Callable[[Any], dict[str, Any]]] = {
    'arm_driver': _driver_uses, 'identifier': _identifier_uses, 'controller': _controller_uses}


def _state(t: float, q, qd=QD) -> JointState:
    message = JointState(name=['joint1', 'joint2'], position=[float(x) for x in q],
                         velocity=[float(x) for x in qd], effort=[0.5, -0.3])
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(
        1_000_000_000_000 + round(t * 1e9), 10**9)
    return message


class _Live:
    """A running node, the services through which its parameters are set, and its states."""

    def __init__(self, graph, wait_until, kind: str, namespace: str = '', **parameters) -> None:
        self.node = graph.make(KINDS[kind], namespace=namespace, **parameters)
        self.kind = kind
        self.runner = graph.run(self.node)
        self.peer = graph.peer()
        self.t = 0.0
        self._wait_until = wait_until
        self._clients = {service: self.peer.create_client(
            service, f'{namespace}/{kind}/{name}') for service, name in (
                (SetParameters, 'set_parameters'), (DescribeParameters, 'describe_parameters'),
                (SetParametersAtomically, 'set_parameters_atomically'))}
        assert all(client.wait_for_service(PATIENCE) for client in self._clients.values())
        self._states = self.peer.create_publisher(JointState, f'{namespace}/{JOINT_STATES}', 10)
        self.commands = self.peer.listen(Float64MultiArray, f'{namespace}/{COMMANDS}') \
            if kind == 'controller' else []

    def call(self, request: Any) -> Any:
        service = next(kind for kind in self._clients if isinstance(request, kind.Request))
        future = self._clients[service].call_async(request)
        return self._wait_until(lambda: future.done() and future.result(), what='the answer')

    def set(self, values: Mapping[str, Any]) -> Any:
        """Set all together; return the result."""
        return self.call(SetParametersAtomically.Request(parameters=_messages(values))).result

    def set_each(self, values: Mapping[str, Any]) -> list[Any]:
        """Set one by one, as ``ros2 param set`` and rqt do; return the results."""
        return self.call(SetParameters.Request(parameters=_messages(values))).results

    @property
    def drops(self) -> dict[str, int]:
        """What was dropped, but for the first state, which is sent until it is answered."""
        return {reason: count for reason, count in self.node.faults.drops.items()
                if reason != 'joint state out of order'}

    def step(self, by: float = 1e-3, q=None, qd=QD) -> Any:
        """Let time pass, send a state, by default beside the reference; return the answer."""
        node = self.node
        self.t += by if node.statistics.samples else 0.0
        controller = node.motion.controller if hasattr(node, 'motion') else None
        if q is None:
            q = ERROR if controller is None else controller.reference.at(self.t).position + ERROR
        samples, message = node.statistics.samples, _state(self.t, q, qd)

        def answered() -> bool:
            self._states.publish(message)
            return node.statistics.samples > samples

        if samples == 0:  # not matched yet, or the controller has yet to activate itself
            self._wait_until(answered, what='the first answer')
        else:
            self._states.publish(message)
            self._wait_until(lambda: node.statistics.samples > samples, what='the answer')
        return getattr(node, 'output', None)


def _messages(values: Mapping[str, Any]) -> list[Any]:
    return [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]


def _same(a: Any, b: Any) -> bool:
    first, second = (np.atleast_1d(x) for x in (a, b))
    if first.dtype.kind in 'OU' or second.dtype.kind in 'OU':
        return list(first) == list(second)
    # A list of one stands for all joints or parameters.
    return bool(np.allclose(first, second, rtol=1e-9, atol=0.0))


def _used(live: _Live, name: str) -> Any:
    if name in READ_EACH_TIME[live.kind]:
        return live.node.settings.values()[name]
    return USES[live.kind](live.node)[name]


@pytest.fixture(scope='module')
def lives(graph_of_all, wait_until, tmp_path_factory):
    """Return ``lives(kind)``: one running node of each kind, started when first asked for."""
    running: dict[str, _Live] = {}

    def of(kind: str) -> _Live:
        if kind not in running:
            folder = tmp_path_factory.mktemp('live')
            given = {'arm_driver': ARM, 'controller': TASK,
                     'identifier': {'estimate_file': str(folder / 'theta_hat.yaml')},
                     'recorder': {'bag': str(folder / 'bag')}}[kind]
            running[kind] = _Live(graph_of_all, wait_until, kind, f'/{kind}s', **given)
            if kind in ('controller', 'identifier'):
                running[kind].step()
        return running[kind]

    return of


@pytest.fixture
def controller(graph, wait_until):
    """Return ``controller(**parameters)``: a running one in the middle of a motion."""
    def make(namespace: str = '', **parameters) -> _Live:
        live = _Live(graph, wait_until, 'controller', namespace, **{**TASK, **parameters})
        live.step()
        return live

    return make


def _live_names(kind: str) -> set[str]:
    table = per_joint(TABLES[kind], ('joint1', 'joint2') if kind != 'recorder' else ())
    return {name for name, parameter in table.items() if not parameter.read_only}


@pytest.mark.parametrize('kind', KINDS)
def test_every_parameter_that_may_change_is_tried_here(kind) -> None:
    assert set(NEW[kind]) == _live_names(kind)


@pytest.mark.parametrize(('kind', 'name'), [(kind, name) for kind in NEW for name in NEW[kind]])
def test_a_running_node_takes_a_new_value_and_uses_it(lives, kind, name) -> None:
    live = lives(kind)
    node, value, before = live.node, NEW[kind][name], live.node.settings.values()
    assert not _same(_used(live, name), value)
    for new in (value, before[name]):  # and back again, for the next one
        [result] = live.set_each({name: new})
        assert result.successful, result.reason
        assert node.settings.values() == {**before, name: new}
        read = node.get_parameter(name).value
        assert (read if isinstance(new, (str, float, int)) else list(read)) == new
        if kind == 'controller':
            live.step(2.0)  # longer than the blend time
        assert _same(_used(live, name), new), (_used(live, name), new)
    assert live.runner.error is None
    assert live.drops == {}


def _another(parameter) -> Any:
    """Return a value of the right type and length that is not the default."""
    default = list(parameter.default) if parameter.is_array else [parameter.default]
    choices = [choice for choice in parameter.choices if choice != parameter.default]
    changed = [choices[0] if choices else not x if isinstance(x, bool) else
               f'{x}x' if isinstance(x, str) else x + type(x)(1) for x in default]
    return changed if parameter.is_array else changed[0]


@pytest.mark.parametrize('kind', KINDS)
def test_what_is_structure_is_refused_as_read_only(lives, kind) -> None:
    live = lives(kind)
    fixed = {name: parameter for name, parameter in
             per_joint(TABLES[kind], ('joint1', 'joint2')).items() if parameter.read_only}
    before = live.node.settings.values()
    for name, parameter in fixed.items():
        for result in (*live.set_each({name: _another(parameter)}),
                       live.set({name: _another(parameter)})):
            assert not result.successful
            assert 'read-only' in result.reason
            assert name in result.reason
    assert live.node.settings.values() == before
    assert len(fixed) > 4


@pytest.mark.parametrize('kind', KINDS)
def test_the_clock_of_a_running_node_stays_the_one_it_started_with(lives, kind) -> None:
    live = lives(kind)
    gain = next(iter(NEW[kind].items()), None)
    both = {'use_sim_time': True, **({} if gain is None else {gain[0]: gain[1]})}
    before = live.node.settings.values()
    result = live.set(both)
    assert not result.successful
    assert 'use_sim_time is read-only' in result.reason
    assert live.node.settings.values() == before
    assert not live.node.get_clock().ros_time_is_active
    assert live.set({'use_sim_time': False}).successful


@pytest.mark.parametrize('kind', KINDS)
def test_descriptors_tell_rqt_text_unit_range_and_what_may_change(lives, kind) -> None:
    live = lives(kind)
    joints = live.node.settings.values().get('joints', [])
    table = per_joint(TABLES[kind], joints)
    descriptors = live.call(DescribeParameters.Request(names=list(table))).descriptors
    for descriptor, parameter in zip(descriptors, table.values(), strict=True):
        assert descriptor.name == parameter.name
        assert descriptor.description.startswith(parameter.description)
        assert descriptor.description.endswith(f' [{parameter.unit}]' if parameter.unit else '.')
        assert descriptor.read_only == parameter.read_only
        ranges = [*descriptor.floating_point_range, *descriptor.integer_range]
        bounded = parameter.minimum is not None or parameter.maximum is not None
        assert len(ranges) == (bounded and parameter.kind in ('int', 'double'))
        if ranges:  # rqt puts integers on a slider, and open ends of the others on a curve
            most = 2**31 - 1 if parameter.kind == 'int' else math.inf
            assert [ranges[0].from_value, ranges[0].to_value] == [
                other if bound is None else bound for bound, other in (
                    (parameter.minimum, -most), (parameter.maximum, most))]
        for part in (parameter.range_text(), *parameter.choices):
            assert part in descriptor.additional_constraints


def test_of_single_requests_each_is_judged_alone_of_an_atomic_one_all_together(
        controller) -> None:
    live = controller()
    two = {'k1': [50.0], 'k2': [-1.0]}
    assert not live.set(two).successful
    assert _gains(live.node) == ([40.0], [10.0, 4.0])
    assert [result.successful for result in live.set_each(two)] == [True, False]
    assert _gains(live.node) == ([50.0], [10.0, 4.0])
    assert live.set({'k1': [60.0], 'k2': [5.0]}).successful
    assert _gains(live.node) == ([60.0], [5.0])
    np.testing.assert_array_equal(live.node.motion.controller.settings.k1, [60.0, 60.0])
    np.testing.assert_array_equal(live.node.motion.controller.settings.k2, [5.0, 5.0])


def test_what_belongs_together_has_to_come_in_one_request(lives) -> None:
    live = lives('controller')
    more = {f'reference.joint1.{name}': [value, 0.1] for name, value in (
        ('amplitude', 0.3), ('frequency', 0.5), ('phase', 0.0))}
    before = live.node.settings.values()
    for name, value in more.items():
        [result] = live.set_each({name: value})
        assert not result.successful
        assert 'reference.joint1' in result.reason
        assert 'same length' in result.reason
    assert live.node.settings.values() == before
    assert live.set(more).successful
    live.step(2.0)
    assert np.size(_used(live, 'reference.joint1.amplitude')) == 2
    assert live.set({name: before[name] for name in more}).successful
    live.step(2.0)


REFUSED = [  # q beside the reference, the request, what the reason has to hold
    (ERROR, {'performance.upper': [0.04, 0.15]}, ["'joint1'", 'present error', '0.05', '0.04']),
    (ERROR, {'performance.lower': [-0.15, -0.055]}, ["'joint2'", 'error', '-0.06', '-0.055']),
    (ERROR, {'performance.upper': [0.05, 0.15]}, ["'joint1'", '0.05 rad against 0.05 rad']),
    (ERROR, {'performance.upper': [3.0]}, ["'joint1'", 'exceeds', '3.3 rad against 3.14 rad']),
    (ERROR, {'performance.upper': [-0.1]}, ['performance', '-0.1', 'lower < 0 < upper']),
    ([1.0, 0.0], {'safety.upper': [0.9, 3.14]}, ["'joint1'", 'present position', '0.9']),
    ([0.0, -1.0], {'safety.lower': [-3.14, -0.9]}, ["'joint2'", 'present position', '-0.9']),
    (ERROR, {'safety.upper': [0.4]}, ["'joint1'", 'exceeds', '0.45 rad against 0.4 rad']),
    (ERROR, {'safety.upper': [-4.0]}, ['safety.lower', '-4.0']),
    (ERROR, {'reference.joint2.amplitude': [3.1]}, ["'joint2'", '-3.25 rad against -3.14 rad']),
    (ERROR, {'reference.joint1.amplitude': [0.1, 0.1]}, ['joint1', 'same length']),
    (ERROR, {'estimate_limit': [1.0, 2.0]}, ['controller.estimate_limit', 'length 1 or 5']),
    (ERROR, {'torque_limit': [5.0, 0.0]}, ['controller.torque_limit', '0.0', '> 0 N*m']),
    (ERROR, {'on_violation': 'panic'}, ['on_violation', "'panic'", 'continue, stop']),
    (ERROR, {'ramp_time': 6.0}, ['ramp_time', '6.0', '5.0']),
    (ERROR, {'guarantee.mass': [1.0]}, ['guarantee.mass', '[1.0]', 'length 2']),
    (ERROR, {'state_timeout': 1}, ['controller.state_timeout', 'is 1:', 'write 1.0']),
]


@pytest.mark.parametrize(('beside', 'request_', 'words'), REFUSED,
                         ids=[f'{i} {next(iter(r))}' for i, (_, r, _) in enumerate(REFUSED)])
def test_a_refused_request_says_why_and_changes_nothing_not_even_the_torque(
        graph, wait_until, beside, request_, words) -> None:
    asked, other = (_Live(graph, wait_until, 'controller', namespace, loop__unstable='warn',
                          **TASK)
                    for namespace in ('/asked', '/other'))
    for live in (asked, other):
        live.step()
        at = live.node.motion.controller.reference.at(live.t + 1e-3).position
        live.step(q=at + np.array(beside))
    node = asked.node
    law = node.motion.controller
    before = (node.settings.values(), law.settings, law.safety, law.performance, law.reference,
              node.estimates.gate.limit, node.theta)
    k1 = {'k1': [70.0]}
    result = asked.set({**k1, **request_})
    assert not result.successful
    for word in words:
        assert word in result.reason, result.reason
    after = (node.settings.values(), law.settings, law.safety, law.performance, law.reference,
             node.estimates.gate.limit, node.theta)
    assert before[0] == after[0]
    assert all(a is b for a, b in zip(before[1:], after[1:]))
    assert node.motion.controller is law
    for name, value in {**k1, **request_}.items():
        assert node.get_parameter(name).value != value
    for _ in range(3):
        np.testing.assert_array_equal(asked.step().torque, other.step().torque)
    assert asked.set(k1).successful
    assert (asked.step().torque != other.step().torque).any()


def test_bounds_are_tightened_up_to_the_present_error_and_used_at_once(controller) -> None:
    live = controller(loop__unstable='warn')  # bounds as narrow as these are stiff
    assert live.set({'performance.upper': [0.051, 0.01], 'performance.lower': [-0.01, -0.061]
                     }).successful
    output = live.step()
    np.testing.assert_array_equal(output.bounds.upper, [0.051, 0.01])
    np.testing.assert_array_equal(output.bounds.lower, [-0.01, -0.061])
    np.testing.assert_array_equal(output.bound, [0.051, 0.061])
    assert live.node.monitors.violations == 0
    np.testing.assert_allclose(live.node.monitors.margins[2:], 0.001, rtol=1e-9)


def test_before_the_motion_sets_may_change_and_count_from_its_first_sample(
        graph, wait_until) -> None:
    live = _Live(graph, wait_until, 'controller', loop__unstable='warn', **TASK)
    assert live.set({'performance.upper': [0.055]}).successful
    result = live.set({'performance.upper': [4.0]})
    assert 'exceeds' in result.reason
    np.testing.assert_array_equal(live.step().bounds.upper, [0.055, 0.055])


def test_a_reference_set_while_running_is_faded_to_without_a_jump(controller) -> None:
    live = controller(reference__resume_time=0.5)
    live.step(1.0)
    old, t = live.node.motion.controller.reference, live.t
    assert live.set({'reference.joint1.offset': 0.4, 'reference.joint2.amplitude': [0.5],
                     'reference.joint2.frequency': [0.2]}).successful
    new = SumOfSinusoids(np.array([0.4, 0.0]), np.array([[0.3], [0.5]]), np.array([[0.5], [0.2]]),
                         np.zeros((2, 1)))
    np.testing.assert_allclose(live.node.motion.controller.reference.at(t), old.at(t), atol=1e-12)
    points = [np.array(old.at(t))]
    while live.t < t + 0.6:
        points.append(np.array(live.step(5e-3).reference))
    points = np.array(points)
    position, velocity, acceleration = points[:, 0], points[:, 1], points[:, 2]
    assert np.abs(np.diff(position, axis=0)).max() <= 5e-3 * np.abs(velocity).max()
    assert np.abs(np.diff(velocity, axis=0)).max() <= 5e-3 * np.abs(acceleration).max() * 1.01
    assert np.abs(np.diff(acceleration, axis=0)).max() < 2.0  # of ±10; an abrupt one: 9
    np.testing.assert_allclose(points[-1], new.at(live.t), rtol=1e-12, atol=1e-12)
    assert np.abs(np.array(old.at(live.t)) - points[-1]).max() > 0.1
    assert live.node.monitors.violations == 0


def test_gains_and_limits_set_by_service_are_those_of_the_next_torque(controller) -> None:
    live = controller()
    assert np.abs(live.step().torque).max() > 0.03
    assert live.set({'torque_limit': [0.02, 0.03]}).successful
    np.testing.assert_array_equal(np.abs(live.step(qd=[0.6, 0.7]).torque), [0.02, 0.03])
    assert live.set({'torque_limit': [100.0], 'torque_rate_limit': [40.0, 20.0],
                     'k2': [900.0, 50.0]}).successful
    before = live.node.output.torque
    torque = live.step(2e-3, qd=[-0.6, -0.7]).torque
    np.testing.assert_allclose(np.abs(torque - before), [0.08, 0.04], rtol=1e-12)


def test_a_k2_too_large_for_sampling_warns_and_is_taken_where_that_is_asked_for(
        controller, capfd) -> None:
    live = controller(loop__unstable='warn')
    assert live.set({'k2': [12.0, 3.0]}).successful
    assert 'λ_max' not in capfd.readouterr().err
    assert live.set({'k2': [5000.0, 3000.0]}).successful
    log = capfd.readouterr().err
    assert '[WARN]' in log
    assert 'k2: λ_max(M⁻¹ k2) reaches' in log
    assert 'is unstable from 2000 1/s' in log
    assert not live.set({'k2': [9000.0], 'k1': [-1.0]}).successful
    assert 'λ_max' not in capfd.readouterr().err


def test_who_sets_a_k2_with_little_margin_is_told_with_the_success(controller) -> None:
    live = controller()
    assert live.set({'k2': [12.0, 3.0]}).reason == ''
    result = live.set({'k2': [4000.0, 8.0]})
    assert result.successful
    assert 'has little margin to 2000 1/s. k2 [' in result.reason
    assert live.set({'k2': [12.0, 3.0]}).reason == ''


def test_a_k2_too_large_for_the_stated_loop_is_refused_with_one_that_would_do(controller) -> None:
    live = controller(loop__delay=0.02)
    before = live.node.motion.settings.k2
    result = live.set({'k2': [500.0, 300.0]})
    assert not result.successful
    assert 'controller.k2' in result.reason
    assert '20.5 ms of delay at 1000 Hz' in result.reason
    assert 'would do (lower for joint' in result.reason
    np.testing.assert_array_equal(live.node.motion.settings.k2, before)


def test_an_estimate_limit_set_by_service_holds_for_the_next_estimate(controller) -> None:
    live = controller()
    theta = np.array(THETA) * 1.5
    message = JointState(name=list(TwoLinkArm().parameters), position=theta.tolist())
    assert live.set({'estimate_limit': [7.0]}).successful
    live.node.estimates.receive(serialize_message(message), {})
    assert live.drops == {'estimate beyond its limit': 1}
    assert live.set({'estimate_limit': [8.0]}).successful
    live.node.estimates.receive(serialize_message(message), {})
    np.testing.assert_array_equal(live.node.theta, theta)


def test_on_violation_set_by_service_acts_on_the_next_violation(controller, wait_until) -> None:
    live = controller(ramp_time=0.0)
    outside = live.node.motion.controller.reference.at(live.t + 1e-3).position + [0.2, 0.0]
    live.step(q=outside)
    assert live.node.active
    assert live.set({'on_violation': 'stop'}).successful
    live.step(q=outside)
    wait_until(lambda: not live.node.active, what='the deactivation')


def test_a_state_timeout_set_by_service_is_the_watchdogs(controller, wait_until) -> None:
    live = controller()
    assert live.set({'state_timeout': 0.05}).successful
    wait_until(lambda: live.node.faults.last == 'no joint state for 0.05 s: zero torque')


def test_a_guarantee_asked_for_while_running_is_stated_with_the_next_motion(
        controller, wait_until) -> None:
    live = controller()
    heard = live.peer.listen(JointState, f'/{GUARANTEE}')
    wait_until(lambda: live.node.count_subscribers(GUARANTEE))
    assert live.set({'guarantee.mode': 'bound', 'guarantee.theta_error': 0.5,
                     'guarantee.mass': [0.15, 5.0]}).successful
    live.step()
    assert not heard
    with live.node.between_samples:
        live.node.motion.lose('joint states lost')  # as the watchdog does
    live.step()
    wait_until(lambda: heard, what='the guarantee')
    message = deserialize_message(heard[0][0], JointState)
    output = live.node.output
    value = dict(zip(message.name, message.position))['V0']
    assert value == pytest.approx(barrier(output.e1, output.bound, np.ones(2))
                                  + 0.5 * 5.0 * output.e2 @ output.e2 + 0.5 * 0.5**2)


def _stamps(live: _Live) -> list[int]:
    return [message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
            for message in live.messages]


@pytest.fixture
def driver(graph, wait_until):
    """Return ``driver(**parameters)``: a running one with its arm released at rest."""
    def make(**parameters) -> _Live:
        live = _Live(graph, wait_until, 'arm_driver', **parameters)
        raw = live.peer.listen(JointState, f'/{JOINT_STATES}')
        commands = live.peer.create_publisher(Float64MultiArray, f'/{COMMANDS}', 10)
        wait_until(lambda: commands.get_subscription_count())
        live.messages = _Decoded(raw)
        live.send = lambda *torque: commands.publish(Float64MultiArray(data=list(torque)))
        return live

    return make


class _Decoded:
    """Joint states as another ROS program decodes them."""

    def __init__(self, raw) -> None:
        self._raw = raw

    def __len__(self) -> int:
        return len(self._raw)

    def __getitem__(self, index: int) -> JointState:
        return deserialize_message(self._raw[index][0], JointState)


def test_a_rate_set_by_service_is_that_of_the_stamps_from_the_next_state_on(
        driver, wait_until) -> None:
    live = driver(rate=100.0, command_timeout=60.0)
    live.send(2.0, -1.0)
    wait_until(lambda: len(live.messages) > 20 and live.node.started)
    assert live.set({'rate': 250.0}).successful
    count = len(live.messages)
    wait_until(lambda: len(live.messages) > count + 50)
    assert live.set({'rate': 20.0}).successful
    count = len(live.messages)
    wait_until(lambda: len(live.messages) > count + 5)
    steps = np.diff(_stamps(live))
    period = np.array([10_000_000, 4_000_000, 50_000_000])
    changes = [int(np.argmax(steps % 10_000_000 > 0)),
               len(steps) - 1 - int(np.argmax(steps[::-1] % 50_000_000 > 0)) + 1]
    for part, length in zip(np.split(steps, changes), period):
        assert (part > 0).all()
        assert (part % length == 0).all(), part
    assert (steps[changes[0]:changes[1]] == 4_000_000).sum() > 25
    moving = [message.effort for message in live.messages if np.isfinite(message.effort).all()]
    np.testing.assert_allclose(moving, np.tile([2.0, -1.0], (len(moving), 1)), rtol=1e-9)


def test_a_torque_limit_of_the_drives_acts_on_the_command_that_is_held(driver,
                                                                       wait_until) -> None:
    live = driver(rate=100.0, command_timeout=60.0)
    live.send(2.0, -1.0)
    wait_until(lambda: len(live.messages) and np.allclose(live.messages[-1].effort, (2.0, -1.0)))
    assert live.set({'torque_limit': [1.5, 0.25]}).successful
    wait_until(lambda: np.allclose(live.messages[-1].effort, (1.5, -0.25)))
    assert live.set({'torque_limit': [200.0]}).successful
    live.send(2.0, -1.0)
    wait_until(lambda: np.allclose(live.messages[-1].effort, (2.0, -1.0)))


def test_true_parameters_set_by_service_move_the_arm_from_then_on(driver, wait_until) -> None:
    live = driver(rate=100.0, command_timeout=60.0, true_model='given', true_parameters=THETA)
    live.send(2.0, -1.0)
    wait_until(lambda: len(live.messages) and np.allclose(live.messages[-1].effort, (2.0, -1.0)))
    heavy = [2.0 * x for x in THETA]
    assert live.set({'true_parameters': heavy}).successful
    count = len(live.messages) + 2
    wait_until(lambda: len(live.messages) > count + 2)
    before, after = live.messages[count], live.messages[count + 1]
    steps = round((_stamps(live)[count + 1] - _stamps(live)[count]) / 1e7)
    state = np.array(before.position), np.array(before.velocity)
    dynamics = TwoLinkArm().dynamics(np.array(heavy))
    for _ in range(steps):
        state = dynamics.advance(*state, np.array([2.0, -1.0]), 0.01, 1)
    np.testing.assert_allclose([after.position, after.velocity], state, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize(('values', 'words'), [
    ({'payload': 1.0}, ['arm_driver.payload', '1.0', 'no tip']),
    ({'true_parameters': THETA[:4]}, ['arm_driver.true_parameters', '5 values']),
    ({'schedule.time': [1.0, 2.0]}, ['schedule', 'same length']),
    ({'schedule.parameter': ['p9']}, ['schedule.parameter', "'p9'", 'p1']),
    ({'torque_limit': [1.0, 2.0, 3.0]}, ['torque_limit', 'length 1 or 2']),
    ({'rate': 1e6}, ['rate', '10000']),
    ({'substeps': 0}, ['substeps', '1']),
])
def test_a_driver_that_refuses_goes_on_as_it_was(driver, wait_until, values, words) -> None:
    live = driver(rate=100.0, command_timeout=60.0, true_model='given', true_parameters=THETA)
    live.send(2.0, -1.0)
    wait_until(lambda: live.node.started)
    node, before = live.node, live.node.settings.values()
    in_use = (node.plant.epochs, node.plant.torque_limit, node.plant.sensor,
              node.grid.period_ns)
    result = live.set({'dead_time': 5, **values})
    assert not result.successful
    for word in words:
        assert word in result.reason, result.reason
    assert node.settings.values() == before
    assert in_use == (node.plant.epochs, node.plant.torque_limit, node.plant.sensor,
                      node.grid.period_ns)
    assert node.plant.settings.dead_time == 0
    np.testing.assert_array_equal(node.plant.torque, [2.0, -1.0])


def test_a_duration_set_by_service_ends_the_run(driver, wait_until) -> None:
    live = driver(rate=100.0, command_timeout=60.0)
    live.send(0.0, 0.0)
    wait_until(lambda: live.node.started)
    assert live.set({'duration': 0.05}).successful
    assert live.runner.join() == 0


def test_damping_set_by_service_is_what_the_drives_do_without_commands(driver,
                                                                       wait_until) -> None:
    live = driver(rate=100.0, initial_velocity=[1.0, -1.0])
    live.send(0.0, 0.0)
    wait_until(lambda: live.node.drives.timed_out)
    assert live.set({'timeout_action': 'damping', 'damping': [0.5, 0.25]}).successful
    wait_until(lambda: np.any(live.messages[-1].effort))
    count = len(live.messages)
    wait_until(lambda: len(live.messages) > count + 1)
    np.testing.assert_allclose(live.messages[count + 1].effort, np.array([-0.5, -0.25]) * np.array(
        live.messages[count].velocity), rtol=1e-9)


def test_an_action_that_changes_while_commands_are_missing_is_taken_at_once(
        driver, wait_until) -> None:
    live = driver(rate=100.0, initial_velocity=[1.0, -1.0], timeout_action='damping')
    live.send(0.0, 0.0)
    wait_until(lambda: live.node.drives.timed_out, what='damping')
    for action in ('zero', 'damping'):
        assert live.set({'timeout_action': action}).successful
        count = len(live.messages) + 2
        wait_until(lambda count=count: len(live.messages) > count + 3)
        effort = live.messages[count].effort
        assert np.isfinite(effort).all()
        assert np.any(effort) == (action == 'damping')


def test_an_identifier_goes_on_learning_through_changes_and_refusals(
        graph, wait_until) -> None:
    asked, other = (_Live(graph, wait_until, 'identifier', namespace, estimate_period=0.0)
                    for namespace in ('/asked', '/other'))
    random = np.random.default_rng(4)

    def both(count: int) -> None:
        for _ in range(count):
            q, qd = random.normal(size=(2, 2))
            asked.step(q=q, qd=qd)
            other.step(q=q, qd=qd)

    both(30)
    identifier, settings = asked.node.identifier, asked.node.identifier.settings
    count = identifier.stack.count
    for refused in ({'gamma': [1.0, 2.0]}, {'history.size': 0}, {'filter.state_order': 9},
                    {'update_law': 'newton'}, {'filter.time_constant': 0.0}):
        result = asked.set({'kt': 99.0, 'history.size': 3, **refused})
        assert not result.successful
        assert identifier.settings is settings
        assert asked.node.settings.values()['kt'] == 10.0
    both(5)
    assert count > 3
    np.testing.assert_array_equal(identifier.theta, other.node.identifier.theta)
    theta, before = identifier.theta, identifier.stack.count
    assert asked.set({'gamma': [0.5], 'kt': 1.0}).successful
    assert (identifier.theta is theta, identifier.stack.count) == (True, before)
    both(1)
    assert (identifier.theta != other.node.identifier.theta).any()
    assert asked.set({'history.size': 3}).successful
    both(25)
    assert identifier.stack.count <= 3 < other.node.identifier.stack.count


def test_the_estimate_file_is_written_as_often_as_asked_while_running(
        graph, wait_until, tmp_path) -> None:
    live = _Live(graph, wait_until, 'identifier', estimate_file=str(tmp_path / 'a.yaml'),
                 estimate_period=0.0)
    heard = live.peer.listen(JointState, f'/{THETA_HAT}')
    live.step()
    live.step()
    wait_until(lambda: heard)
    assert not list(tmp_path.iterdir())
    refused = live.set({'estimate_file': str(tmp_path / 'b.yaml'), 'estimate_period': 0.05})
    assert 'read-only' in refused.reason
    assert live.set({'estimate_period': 0.05}).successful
    wait_until(lambda: (tmp_path / 'a.yaml').exists(), what='the file')
    assert not (tmp_path / 'b.yaml').exists()
