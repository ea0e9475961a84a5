# SPDX-License-Identifier: Apache-2.0
"""A bag that is played comes out as it went in: bytes, order, times, QoS and clock."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
import re
import signal
import threading

import numpy as np
import pytest
from rclpy.qos import (
    DurabilityPolicy,
    QoSProfile,
    ReliabilityPolicy,
)
from rclpy.serialization import deserialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Int32

from adaptive_blf_control.bags.metadata import default_qos
from adaptive_blf_control.bags.reader import Bag, read_bag
from adaptive_blf_control.bags.writer import BagWriter
from adaptive_blf_control.errors import BagError, ParameterError
from adaptive_blf_control.messages.cdr import (
    encode_float64,
    encode_int32,
    Float64MultiArrayCodec,
    JointStateCodec,
)
from adaptive_blf_control.messages.topics import RECORDED
from adaptive_blf_control.nodes.play_qos import qos_of
from adaptive_blf_control.nodes.play_settings import PlaySettings
from adaptive_blf_control.nodes.player import Player
from adaptive_blf_control.nodes.recorder import Recorder
from patience import PATIENCE

START = 1_700_000_000_500_000_000
STEP = 1_000_000  # ns
COUNT = 500
PLAYED = ('joint_states', 'effort_controller/commands', 'identifier/theta_hat',
          'identifier/history_rank', 'identifier/history_sigma_min')


def _write(folder: Path, count: int = COUNT, **qos: list) -> Path:
    """Write a bag of our topics with values of every kind, one millisecond a sample."""
    rng = np.random.default_rng(5)
    joints, theta = JointStateCodec(['j1', 'joint_2']), JointStateCodec(['θ1'], 'arm',
                                                                        ['position'])
    with BagWriter(folder) as writer:
        for name in PLAYED:
            writer.add_topic(f'/{name}', RECORDED[name], qos=qos.get(name))
        for i in range(count):
            values = rng.normal(size=(3, 2)) * 10.0 ** rng.integers(-300, 300)
            if i % 7 == 0:
                values[2] = np.nan
            now = START + i * STEP
            for name, data in zip(PLAYED, (
                    joints.encode(now, *values), Float64MultiArrayCodec(i % 3).encode(
                        values[0][:i % 3]), theta.encode(now, values[0][:1]),
                    encode_int32(-i), encode_float64(values[1][0]))):
                writer.write(f'/{name}', data, now)
    return folder


def _payloads(bag: Bag) -> dict[str, list[bytes]]:
    found: dict[str, list[bytes]] = {}
    for message in bag:
        found.setdefault(message.topic, []).append(message.data)
    return found


def _play(graph, path: Path, **settings) -> Player:
    player = graph_player(graph, path, **settings)
    assert player.wait_for_subscribers() == []
    player.play()
    return player


def _play_unheard(graph, path: Path) -> Player:
    player = graph_player(graph, path, wait=0.0, clock=0.0)
    player.play()
    return player


def graph_player(graph, path: Path, **settings) -> Player:
    player = Player(str(path), PlaySettings(**settings), context=graph.context)
    graph.add(player.node)
    return player


def test_a_played_bag_recorded_again_has_the_same_bytes_on_every_topic(
        graph, wait_until: Callable, tmp_path: Path) -> None:
    bag = _write(tmp_path / 'first')
    recorder = graph.make(Recorder, bag=str(tmp_path / 'again'), topics=list(PLAYED))
    runner = graph.run(recorder)
    player = _play(graph, bag, rate=2.0, clock=0.0, wait=20.0)
    assert player.sent == {f'/{name}': COUNT for name in PLAYED}
    wait_until(lambda: sum(recorder.received.values()) == len(PLAYED) * COUNT,
               what='the last message')
    assert runner.end() == 0
    assert _payloads(read_bag(tmp_path / 'again')) == _payloads(read_bag(bag))


def test_clock_leads_the_messages_and_covers_the_bag(
        graph, wait_until: Callable, tmp_path: Path) -> None:
    bag = _write(tmp_path / 'bag', 101)
    peer = graph.peer()
    order: list[tuple[str, int]] = []

    def on_clock(message: Clock) -> None:
        order.append(('clock', message.clock.sec * 10**9 + message.clock.nanosec))

    def on_state(data: bytes) -> None:
        stamp = deserialize_message(data, JointState).header.stamp
        order.append(('state', stamp.sec * 10**9 + stamp.nanosec))

    peer.create_subscription(Clock, '/clock', on_clock, 1000)
    peer.create_subscription(JointState, '/joint_states', on_state, 1000, raw=True)
    player = graph_player(graph, bag, clock=50.0, topics=('joint_states',), rate=0.5, wait=20.0)
    wait_until(lambda: player.node.count_subscribers('/clock') == 1, what='the match')
    player.wait_for_subscribers()
    player.play()
    wait_until(lambda: len(order) == 101 + 6, what='the last message')
    ticks = [time for kind, time in order if kind == 'clock']
    assert ticks == [START + 20 * STEP * i for i in range(6)]
    assert player.clock.ticks == 6
    states = [time for kind, time in order if kind == 'state']
    assert states == sorted(states)
    assert len(states) == 101


def test_messages_keep_their_distances_divided_by_the_rate(
        graph, wait_until: Callable, tmp_path: Path) -> None:
    bag = _write(tmp_path / 'bag', 201)
    heard = graph.peer().listen(JointState, '/joint_states')
    player = _play(graph, bag, rate=0.5, topics=('/joint_states',), wait=20.0, clock=0.0)
    assert player.sent == {'/joint_states': 201}
    wait_until(lambda: len(heard) == 201, what='the last message')
    sent = np.array([info['source_timestamp'] for _, info in heard])
    # The middle half of the distances: a busy machine delays some messages, but never all.
    assert np.percentile(np.diff(sent[::10]), [25, 75]) == pytest.approx(
        [20 * STEP, 20 * STEP], rel=0.2)


def test_messages_are_sent_in_the_order_of_their_times_not_of_the_file(
        graph, wait_until: Callable, tmp_path: Path) -> None:
    topics = ('/identifier/history_rank', '/identifier/history_sigma_min')
    with BagWriter(tmp_path / 'bag') as writer:
        for topic in topics:
            writer.add_topic(topic, RECORDED[topic[1:]])
        for i in range(200):
            writer.write(topics[0], encode_int32(i), START + i * STEP)
        for i in range(200):
            writer.write(topics[1], encode_float64(i), START + i * STEP + STEP // 2)
    peer = graph.peer()
    heard = [peer.listen(kind, topic) for kind, topic in zip((Int32, Float64), topics)]
    _play(graph, tmp_path / 'bag', rate=0.5, wait=20.0, clock=0.0)
    wait_until(lambda: [len(messages) for messages in heard] == [200, 200], what='the last ones')
    first, second = (np.array([info['source_timestamp'] for _, info in messages])
                     for messages in heard)
    assert (first < second).all()
    assert (second[:-1] < first[1:]).all()


@pytest.mark.parametrize(('reliability', 'durability'), [
    ('reliable', 'volatile'), ('best_effort', 'volatile'), ('reliable', 'transient_local')])
def test_qos_is_offered_as_it_was_recorded(
        graph, tmp_path: Path, reliability: str, durability: str) -> None:
    bag = _write(tmp_path / 'bag', 1, joint_states=default_qos(reliability, durability))
    player = graph_player(graph, bag, topics=('joint_states',))
    offered = player.node.get_publishers_info_by_topic('/joint_states')[0].qos_profile
    assert offered.reliability == ReliabilityPolicy[reliability.upper()]
    assert offered.durability == DurabilityPolicy[durability.upper()]


def test_publishers_that_differed_are_played_with_the_strongest_offer() -> None:
    mixed = [*default_qos('best_effort'), *default_qos('reliable', 'transient_local')]
    assert qos_of(mixed).reliability == ReliabilityPolicy.RELIABLE
    assert qos_of(mixed).durability == DurabilityPolicy.TRANSIENT_LOCAL
    profile = {**default_qos()[0], 'deadline': {'sec': 1, 'nsec': 5}}
    assert qos_of([profile]).deadline.nanoseconds == 1_000_000_005
    assert qos_of([]).depth == qos_of(default_qos()).depth == 1000


def test_a_latched_message_reaches_who_comes_later(
        graph, wait_until: Callable, tmp_path: Path) -> None:
    bag = _write(tmp_path / 'bag', 1, joint_states=default_qos('reliable', 'transient_local'))
    player = graph_player(graph, bag, topics=('joint_states',), wait=0.0, clock=0.0)
    assert player.wait_for_subscribers() == ['/joint_states']
    player.play()
    heard = graph.peer().listen(JointState, '/joint_states', QoSProfile(
        depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL))
    wait_until(lambda: heard, what='the latched message')


def test_loop_begins_again_until_it_is_stopped(
        graph, wait_until: Callable, tmp_path: Path) -> None:
    player = graph_player(graph, _write(tmp_path / 'bag', 3), loop=True, wait=0.0)
    thread = threading.Thread(target=player.play, daemon=True)
    thread.start()
    wait_until(lambda: player.sent['/joint_states'] > 7)
    player.stop.set()
    thread.join(PATIENCE)
    assert not thread.is_alive()


def test_what_cannot_be_played_is_said(graph, tmp_path: Path) -> None:
    bag = _write(tmp_path / 'bag', 1)
    with pytest.raises(BagError, match=r"no topic 'unknown'.*/joint_states"):
        graph_player(graph, bag, topics=('unknown',))
    with pytest.raises(BagError, match='nothing'):
        graph_player(graph, tmp_path / 'nothing')
    for settings in ({'rate': 0.0}, {'rate': float('nan')}, {'clock': -1.0}, {'wait': -1.0}):
        with pytest.raises(ParameterError, match=next(iter(settings))):
            PlaySettings(**settings)
    with pytest.raises(ParameterError, match='above 0 and below 1e6'):
        PlaySettings(rate=1e6)


def _foreign(path: Path, encoding: str, schema: str, data: bytes) -> Path:
    """Write an MCAP file with one message of a foreign kind, and one of ours."""
    mcap_writer = pytest.importorskip('mcap.writer')
    with path.open('wb') as stream:
        writer = mcap_writer.Writer(stream)
        writer.start('ros2', 'test')
        numbers = writer.register_schema('std_msgs/msg/Int32', 'ros2msg', b'int32 data')
        kind = writer.register_schema(schema, 'ros2msg', b'') if schema else 0
        for topic, code, number, content in (('/n', 'cdr', numbers, encode_int32(1)),
                                             ('/foreign', encoding, kind, data)):
            writer.add_message(writer.register_channel(topic, code, number), 1, content, 1)
        writer.finish()
    return path


@pytest.mark.parametrize(('encoding', 'schema', 'reason'), [
    ('json', 'std_msgs/msg/Int32', "encoded as 'json': only those encoded as 'cdr'"),
    ('cdr', '', 'the bag states no type'),
    ('cdr', 'other_msgs/msg/Unknown', 'not installed')])
def test_a_topic_that_is_not_what_ros_speaks_is_left_out_with_the_reason(
        graph, tmp_path: Path, encoding: str, schema: str, reason: str) -> None:
    player = _play_unheard(graph, _foreign(tmp_path / 'x.mcap', encoding, schema, b'{"data": 1}'))
    assert list(player.skipped) == ['/foreign']
    assert reason in player.skipped['/foreign']
    assert player.sent == {'/n': 1}


def test_bytes_that_are_no_cdr_are_not_published(graph, tmp_path: Path) -> None:
    path = _foreign(tmp_path / 'x.mcap', 'cdr', 'std_msgs/msg/Int32', b'{"data": 1}')
    player = graph_player(graph, path, wait=0.0, clock=0.0)
    with pytest.raises(BagError, match='a message of /foreign is no CDR: first bytes 0x7b226461'):
        player.play()
    assert player.sent['/foreign'] == 0


@pytest.mark.parametrize('data', [encode_int32(5)[:-1], encode_int32(5)[:4]])
def test_a_message_that_is_cut_short_is_not_published(
        graph, tmp_path: Path, data: bytes) -> None:
    path = _foreign(tmp_path / 'x.mcap', 'cdr', 'std_msgs/msg/Int32', data)
    player = graph_player(graph, path, wait=0.0, clock=0.0)
    with pytest.raises(BagError, match=f'of /foreign of {len(data)} bytes is no std_msgs/msg/Int'):
        player.play()
    assert player.sent['/foreign'] == 0


def test_an_integer_on_a_topic_of_joint_states_is_not_published(graph, tmp_path: Path) -> None:
    path = _foreign(tmp_path / 'x.mcap', 'cdr', 'sensor_msgs/msg/JointState', encode_int32(5))
    player = graph_player(graph, path, wait=0.0, clock=0.0)
    with pytest.raises(BagError, match='of 8 bytes is no sensor_msgs/msg/JointState'):
        player.play()
    assert player.sent['/foreign'] == 0


def test_messages_compressed_one_by_one_are_published_unpacked(
        graph, wait_until: Callable, tmp_path: Path) -> None:
    zstandard = pytest.importorskip('zstandard')
    path = _foreign(tmp_path / 'x.mcap', 'cdr', 'std_msgs/msg/Int32',
                    zstandard.ZstdCompressor().compress(encode_int32(5)))
    heard = graph.peer().listen(Int32, '/foreign')
    player = graph_player(graph, path, wait=20.0, clock=0.0, topics=('/foreign',))
    assert player.wait_for_subscribers() == []
    player.play()
    wait_until(lambda: len(heard) == 1, what='the message')
    assert heard[0][0] == encode_int32(5)


def test_the_process_plays_to_the_end_and_ends_cleanly_on_ctrl_c(
        processes, wait_until: Callable, tmp_path: Path) -> None:
    bag = _write(tmp_path / 'bag', 20)
    once = processes.start('play', str(bag), '--wait', '0', '--topics', 'joint_states',
                           '--ros-args', '-r', '/joint_states:=/other')
    endless = processes.start('play', str(bag), '--loop', '--wait', '0', '--clock', '0')
    bad = processes.start('play', str(tmp_path / 'nothing'))
    assert once.wait() == 0
    assert re.search(r'^playing .*bag: 20 messages on 1 topics, at 1 x its pace$', once.text,
                     re.MULTILINE)
    assert re.search(r'\b20 messages on 1 topics, 2 ticks of the clock: 0.0 s of the bag in 0.',
                     once.text)
    wait_until(lambda: 'playing' in endless.text)
    assert endless.signal(signal.SIGINT) == 0
    assert 'Traceback' not in endless.text
    assert bad.wait() == 2
    assert bad.text.startswith('play: ')
