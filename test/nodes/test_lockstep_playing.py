# SPDX-License-Identifier: Apache-2.0
"""An identifier fed from a bag in lockstep learns what `identify` learns from that bag."""

from __future__ import annotations

from collections.abc import Callable
import json
from pathlib import Path
import signal

import numpy as np
import pytest
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from adaptive_blf_control.bags.logs import read_log
from adaptive_blf_control.bags.reader import read_bag
from adaptive_blf_control.bags.writer import BagWriter
from adaptive_blf_control.configuration.build_arm import build_arm
from adaptive_blf_control.configuration.build_identifier import build_identifier
from adaptive_blf_control.configuration.node_settings import IdentifierNodeSettings
from adaptive_blf_control.configuration.parameter_file import (
    given_values,
    load_yaml,
    node_settings,
)
from adaptive_blf_control.errors import BagError, ParameterError
from adaptive_blf_control.identification.given_parameters import read_estimate
from adaptive_blf_control.messages.cdr import decode_joint_state
from adaptive_blf_control.messages.joint_state import JointStateCodec
from adaptive_blf_control.messages.stamp import stamp_of
from adaptive_blf_control.messages.topics import RECORDED
from adaptive_blf_control.nodes.identifier import IdentifierNode
from adaptive_blf_control.nodes.play_settings import PlaySettings
from adaptive_blf_control.nodes.player import account, Player
from adaptive_blf_control.runtime import answers
from adaptive_blf_control.runtime.answers import NoAnswer
from adaptive_blf_control.tools.identify import main as identify
from adaptive_blf_control.tools.simulate import main as simulate

STATES, TERMS, THETA = '/joint_states', '/controller/adaptation_term', '/identifier/theta_hat'
# So weak that each state leaves its mark: the last estimate is off by 8e-8 or more without it.
WEAK = {'kt': 1.0, 'kh': 1.0}
PARAMETERS = ('p1', 'p2', 'p3', 'fv_joint1', 'fv_joint2')
START = 10**9


@pytest.fixture(scope='module')
def config(repository) -> Path:
    return repository / 'config' / 'two_link.yaml'


@pytest.fixture(scope='module')
def bag(tmp_path_factory, config) -> Path:
    """Return the bag of 3 s of the two-link task: states, terms, estimates and the rest."""
    path = tmp_path_factory.mktemp('run') / 'bag'
    assert simulate([str(config), '--duration', '3', '--bag', str(path)]) == 0
    return path


def _learner(graph, config: Path, **more) -> IdentifierNode:
    """Run an identifier with the parameters of a file."""
    given = {**given_values(load_yaml(config), 'identifier'), **more}
    node = graph.make(IdentifierNode, **{
        name.replace('.', '__'): value for name, value in given.items()})
    graph.run(node)
    return node


def _player(graph, path: Path, **settings) -> Player:
    player = Player(str(path), PlaySettings(**{'lockstep': True, 'wait': 0.0, **settings}),
                    context=graph.context)
    graph.add(player.node)
    return player


def _small_bag(folder: Path, names: list[list[str]]) -> Path:
    """Write a state per entry of ``names``, 1 ms apart."""
    with BagWriter(folder) as writer:
        writer.add_topic(STATES, RECORDED['joint_states'])
        for k, joints in enumerate(names):
            stamp = START + k * 10**6
            writer.write(STATES, JointStateCodec(joints).encode(
                stamp, *np.ones((3, len(joints)))), stamp)
    return folder


def _offline(path: Path, config: Path) -> np.ndarray:
    """Return θ̂ after every sample of the bag, learned without ROS, shape (N, m)."""
    settings = node_settings(load_yaml(config), IdentifierNodeSettings).replace(**WEAK)
    arm = build_arm(settings)
    identifier, log = build_identifier(settings, arm), read_log(path, joints=arm.joints)
    return np.array([identifier.update(*sample)
                     for sample in zip(log.t.tolist(), log.q, log.qd, log.tau)])


def _identified(capsys, path: Path, config: Path, output: Path) -> np.ndarray:
    capsys.readouterr()
    assert identify([str(path), '--config', str(config), '--train', ':', '--test', 'none',
                     '--json', '--output', str(output),
                     *(f'--set={name}={value}' for name, value in WEAK.items())]) == 0
    return np.array(list(json.loads(capsys.readouterr().out)['theta_hat'].values()))


