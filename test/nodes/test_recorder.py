# SPDX-License-Identifier: Apache-2.0
"""The recorder loses nothing: bit for bit, read back by two other libraries, whatever ends it."""

from __future__ import annotations

from collections.abc import Callable
import os
from pathlib import Path
import signal
import subprocess
import sys
import threading
import time

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import InertiaStamped, PointStamped
import numpy as np
import pytest
from rcl_interfaces.msg import ParameterEvent, SetParametersResult
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Float64MultiArray, Int32, String
from visualization_msgs.msg import MarkerArray
import yaml

from adaptive_blf_control.bags.reader import read_bag
from adaptive_blf_control.bench.soak_figures import account_of
from adaptive_blf_control.configuration.parameter_file import node_values, PARAMETERS_KEY
from adaptive_blf_control.errors import BagError
from adaptive_blf_control.messages.cdr import encode_int32
from adaptive_blf_control.messages.topics import (
    HISTORY_RANK,
    JOINT_TRAJECTORY,
    OBSTACLES,
    RECORDED,
    TOPICS,
)
from adaptive_blf_control.nodes.arm_driver import ArmDriver
from adaptive_blf_control.nodes.controller import ControllerNode
from adaptive_blf_control.nodes.identifier import IdentifierNode
from adaptive_blf_control.nodes.recorder import Recorder
from adaptive_blf_control.runtime import data_node
from patience import PATIENCE

TYPES = {'sensor_msgs/msg/JointState': JointState, 'std_msgs/msg/Int32': Int32,
         'std_msgs/msg/Float64': Float64, 'std_msgs/msg/Float64MultiArray': Float64MultiArray,
         'diagnostic_msgs/msg/DiagnosticArray': DiagnosticArray, 'std_msgs/msg/String': String,
         'geometry_msgs/msg/InertiaStamped': InertiaStamped,
         'visualization_msgs/msg/MarkerArray': MarkerArray}
EVENTS = '/parameter_events'


def _metadata(bag: Path) -> dict:
    return yaml.safe_load((bag / 'metadata.yaml').read_text())['rosbag2_bagfile_information']


def _durability(topic: str) -> DurabilityPolicy:
    return (DurabilityPolicy.TRANSIENT_LOCAL if TOPICS[topic].latched
            else DurabilityPolicy.VOLATILE)


def _numbers(bag: Path, topic: str = '/number') -> list[int]:
    return [int.from_bytes(message.data[4:], 'little') for message in read_bag(bag).messages(
        [topic])]


@pytest.fixture
def recorded(graph, wait_until, tmp_path):
    """Run all four nodes at 100 Hz; return bag, what a bystander heard, nodes, type hashes."""
    common = {'joints': ['shoulder', 'elbow'], 'initial_estimate': [1.0]}
    nodes = {
        'recorder': graph.make(Recorder, bag=str(tmp_path / 'run')),
        'identifier': graph.make(IdentifierNode, **common),
        'controller': graph.make(ControllerNode, **common, k2=[20.0, 2.0]),
        'arm_driver': graph.make(ArmDriver, joints=common['joints'], rate=100.0,
                                 wait_for_subscribers=4, initial_position=[0.01, 0.02])}
    peer = graph.peer()
    heard = {topic if topic[0] == '/' else f'/{topic}': peer.listen(
        TYPES[kind], topic, QoSProfile(depth=5000, durability=_durability(topic)))
        for topic, kind in RECORDED.items()
        # Sent by planners and cameras; and before anyone hears.
        if topic not in (JOINT_TRAJECTORY, OBSTACLES, EVENTS)}
    wait_until(lambda: all(peer.count_subscribers(topic) >= 2 for topic in heard)
               and len(peer.get_publishers_info_by_topic('/diagnostics')) == 4)
    runners = {name: graph.run(node) for name, node in nodes.items()}
    wait_until(lambda: len(heard['/joint_states']) >= 400 and len(heard['/diagnostics']) >= 16,
               what='a run of four seconds, of a machine that holds the rate')
    assert runners['arm_driver'].end() == 0
    # Now, because the commands have a publisher only once the controller is active.
    hashes = {topic: str(peer.get_publishers_info_by_topic(topic)[0].topic_type_hash)
              for topic in (*heard, EVENTS)}
    wait_until(lambda: len(nodes['recorder'].output.nodes) == 4, what="the nodes' parameters")
    wait_until(lambda: not {f'/{name}' for name in nodes}.intersection(
        nodes['recorder'].survey.clients), what='the end of its clients')
    for name in ('controller', 'identifier'):
        assert runners[name].end() == 0
    assert runners['recorder'].end() == 0
    return tmp_path / 'run', heard, nodes, hashes


