# SPDX-License-Identifier: Apache-2.0
"""The identifier node learns exactly what the closed loop without ROS learns, and says so."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

from diagnostic_msgs.msg import DiagnosticStatus
import numpy as np
import pytest
from rclpy.context import Context
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Int32
from std_srvs.srv import Trigger
import yaml

from adaptive_blf_control.configuration.build_closed_loop import build_closed_loop
from adaptive_blf_control.configuration.parameter_file import load_yaml
from adaptive_blf_control.identification.given_parameters import read_estimate
from adaptive_blf_control.messages.cdr import decode_float64, decode_int32
from adaptive_blf_control.messages.topics import (
    ADAPTATION_TERM,
    EXTERNAL_TORQUE,
    HISTORY_RANK,
    HISTORY_SIGMA_MIN,
    JOINT_STATES,
    THETA_HAT,
)
from adaptive_blf_control.nodes.identifier import IdentifierNode

THETA = np.array([3.473, 0.196, 0.242, 5.3, 1.1])
PARAMETERS = ('p1', 'p2', 'p3', 'fv_joint1', 'fv_joint2')
JOINTS = ('joint1', 'joint2')
EPOCH = 1_700_000_000 * 10**9


def _named(stamp_ns: int, names, position, velocity=(), effort=()) -> bytes:
    message = JointState(name=list(names))
    for field, values in (('position', position), ('velocity', velocity), ('effort', effort)):
        setattr(message, field, [float(value) for value in values])
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 10**9)
    return serialize_message(message)


def _run(repository: Path, duration: float) -> list[tuple[bytes, bytes, np.ndarray]]:
    """Simulate; return per sample the state, the term that answers it, and θ̂ after it."""
    loop = build_closed_loop(load_yaml(repository / 'config' / 'two_link.yaml'))
    samples = []

    def observe(sample) -> None:
        stamp = EPOCH + round(sample.t * 1e9)
        state = _named(stamp, JOINTS, *sample.measured)
        term = _named(stamp, PARAMETERS, sample.output.adaptation_term)
        samples.append((state, term, sample.theta_hat))

    loop.run(duration, observe)
    return samples


@pytest.fixture
def configured(repository):
    """Return an identifier with the parameters of config/two_link.yaml, as ros2 run makes it."""
    context = Context()
    context.init(args=['--ros-args', '--params-file',
                       str(repository / 'config' / 'two_link.yaml')], domain_id=101)
    node = IdentifierNode(context=context)
    yield node
    node.destroy_node()
    context.shutdown()


def test_the_external_torque_is_published_every_so_many_samples_and_its_rate_is_live(
        configured, repository) -> None:
    sent = []
    configured._outputs[EXTERNAL_TORQUE].publish = sent.append
    samples = _run(repository, 0.029)
    _feed(configured, samples[:15])
    configured.retune(configured.settings.replace(external_torque_decimation=5), set())
    _feed(configured, samples[15:])
    messages = [deserialize_message(data, JointState) for data in sent]
    assert [round((stamp.sec - EPOCH // 10**9) * 1e3 + stamp.nanosec * 1e-6)
            for stamp in (message.header.stamp for message in messages)] == [0, 10, 15, 20, 25]
    assert messages[0].name == ['joint1', 'joint2', 'joint1.bound', 'joint2.bound']
    assert np.isnan(messages[0].position[:2]).all()
    assert np.isinf(messages[0].position[2:]).all()


def _feed(node: IdentifierNode, samples) -> list[np.ndarray]:
    """Feed a run in the order of the graph: the term of a state arrives after that state."""
    learned = []
    for state, term, _ in samples:
        node.on_joint_states(state, {})
        learned.append(node.identifier.theta)
        node.terms.receive(term, {})
    return learned


def test_the_node_learns_what_the_closed_loop_without_ros_learns(configured, repository) -> None:
    samples = _run(repository, 2.0)
    learned = _feed(configured, samples)
    expected = np.array([theta for _, _, theta in samples])
    np.testing.assert_allclose(learned, expected, rtol=0.0, atol=1e-9)
    assert np.linalg.norm(learned[0] - THETA) > 1.0
    assert np.linalg.norm(learned[-1] - THETA) < 0.01 * np.linalg.norm(THETA)
    assert configured.identifier.stack.rank == 5
    assert configured.status()[1] == 'rank full'


def test_the_adaptation_term_takes_part(configured, repository) -> None:
    samples = _run(repository, 0.05)
    assert configured.set_parameters([Parameter('update_law', value='concurrent')])[0].successful
    learned = _feed(configured, samples)
    assert np.abs(np.array(learned) - [theta for _, _, theta in samples]).max() > 1e-6


def test_joints_and_parameters_are_matched_by_name(configured, repository) -> None:
    samples = []
    for state, term, theta in _run(repository, 0.05):
        s, t = (deserialize_message(data, JointState) for data in (state, term))
        for message in (s, t):
            for field in ('name', 'position', 'velocity', 'effort'):
                setattr(message, field, getattr(message, field)[::-1])
        samples.append((serialize_message(s), serialize_message(t), theta))
    np.testing.assert_allclose(_feed(configured, samples), [theta for _, _, theta in samples],
                               rtol=0.0, atol=1e-9)


def test_estimate_rank_and_sigma_min_are_published(graph, wait_until, repository) -> None:
    node = graph.make(IdentifierNode, kt=100.0, kh=100.0, filter__settle=0.0)
    peer = graph.peer()
    heard = [peer.listen(kind, topic) for topic, kind in (
        (THETA_HAT, JointState), (HISTORY_RANK, Int32), (HISTORY_SIGMA_MIN, Float64))]
    states = peer.create_publisher(JointState, JOINT_STATES, 100)
    terms = peer.create_publisher(JointState, ADAPTATION_TERM, 100)
    wait_until(lambda: states.get_subscription_count() == terms.get_subscription_count() == 1
               and all(node.count_subscribers(topic) for topic in (
                   THETA_HAT, HISTORY_RANK, HISTORY_SIGMA_MIN)))
    graph.run(node)
    samples = _run(repository, 0.3)
    for k, (state, term, _) in enumerate(samples):
        states.publish(state)
        terms.publish(term)
        wait_until(lambda k=k: len(heard[0]) > k, what=f'estimate {k}')
    first, last = (deserialize_message(heard[0][i][0], JointState) for i in (0, -1))
    assert (tuple(last.name), len(last.velocity), len(last.effort)) == (PARAMETERS, 0, 0)
    assert last.header.stamp == deserialize_message(samples[-1][0], JointState).header.stamp
    np.testing.assert_array_equal(last.position, node.identifier.theta)
    np.testing.assert_array_equal(first.position, np.zeros(5))
    stack = node.identifier.stack
    wait_until(lambda: decode_int32(heard[1][-1][0]) == stack.rank == 5)
    ranks = [decode_int32(data) for data, _ in heard[1]]
    assert ranks[0] == 0
    assert ranks == sorted(ranks)
    assert decode_float64(heard[2][-1][0]) == stack.sigma_min > 0.0
    assert len(ranks) <= stack.insertions + 1 + len(samples) // 200  # on change, else a heartbeat


def test_history_is_reset_and_the_estimate_kept_on_request(graph, wait_until, repository) -> None:
    node = graph.make(IdentifierNode, namespace='left')
    samples = _run(repository, 0.2)
    _feed(node, samples[:-1])
    count, theta = node.identifier.stack.count, node.identifier.theta
    assert count > 3
    graph.run(node)
    answer = graph.peer().call(Trigger, '/left/identifier/reset_history')
    assert (answer.success, answer.message) == (True, f'{count} pairs will be forgotten')
    node.on_joint_states(samples[-1][0], {})
    assert node.identifier.stack.count <= 1
    assert np.linalg.norm(node.identifier.theta - theta) < 0.5


def test_a_saved_estimate_is_where_a_later_run_starts(graph, repository, tmp_path) -> None:
    path = tmp_path / 'theta_hat.yaml'
    node = graph.make(IdentifierNode, estimate_file=str(path))
    _feed(node, _run(repository, 0.3))
    graph.run(node)
    answer = graph.peer().call(Trigger, '/identifier/save_estimate')
    assert (answer.success, answer.message) == (True, str(path))
    saved = yaml.safe_load(path.read_text(encoding='utf-8'))
    assert saved['theta_hat'] == dict(zip(PARAMETERS, node.identifier.theta.tolist()))
    assert saved['history_rank'] == node.identifier.stack.rank
    assert list(tmp_path.iterdir()) == [path]
    later = graph.make(IdentifierNode, namespace='later', initial_estimate_file=str(path))
    np.testing.assert_array_equal(later.identifier.theta, node.identifier.theta)
    # The file may vanish, or hold another θ̂ by now: that is no reason to refuse a gain.
    path.unlink()
    assert later.set_parameters([Parameter('kt', value=3.0)])[0].successful


@pytest.mark.parametrize(('period', 'written'), [(3600.0, True), (0.0, False)])
def test_what_was_learned_is_written_at_the_end_unless_on_request_only(
        graph, wait_until, tmp_path, period, written) -> None:
    path = tmp_path / 'theta.yaml'
    node = graph.make(IdentifierNode, estimate_file=str(path), estimate_period=period)
    states = graph.peer().create_publisher(JointState, JOINT_STATES, 10)
    runner = graph.run(node)
    stamps = itertools.count()

    def learned() -> bool:
        states.publish(deserialize_message(_state(next(stamps)), JointState))
        return node.identifier.updates > 3

    wait_until(learned)
    assert not path.exists()
    assert runner.end() == 0
    assert path.exists() is written
    if written:
        np.testing.assert_array_equal(read_estimate(path, PARAMETERS), node.identifier.theta)


def test_an_estimate_that_cannot_be_saved_is_answered_with_the_reason(graph, tmp_path) -> None:
    path = tmp_path / 'no_such_folder' / 'theta_hat.yaml'
    node = graph.make(IdentifierNode, estimate_file=str(path))
    graph.run(node)
    answer = graph.peer().call(Trigger, '/identifier/save_estimate')
    assert not answer.success
    assert answer.message.startswith(f'{path}: ')
    assert 'No such file or directory' in answer.message


def test_a_file_without_one_of_the_parameters_is_refused(graph, tmp_path) -> None:
    path = tmp_path / 'theta_hat.yaml'
    path.write_text('theta_hat: {p1: 1.0, p2: 2.0}\n', encoding='utf-8')
    with pytest.raises(ValueError, match=r"initial_estimate_file.*expected an entry 'p3'"):
        graph.make(IdentifierNode, initial_estimate_file=str(path))


def _state(ms: float, effort=(1.0, 2.0)) -> bytes:
    t = ms * 1e-3
    return _named(EPOCH + round(ms * 1e6), JOINTS, [math.sin(9 * t), math.cos(7 * t)],
                  [9 * math.cos(9 * t), -7 * math.sin(7 * t)], effort)


def test_samples_without_an_effort_are_counted_and_the_estimate_stays(graph) -> None:
    node = graph.make(IdentifierNode, initial_estimate=[1.0], filter__settle=0.0)
    for k, effort in enumerate(([math.nan, math.nan], [], [1.0, math.inf])):
        node.on_joint_states(_state(k, effort), {})
    np.testing.assert_array_equal(node.identifier.theta, np.ones(5))
    assert node.identifier.dropped['not finite'] == 3
    assert node.status()[2]['samples not finite'] == 3
    for k in range(3, 6):
        node.on_joint_states(_state(k), {})
    assert not np.array_equal(node.identifier.theta, np.ones(5))


def test_artificial_noise_is_a_warning_in_the_diagnostics(graph) -> None:
    node = graph.make(IdentifierNode, history__noise=0.1, filter__settle=0.0)
    assert node.status()[2]['artificial noise'] == 'not in use'
    for ms in range(3):
        node.on_joint_states(_state(ms), {})
    level, text, values = node.status()
    assert level == DiagnosticStatus.WARN
    assert 'history.noise' in text
    assert values['artificial noise'] == 'in use'


def test_states_that_cannot_be_read_are_counted_and_leave_no_trace(graph) -> None:
    node = graph.make(IdentifierNode)
    for k in range(3):
        node.on_joint_states(_state(k), {})
    theta = node.identifier.theta
    for bad in (b'', _state(3)[:60], _named(EPOCH, ('joint1',), [0.0], [0.0], [0.0]),
                _named(EPOCH, ('joint1', 'joint2', 'joint2'), [0.0] * 3, [0.0] * 3, [0.0] * 3),
                _named(EPOCH, JOINTS, [0.0], [0.0, 0.0], [0.0, 0.0])):
        node.on_joint_states(bad, {})
    assert node.faults.drops == {'unusable joint state': 5}
    assert node.identifier.theta is theta


def test_repeated_and_older_stamps_are_counted_and_a_clock_that_jumped_back_is_followed(
        graph) -> None:
    node = graph.make(IdentifierNode, filter__settle=0.0)
    for k in range(20):
        node.on_joint_states(_state(k), {})
    theta = node.identifier.theta
    node.on_joint_states(_state(19), {})
    node.on_joint_states(_state(18), {})
    assert node.identifier.theta is theta
    assert node.identifier.dropped['stamp repeated'] == 1
    assert node.identifier.dropped['stamp went back'] == 1
    restarts = node.identifier.restarts
    for k in range(-5000, -4990):
        node.on_joint_states(_state(k), {})
    assert node.identifier.restarts == restarts + 1
    assert node.identifier.theta is not theta


def test_terms_of_the_run_before_do_not_act_when_time_begins_again(graph) -> None:
    node = graph.make(IdentifierNode, adaptation_term_timeout=10.0)
    for ms in (0, 1, 2):
        node.terms.receive(_named(EPOCH + ms * 10**6, PARAMETERS, [30.0] * 5), {})
        node.on_joint_states(_state(ms), {})
    assert node.terms.held(EPOCH + 3 * 10**6) is not None
    node.on_joint_states(_state(-5000), {})
    node.on_joint_states(_state(2.5), {})  # the new run comes to where the old one was
    assert node.terms.held(EPOCH + 3 * 10**6) is None


def test_after_a_gap_the_filter_begins_anew(graph) -> None:
    node = graph.make(IdentifierNode, filter__gap=0.05)
    for k in range(20):
        node.on_joint_states(_state(k), {})
    restarts = node.identifier.restarts
    node.on_joint_states(_state(200.0), {})
    assert node.identifier.restarts == restarts + 1
    assert not node.identifier.pair[1].any()


def test_an_old_adaptation_term_counts_as_none(graph) -> None:
    fresh, none = (graph.make(IdentifierNode, namespace=name, adaptation_term_timeout=0.05)
                   for name in ('fresh', 'none'))
    for k in range(100):
        fresh.on_joint_states(_state(k), {})
        none.on_joint_states(_state(k), {})
        if k == 9:
            fresh.terms.receive(_named(EPOCH + 9_000_000, PARAMETERS, [30.0] * 5), {})
        same = np.allclose(fresh.identifier.theta, none.identifier.theta, rtol=1e-12, atol=0.0)
        assert same == (k <= 9) or k > 59
    assert fresh.terms.held(EPOCH + 59_000_000) is not None
    assert fresh.terms.held(EPOCH + 60_000_000) is None


def test_a_state_takes_the_term_of_the_interval_before_it_also_from_a_backlog(
        configured, repository) -> None:
    samples = _run(repository, 0.05)
    for _, term, _ in samples[:40]:  # the terms came faster than the states
        configured.terms.receive(term, {})
    learned = []
    for state, _, _ in samples[:40]:
        configured.on_joint_states(state, {})
        learned.append(configured.identifier.theta)
    np.testing.assert_allclose(learned, [theta for _, _, theta in samples[:40]], rtol=0.0,
                               atol=1e-9)


def test_an_adaptation_term_that_cannot_be_used_leaves_the_last_one(graph) -> None:
    node = graph.make(IdentifierNode)
    node.terms.receive(_named(EPOCH, PARAMETERS, [1.0] * 5), {})
    node.terms.receive(_named(EPOCH, PARAMETERS, [1.0, math.nan, 1.0, 1.0, 1.0]), {})
    node.terms.receive(_named(EPOCH, PARAMETERS[:4], [1.0] * 4), {})
    np.testing.assert_array_equal(node.terms.held(EPOCH + 10**6), np.ones(5))
    assert node.faults.drops == {'non-finite adaptation term': 1, 'unusable adaptation term': 1}


def test_no_bytes_make_the_estimate_non_finite(graph) -> None:
    hypothesis = pytest.importorskip('hypothesis')
    from hypothesis import strategies
    node = graph.make(IdentifierNode)
    stamps = iter(range(10**9))
    numbers = strategies.lists(strategies.floats() | strategies.floats(-10, 10), min_size=2,
                               max_size=2)
    states = strategies.builds(
        lambda q, qd, tau, late: _named(EPOCH + (next(stamps) + 100 * late) * 10**6, JOINTS, q,
                                        qd, tau),
        numbers, numbers, numbers, strategies.booleans())
    terms = strategies.builds(
        lambda values: _named(EPOCH + next(stamps) * 10**6, PARAMETERS, values),
        strategies.lists(strategies.floats(), min_size=5, max_size=5))
    good = _state(0.0)
    corrupted = strategies.builds(lambda at, new: good[:at] + new + good[at + len(new):],
                                  strategies.integers(0, len(good)),
                                  strategies.binary(max_size=9))

    @hypothesis.settings(max_examples=2000)
    @hypothesis.given(strategies.binary(max_size=150) | corrupted | states,
                      strategies.binary(max_size=150) | terms)
    def any_bytes(state: bytes, term: bytes) -> None:
        with np.errstate(all='ignore'):
            node.terms.receive(term, {})
            node.on_joint_states(state, {})
        assert np.isfinite(node.identifier.theta).all()
        assert math.isfinite(node.identifier.stack.sigma_min)

    any_bytes()
    assert node.identifier.dropped['not finite'] > 10


def test_wild_numbers_are_forgotten_once_the_history_is_reset(graph, repository) -> None:
    node = graph.make(IdentifierNode)
    for k in range(40):
        wild = 1e200 if k % 2 else -1e180
        with np.errstate(all='ignore'):
            node.on_joint_states(_named(EPOCH - 10**9 + k * 10**6, JOINTS, [wild, 1.0],
                                        [wild, wild], [wild, 1.0]), {})
    assert np.isfinite(node.identifier.theta).all()
    node.on_reset_history(Trigger.Request(), Trigger.Response())
    learned = _feed(node, _run(repository, 1.0))
    assert np.linalg.norm(learned[-1] - THETA) < 0.05 * np.linalg.norm(THETA)