def test_the_identifier_fed_from_a_bag_learns_what_identify_learns_from_it(
        graph, wait_until: Callable, capsys, tmp_path: Path, bag: Path, config: Path) -> None:
    _learner(graph, config, **WEAK)
    heard = graph.peer().listen(JointState, THETA, 5000)
    player = _player(graph, bag, topics=('joint_states',))
    player.play()
    assert player.lockstep.answered == player.sent[STATES] == 3001
    wait_until(lambda: len(heard) == 3001, what='the last estimate')
    played = np.array([decode_joint_state(data).position for data, _ in heard])
    expected = _identified(capsys, bag, config, tmp_path / 'theta.yaml')
    np.testing.assert_allclose(played[-1], expected, rtol=0.0, atol=1e-9)
    offline = _offline(bag, config)
    np.testing.assert_array_equal(offline[-1], expected)
    np.testing.assert_allclose(played, offline, rtol=0.0, atol=1e-9)
    assert np.linalg.norm(played[-1] - played[0]) > 1.0


def test_without_wait_sets_of_its_own_the_player_hears_every_answer_through_an_executor(
        graph, wait_until: Callable, monkeypatch, bag: Path, config: Path) -> None:
    monkeypatch.setattr(answers, 'DIRECT', False)  # as beside an rclpy whose inside has changed
    _learner(graph, config, **WEAK)
    player = _player(graph, bag, topics=('joint_states',))
    player.play()
    assert player.lockstep.answered == player.sent[STATES] == 3001


def test_with_the_adaptation_terms_the_estimates_of_the_run_itself_come_back(
        graph, wait_until: Callable, bag: Path, config: Path) -> None:
    _learner(graph, config, use_sim_time=True)  # waits for the term in front of a state
    heard = graph.peer().listen(JointState, THETA, 5000)
    _player(graph, bag, topics=(STATES, TERMS)).play()
    recorded = read_bag(bag).joint_states(THETA)
    wait_until(lambda: len(heard) == len(recorded.stamp_ns), what='the last estimate')
    played = [decode_joint_state(data) for data, _ in heard]
    assert [record.stamp_ns for record in played] == recorded.stamp_ns.tolist()
    np.testing.assert_allclose([record.position for record in played], recorded.position,
                               rtol=0.0, atol=1e-9)


def _thinned(folder: Path, bag: Path) -> Path:
    """Copy the bag as real time leaves one: some terms missing, some late, topic by topic."""
    states, terms = (list(read_bag(bag).messages((topic,))) for topic in (STATES, TERMS))
    kept = [m for k, m in enumerate(terms) if 20 <= k < 2980 and k % 50 not in (7, 8)]
    with BagWriter(folder) as writer:
        writer.add_topic(STATES, RECORDED['joint_states'])
        writer.add_topic(TERMS, RECORDED['controller/adaptation_term'])
        for first in range(0, len(states), 10):
            begin, end = (states[min(k, len(states) - 1)].log_time_ns for k in (first, first + 10))
            for message in states[first:first + 10]:
                writer.write(STATES, message.data, message.log_time_ns)
            for message in kept:
                late = 1_200_000 if stamp_of(message.data) % 7 == 0 else 300_000
                if begin <= message.log_time_ns < end:
                    writer.write(TERMS, message.data, message.log_time_ns + late)
    return folder