def test_a_run_is_in_the_bag_bit_for_bit_and_others_can_read_it(recorded) -> None:
    bag, heard, nodes, hashes = recorded
    _check_bytes(bag, heard)
    _check_with_rosbags(bag, heard)
    _check_with_mcap(bag, heard, hashes)
    _check_metadata(bag, heard, hashes)
    _check_parameters(bag, nodes)


# Sent when asked for, or every few seconds once there is something to say.
SILENT = ('/controller/guarantee', '/controller/reserve', '/identifier/parameter_set',
          '/identifier/consistent_model', '/identifier/theta_std',
          '/identifier/payload', '/identifier/payload_std')


def _check_bytes(bag: Path, heard) -> None:
    ours = read_bag(bag)
    assert ours.complete, ours.problem
    for topic, messages in heard.items():
        data = [message.data for message in ours.messages([topic])]
        if topic == '/diagnostics':  # several publishers, and some after the recorder's end
            assert len(data) >= 4
            assert set(data) <= {raw for raw, _ in messages}
        else:
            assert data == [raw for raw, _ in messages], topic
            assert data or topic in SILENT
    assert ours.topics['/joint_states'].count >= 100


def _check_with_rosbags(bag: Path, heard) -> None:
    rosbags = pytest.importorskip('rosbags.highlevel')
    from rosbags.typesys import get_typestore, Stores
    with rosbags.AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        found: dict[str, list] = {topic: [] for topic in heard}
        for connection, _, raw in reader.messages():
            found.setdefault(connection.topic, []).append(
                (raw, reader.deserialize(raw, connection.msgtype)))
    for topic, messages in heard.items():
        if topic == '/diagnostics':
            continue
        assert [raw for raw, _ in found[topic]] == [raw for raw, _ in messages]
    for raw, message in found['/joint_states']:
        expected = deserialize_message(raw, JointState)
        assert message.name == expected.name == ['shoulder', 'elbow']
        np.testing.assert_array_equal(message.position, expected.position)
        np.testing.assert_array_equal(message.effort, expected.effort)


def _check_with_mcap(bag: Path, heard, hashes) -> None:
    mcap_reader = pytest.importorskip('mcap.reader')
    mcap_ros2 = pytest.importorskip('mcap_ros2.reader')
    file = bag / 'run_0.mcap'
    with file.open('rb') as stream:
        reader = mcap_reader.make_reader(stream)
        assert reader.get_header().profile == 'ros2'
        raw: dict[str, list] = {topic: [] for topic in heard}
        for _, channel, message in reader.iter_messages(log_time_order=False):
            raw.setdefault(channel.topic, []).append((message.data, message.publish_time))
        summary = reader.get_summary()
    for topic, messages in heard.items():
        if topic != '/diagnostics':
            assert raw[topic] == [(data, info['source_timestamp']) for data, info in messages]
    qos = {item['topic_metadata']['name']: item['topic_metadata']['offered_qos_profiles']
           for item in _metadata(bag)['topics_with_message_count']}
    for channel in summary.channels.values():
        assert channel.metadata['topic_type_hash'] == hashes[channel.topic]
        assert yaml.safe_load(channel.metadata['offered_qos_profiles']) == qos[channel.topic]
    count = 0
    for decoded in mcap_ros2.read_ros2_messages(str(file), topics=['/controller/barrier']):
        expected = deserialize_message(heard['/controller/barrier'][count][0], JointState)
        assert list(decoded.ros_msg.name) == list(expected.name)
        np.testing.assert_array_equal(decoded.ros_msg.position, expected.position)
        count += 1
    assert count == len(heard['/controller/barrier'])


def _check_metadata(bag: Path, heard, hashes) -> None:
    metadata = _metadata(bag)
    assert metadata['version'] == 9
    topics = {item['topic_metadata']['name']: item
              for item in metadata['topics_with_message_count']}
    assert set(topics) - {EVENTS} == {topic for topic, messages in heard.items() if messages}
    for topic, item in topics.items():
        assert item['topic_metadata']['type_description_hash'] == hashes[topic]
        name = topic if topic in RECORDED else topic[1:]
        assert item['topic_metadata']['type'] == RECORDED[name]
        (profile,) = item['topic_metadata']['offered_qos_profiles']
        durability = 'transient_local' if TOPICS[name].latched else 'volatile'
        assert (profile['reliability'], profile['durability']) == ('reliable', durability)
    assert metadata['message_count'] == sum(item['message_count'] for item in topics.values())


def _check_parameters(bag: Path, nodes) -> None:
    data = yaml.safe_load(read_bag(bag).custom_data[PARAMETERS_KEY])
    assert set(data) == {f'/{name}' for name in nodes}
    for name, node in nodes.items():
        assert node_values(data, name) == node.settings.values()


def _set(peer, node: str, **values: float) -> SetParametersResult:
    """Set parameters of a node in one request, as rqt does."""
    request = SetParametersAtomically.Request(parameters=[
        Parameter(name, value=value).to_parameter_msg() for name, value in values.items()])
    return peer.call(SetParametersAtomically, f'{node}/set_parameters_atomically', request).result


def test_a_live_change_is_in_the_bag_with_its_time_and_new_value(
        graph, wait_until, tmp_path) -> None:
    recorder = graph.make(Recorder, bag=str(tmp_path / 'bag'), topics=[EVENTS])
    runner = graph.run(recorder)
    wait_until(lambda: recorder.count_publishers(EVENTS) == 1, what="the recorder's own events")
    graph.run(graph.make(IdentifierNode))
    peer = graph.peer()
    wait_until(lambda: recorder.count_publishers(EVENTS) == 3, what='all three')
    before = recorder.received[EVENTS]
    began = time.time_ns()
    assert not _set(peer, '/identifier', kt=41.0, kh=-1.0).successful
    assert _set(peer, '/identifier', kt=42.0, gamma=[2.0]).successful
    ended = time.time_ns()
    wait_until(lambda: recorder.received[EVENTS] > before, what='the event')
    assert runner.end() == 0
    changes = [(event, message.log_time_ns) for message in read_bag(tmp_path / 'bag')
               for event in [deserialize_message(message.data, ParameterEvent)]
               if event.node == '/identifier' and event.changed_parameters]
    ((event, at),) = changes  # what was refused is no event
    assert {item.name: parameter_value_to_python(item.value)
            for item in event.changed_parameters} == {'kt': 42.0, 'gamma': [2.0]}
    assert began <= at <= ended + 10**9
    assert recorder.lost[EVENTS] == 0  # publishers that number on their own are no gap


def test_who_never_answers_is_asked_no_longer_than_it_is_there_and_who_is_hidden_never(
        graph, wait_until, tmp_path) -> None:
    recorder = graph.make(Recorder, bag=str(tmp_path / 'bag'), topics=[EVENTS])
    graph.run(recorder)
    # As a command line makes it, and a node that starts; and one that is busy.
    others = [Node(name, context=graph.context, start_parameter_services=False)
              for name in ('_hidden', 'mute')]
    asked = recorder.survey.clients
    wait_until(lambda: '/mute' in asked, what='clients for it')
    assert set(asked) == {'/mute'}
    for other in others:
        other.destroy_node()
    wait_until(lambda: not asked, what='the end of its clients')


def test_an_existing_folder_is_refused_and_left_alone(graph, tmp_path) -> None:
    (tmp_path / 'notes.txt').write_text('mine')
    with pytest.raises(BagError, match='exists already'):
        graph.make(Recorder, bag=str(tmp_path))
    assert [path.name for path in tmp_path.iterdir()] == ['notes.txt']