def test_a_bag_of_real_time_whose_states_lack_terms_teaches_what_its_own_terms_say(
        graph, wait_until: Callable, tmp_path: Path, bag: Path, config: Path) -> None:
    thinned = _thinned(tmp_path / 'bag', bag)
    content = read_bag(thinned)
    assert content.topics[STATES].count == 3001
    assert content.topics[TERMS].count == 2842
    settings = node_settings(load_yaml(config), IdentifierNodeSettings)
    arm = build_arm(settings)
    offline, log = build_identifier(settings, arm), read_log(thinned, joints=arm.joints)
    terms = content.joint_states(TERMS, arm.parameters)
    expected = []
    for stamp, *sample in zip(content.joint_states(STATES).stamp_ns.tolist(), log.t.tolist(),
                              log.q, log.qd, log.tau):
        sent = int(np.searchsorted(terms.stamp_ns, stamp)) - 1
        fresh = sent >= 0 and ((stamp - terms.stamp_ns[sent]) * 1e-9
                               <= settings.adaptation_term_timeout)
        expected.append(offline.update(*sample, terms.position[sent] if fresh else None))
    _learner(graph, config, use_sim_time=True)
    heard = graph.peer().listen(JointState, THETA, 5000)
    player = _player(graph, thinned, topics=(STATES, TERMS))
    player.play()
    assert (player.lockstep.answered, player.lockstep.resent) == (3001, 0)
    assert player.sent == {STATES: 3001, TERMS: 2842}
    wait_until(lambda: len(heard) == 3001, what='the last estimate')
    np.testing.assert_allclose([decode_joint_state(data).position for data, _ in heard], expected,
                               rtol=0.0, atol=1e-9)
    again = _player(graph, thinned, topics=(STATES, TERMS))  # time begins again
    again.play()
    assert (again.lockstep.answered, again.lockstep.resent) == (3001, 0)


def test_two_processes_do_the_same(processes, graph_of: Callable, wait_until: Callable, capsys,
                                   tmp_path: Path, bag: Path, config: Path) -> None:
    learner = processes.start('identifier', '--ros-args', '--params-file', str(config),
                              '-p', f'estimate_file:={tmp_path / "node.yaml"}',
                              *(word for name, value in WEAK.items()
                                for word in ('-p', f'identifier:{name}:={value}')))
    player = processes.start('play', str(bag), '--lockstep', '--topics', 'joint_states',
                             '--timeout', '60')
    assert player.wait() == 0, player.text
    assert f'playing {bag}: 3001 messages on 1 topics, in lockstep with {THETA}' in player.text
    assert '3001 of 3001 states answered' in player.text
    assert graph_of(processes.domain).peer().call(Trigger, '/identifier/save_estimate').success
    np.testing.assert_allclose(
        read_estimate(tmp_path / 'node.yaml', PARAMETERS),
        _identified(capsys, bag, config, tmp_path / 'theta.yaml'), rtol=0.0, atol=1e-9)
    assert learner.signal(signal.SIGINT) == 0


def _answer_late(peer: Node, answered: Callable[[int], bool] = lambda stamp_ns: True) -> list[int]:
    """Answer each state some 2 ms later; return how many states were waiting each time."""
    states: list[bytes] = []
    waiting: list[int] = []
    codec = JointStateCodec(['p'], fields=['position'])
    answers = peer.create_publisher(JointState, THETA, 100)

    def answer() -> None:
        if states:
            waiting.append(len(states))
            stamp = stamp_of(states.pop(0))
            if answered(stamp):
                answers.publish(codec.encode(stamp, [1.0]))

    peer.create_subscription(JointState, STATES, states.append, 100, raw=True)
    peer.create_timer(0.002, answer)
    return waiting


def test_no_state_is_sent_before_the_one_in_front_of_it_is_answered(
        graph, tmp_path: Path) -> None:
    waiting = _answer_late(graph.peer())
    player = _player(graph, _small_bag(tmp_path / 'bag', [['j1']] * 50))
    player.play()
    assert waiting == [1] * 50
    assert (player.lockstep.answered, player.lockstep.resent) == (50, 0)


def test_a_state_that_was_lost_is_sent_again(graph, tmp_path: Path) -> None:
    lost: list[int] = []

    def answered(stamp_ns: int) -> bool:
        lost.append(stamp_ns)
        return len(lost) != 2

    _answer_late(graph.peer(), answered)
    player = _player(graph, _small_bag(tmp_path / 'bag', [['j1']] * 3))
    player.play()
    assert lost == [START + k * 10**6 for k in (0, 1, 1, 2)]
    assert account(player).endswith('3 of 3 states answered, 1 times one was sent again')