class _Stream:
    """Publishes 0, 1, 2, ... on ``number`` about every millisecond, and when."""

    def __init__(self, peer) -> None:
        self._publisher = peer.create_publisher(Int32, 'number', 5000)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self.times: list[float] = []
        self.matched: Callable[[], bool] = lambda: (
            self._publisher.get_subscription_count() == 1)

    def _run(self) -> None:
        while not self._stop.wait(0.001):
            self._publisher.publish(Int32(data=len(self.times)))
            self.times.append(time.monotonic())

    def start(self) -> None:
        self._thread.start()

    def end(self) -> None:
        self._stop.set()
        self._thread.join()


@pytest.fixture
def recorder_process(processes, graph_of, wait_until, tmp_path):
    """Return a recorder process of ``number``, the stream it hears, and its bag."""
    process = processes.start('recorder', '--ros-args', '-p', f'bag:={tmp_path / "bag"}', '-p',
                              'topics:=[number]')
    stream = _Stream(graph_of(processes.domain).peer())
    wait_until(stream.matched, what='the match')
    stream.start()
    yield process, stream, tmp_path / 'bag'
    stream.end()


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_drains_and_closes(recorder_process, wait_until, number) -> None:
    process, stream, bag = recorder_process
    wait_until(lambda: len(stream.times) > 300)
    sent = len(stream.times)
    assert process.signal(number) == 0
    numbers = _numbers(bag)
    assert read_bag(bag).complete
    assert numbers == list(range(len(numbers)))
    assert len(numbers) >= sent - 20  # those on their way when the signal came
    count = len(numbers)
    assert f'/number: received {count}, written {count}, lost 0' in process.text
    assert 'Traceback' not in process.text
    assert _metadata(bag)['message_count'] == count


def test_kill_9_costs_at_most_the_last_second(recorder_process, wait_until) -> None:
    process, stream, bag = recorder_process
    wait_until(lambda: len(stream.times) and stream.times[-1] - stream.times[0] > 1.5)
    killed_at = time.monotonic()
    assert process.signal(signal.SIGKILL) == -signal.SIGKILL
    stream.end()
    numbers = _numbers(bag)
    assert numbers == list(range(len(numbers)))
    assert numbers[-1] >= max(i for i, t in enumerate(stream.times) if t < killed_at - 1.0)
    opened = read_bag(bag)
    assert not opened.complete
    assert 'truncated' in opened.problem


def test_a_full_disk_ends_the_recording_with_what_was_written(processes, graph_of, wait_until,
                                                             tmp_path) -> None:
    bag = tmp_path / 'bag'
    process = processes.start('recorder', '--ros-args', '-p', f'bag:={bag}', '-p',
                              'topics:=[number]', '-p', 'flush_period:=0.05', largest_file=30_000)
    stream = _Stream(graph_of(processes.domain).peer())
    wait_until(stream.matched)
    stream.start()
    wait_until(lambda: 'recording stopped' in process.text)
    sent = len(stream.times)
    wait_until(lambda: len(stream.times) > sent + 100)  # which reach the recorder
    assert process.signal(signal.SIGINT) == 1
    stream.end()
    assert 'what was written is kept' in process.text
    assert 'Traceback' not in process.text
    numbers = _numbers(bag)
    assert len(numbers) > 100
    assert numbers == list(range(len(numbers)))
    account, = account_of(process.text, {'/number': len(numbers)})
    assert account.dropped > 0
    assert account.complete  # written is what is in the file, received that and the dropped
    assert _metadata(bag)['message_count'] == len(numbers)


@pytest.mark.parametrize('executor', ['direct', 'plain'])
def test_all_that_has_piled_up_is_taken_before_the_bag_is_closed(
        graph, wait_until, tmp_path, monkeypatch, executor) -> None:
    monkeypatch.setattr(data_node, 'DRAIN_TIMEOUT', PATIENCE)  # a busy machine needs more than 5 s
    recorder = graph.make(Recorder, bag=str(tmp_path / 'bag'), topics=[HISTORY_RANK],
                          executor=executor)
    publisher = graph.peer().create_publisher(Int32, HISTORY_RANK, 5000)
    wait_until(lambda: publisher.get_subscription_count() == 1, what='the match')
    for number in range(2500):  # more than is taken at a time
        publisher.publish(Int32(data=number))
    assert publisher.wait_for_all_acked(Duration(seconds=20.0))
    recorder.finish()
    assert _numbers(tmp_path / 'bag', f'/{HISTORY_RANK}') == list(range(2500))


def test_a_topic_whose_type_is_known_only_later_is_recorded(graph, wait_until, tmp_path) -> None:
    recorder = graph.make(Recorder, bag=str(tmp_path / 'bag'), topics=['point', 'number'])
    runner = graph.run(recorder)
    assert recorder.count_subscribers('/point') == 0
    peer = graph.peer()
    heard = peer.listen(PointStamped, 'point')
    publisher = peer.create_publisher(PointStamped, 'point', 10)
    wait_until(lambda: publisher.get_subscription_count() == 2, what='the recorder')
    message = PointStamped()
    for x in range(3):
        message.point.x, message.header.frame_id = float(x), 'base'
        publisher.publish(message)
    wait_until(lambda: recorder.received.get('/point') == 3 and len(heard) == 3)
    assert runner.end() == 0
    bag = read_bag(tmp_path / 'bag')
    assert bag.topics['/point'].type_name == 'geometry_msgs/msg/PointStamped'
    assert [message.data for message in bag] == [data for data, _ in heard]


def test_a_topic_without_a_definition_is_refused_and_the_others_go_on(
        graph, wait_until, tmp_path, monkeypatch, capfd) -> None:
    monkeypatch.setattr(sys, 'prefix', str(tmp_path))  # where the wheels' .msg files would be
    monkeypatch.delenv('AMENT_PREFIX_PATH', raising=False)
    recorder = graph.make(Recorder, bag=str(tmp_path / 'bag'), topics=['point', 'number'])
    peer = graph.peer()
    peer.create_publisher(PointStamped, 'point', 10)
    numbers = peer.create_publisher(Int32, 'number', 10)
    runner = graph.run(recorder)
    wait_until(lambda: numbers.get_subscription_count() == 1 and not recorder.unknown)
    numbers.publish(Int32(data=7))
    wait_until(lambda: recorder.received['/number'] == 1)
    assert runner.end() == 0
    assert '/point' not in recorder.received
    assert _numbers(tmp_path / 'bag') == [7]
    assert "/point: message type 'geometry_msgs/msg/PointStamped'" in capfd.readouterr().err


def test_a_best_effort_publisher_that_comes_later_is_heard(graph, wait_until, tmp_path) -> None:
    recorder = graph.make(Recorder, bag=str(tmp_path / 'bag'), topics=['joint_states'])
    runner = graph.run(recorder)
    sensor_data = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)
    publisher = graph.peer().create_publisher(JointState, 'joint_states', sensor_data)
    wait_until(lambda: publisher.get_subscription_count() == 1, what='the match')
    publisher.publish(JointState(name=['a'], position=[1.0]))
    wait_until(lambda: recorder.received['/joint_states'] == 1)
    assert runner.end() == 0
    (item,) = _metadata(tmp_path / 'bag')['topics_with_message_count']
    assert item['topic_metadata']['offered_qos_profiles'][0]['reliability'] == 'best_effort'
    assert item['message_count'] == 1


def test_a_latched_message_from_before_is_recorded(graph, wait_until, tmp_path) -> None:
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    publisher = graph.peer().create_publisher(String, 'robot_description', latched)
    publisher.publish(String(data='<robot/>'))
    recorder = graph.make(Recorder, bag=str(tmp_path / 'bag'), topics=['robot_description'])
    runner = graph.run(recorder)
    wait_until(lambda: recorder.received.get('/robot_description') == 1)
    assert runner.end() == 0
    (message,) = read_bag(tmp_path / 'bag')
    assert deserialize_message(message.data, String).data == '<robot/>'
    (item,) = _metadata(tmp_path / 'bag')['topics_with_message_count']
    assert item['topic_metadata']['offered_qos_profiles'][0]['durability'] == 'transient_local'