def test_whoever_is_missing_is_named(graph, tmp_path: Path, config: Path) -> None:
    _learner(graph, config)
    other = _small_bag(tmp_path / 'other', [['wrist']] * 3)
    player = _player(graph, other, timeout=0.2)
    with pytest.raises(NoAnswer, match=rf"{THETA}: no answer within 0.2 s to the state of {START} "
                       r"ns with joints \['wrist'\]: is the identifier running with the same "
                       'joint names and namespace') as caught:
        player.play()
    assert (caught.value.topic, caught.value.stamp_ns) == (THETA, START)
    player = _player(graph, other, timeout=0.05, answers=('nobody/answers',))
    with pytest.raises(NoAnswer, match='/nobody/answers: nobody publishes it within'):
        player.wait_for_subscribers()
    player = _player(graph, other, timeout=0.05, answers=('identifier/history_rank',))
    with pytest.raises(BagError, match="rank has type 'std_msgs/msg/Int32': expected one that"):
        player.play()


def test_nobody_there_ends_the_process_with_status_1(processes, tmp_path: Path) -> None:
    bag = _small_bag(tmp_path / 'bag', [['j1']])
    player = processes.start('play', str(bag), '--lockstep', '--timeout', '0.3')
    both = processes.start('play', str(bag), '--lockstep', '--rate', '2')
    assert player.wait() == 1
    assert player.text == (f'play: {STATES}: nobody listens within 0.3 s: is the identifier '
                           'running with the same joint names and namespace?\n')
    assert both.wait() == 2
    assert 'not allowed with argument' in both.text


def test_ctrl_c_ends_the_wait_for_an_answer(
        processes, graph_of: Callable, wait_until: Callable, tmp_path: Path) -> None:
    peer = graph_of(processes.domain).peer()
    heard = peer.listen(JointState, STATES)
    peer.create_publisher(JointState, THETA, 10)
    player = processes.start('play', str(_small_bag(tmp_path / 'bag', [['j1']] * 2)),
                             '--lockstep', '--timeout', '60')
    wait_until(lambda: heard, what='the first state')
    assert player.signal(signal.SIGINT) == 0
    assert '0 of 1 states answered' in player.text
    assert 'Traceback' not in player.text


def test_states_of_another_robot_and_unreadable_ones_hold_nothing_up(
        graph, capsys, tmp_path: Path, config: Path) -> None:
    _learner(graph, config)
    ours, gripper = ['joint1', 'joint2'], ['finger']
    bag = _small_bag(tmp_path / 'bag', [gripper, ours, gripper, ours, ours])
    with BagWriter(tmp_path / 'mixed') as writer:
        writer.add_topic(STATES, RECORDED['joint_states'])
        for message in read_bag(bag):
            writer.write(STATES, message.data, message.log_time_ns)
            writer.write(STATES, message.data.replace(b'joint2', b'joint1'), message.log_time_ns)
            writer.write(STATES, message.data[:-9], message.log_time_ns)
    player = _player(graph, tmp_path / 'mixed', timeout=0.5)
    player.play()
    assert player.sent == {STATES: 15}
    assert player.lockstep.answered == 3
    assert player.lockstep.unanswered == {('finger',): 4, (): 8}
    assert "no answer within 0.5 s to joints ['finger']: states with" in capsys.readouterr().out
    assert "\n4 not waited for: joints ['finger']" in account(player)


def test_what_the_live_nodes_send_is_left_out_unless_it_is_named(graph, bag: Path) -> None:
    player = _player(graph, bag)
    assert [*player.sent][-1] == STATES  # known to others once the first state is
    assert set(player.sent) == {STATES, TERMS, '/controller/reference', '/controller/barrier',
                                '/controller/tracking_error', '/robot_description'}
    assert player.skipped['/effort_controller/commands'].startswith('it moves an arm')
    assert player.skipped[THETA] == 'it is the answer that lockstep waits for'
    assert player.skipped['/identifier/history_rank'] == 'the node that answers sends it'
    named = _player(graph, bag, topics=('joint_states', 'effort_controller/commands'))
    assert set(named.sent) == {STATES, '/effort_controller/commands'}
    with pytest.raises(BagError, match=f'{THETA} is the answer'):
        _player(graph, bag, topics=('joint_states', 'identifier/theta_hat'))
    with pytest.raises(BagError, match='one topic of joint states, here are none'):
        _player(graph, bag, topics=('identifier/history_rank',))
    with pytest.raises(ParameterError, match='--answers'):
        PlaySettings(lockstep=True, answers=())
    with pytest.raises(ParameterError, match='--timeout'):
        PlaySettings(timeout=0.0)