def test_topics_are_those_of_the_namespace(graph, wait_until, tmp_path) -> None:
    recorder = graph.make(Recorder, namespace='/left', bag=str(tmp_path / 'bag'))
    runner = graph.run(recorder)
    publisher = graph.peer().create_publisher(Int32, '/left/identifier/history_rank', 10)
    wait_until(lambda: publisher.get_subscription_count() == 1)
    publisher.publish(Int32(data=5))
    wait_until(lambda: recorder.received['/left/identifier/history_rank'] == 1)
    runner.end()
    assert _numbers(tmp_path / 'bag', '/left/identifier/history_rank') == [5]


def test_gaps_in_a_publishers_sequence_are_counted_as_lost(graph, tmp_path) -> None:
    recorder = graph.make(Recorder, bag=str(tmp_path / 'bag'), topics=['number'])
    recorder.received['/number'] = recorder.lost['/number'] = 0
    for number in (3, 4, 7, 8, 1, 2):  # two lost, then the publisher starts again
        recorder.record('/number', 'std_msgs/msg/Int32', encode_int32(number), {
            'received_timestamp': 10**9 + number, 'source_timestamp': 10**9,
            'publication_sequence_number': number})
    recorder.finish()
    assert (recorder.received, recorder.lost) == ({'/number': 6}, {'/number': 2})
    assert _numbers(tmp_path / 'bag') == [3, 4, 7, 8, 1, 2]


def test_a_chunk_reaches_the_disk_every_flush_period(graph, wait_until, tmp_path) -> None:
    recorder = graph.make(Recorder, bag=str(tmp_path / 'bag'), topics=['number'],
                          flush_period=0.1)
    graph.run(recorder)
    publisher = graph.peer().create_publisher(Int32, 'number', 10)
    wait_until(lambda: publisher.get_subscription_count() == 1)
    for number in range(3):
        publisher.publish(Int32(data=number))
        wait_until(lambda number=number: _numbers_so_far(tmp_path / 'bag') == list(
            range(number + 1)), 'the message on the disk')


def _numbers_so_far(bag: Path) -> list[int]:
    try:
        return _numbers(bag)
    except BagError:  # nothing there yet
        return []


def test_the_status_has_the_counts_of_every_topic(graph, wait_until, tmp_path) -> None:
    recorder = graph.make(Recorder, bag=str(tmp_path / 'bag'), topics=['number'])
    publisher = graph.peer().create_publisher(Int32, 'number', 10)
    runner = graph.run(recorder)
    wait_until(lambda: publisher.get_subscription_count() == 1)
    publisher.publish(Int32(data=1))
    wait_until(lambda: recorder.status()[2].get('/number written') == 1)
    assert recorder.status()[2] == {'/number received': 1, '/number written': 1,
                                    '/number lost': 0}
    runner.end()
    assert not os.path.exists(tmp_path / 'bag' / 'metadata.yaml.tmp')


def test_what_has_arrived_but_was_not_taken_yet_is_in_the_bag(graph, wait_until, tmp_path) -> None:
    recorder = graph.make(Recorder, bag=str(tmp_path / 'bag'), topics=['identifier/history_rank'])
    peer = graph.peer()
    echo = peer.listen(Int32, 'identifier/history_rank')
    publisher = peer.create_publisher(Int32, 'identifier/history_rank', 100)
    wait_until(lambda: publisher.get_subscription_count() == 2)
    for number in range(50):
        publisher.publish(Int32(data=number))
    assert publisher.wait_for_all_acked(Duration(seconds=20.0))
    wait_until(lambda: len(echo) == 50)
    recorder.finish()  # as a signal would, with the loop not run once
    assert _numbers(tmp_path / 'bag', '/identifier/history_rank') == list(range(50))


def test_the_recorder_loads_no_laws() -> None:
    code = ('import sys, adaptive_blf_control.nodes.recorder; print(sorted({"numba", "scipy", '
            '"adaptive_blf_control.compiled"} & set(sys.modules)))')
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True,
                          timeout=PATIENCE)
    assert done.stdout.strip() == '[]'
