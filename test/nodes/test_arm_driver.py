# SPDX-License-Identifier: Apache-2.0
"""The driver's arm obeys its commands exactly: mean torque, grid of stamps, watchdog, brakes."""

from __future__ import annotations

import time

from diagnostic_msgs.msg import DiagnosticArray
import numpy as np
import pytest
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.time import Time
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.messages.cdr import Float64MultiArrayCodec
from adaptive_blf_control.nodes import arm_driver
from adaptive_blf_control.nodes.arm_driver import ArmDriver
from adaptive_blf_control.runtime import data_node
from patience import PATIENCE

FIRST, SECOND = '/first#00000001', '/second#00000002'
THETA = [3.473, 0.196, 0.242, 5.3, 1.1]
DYNAMICS = TwoLinkArm().dynamics(np.array(THETA))
START = {'initial_position': [0.1, 2.0], 'initial_velocity': [0.5, -0.3],
         'true_model': 'given', 'true_parameters': THETA}


def _command(*torque: float) -> bytes:
    return Float64MultiArrayCodec(len(torque)).encode(torque)


class _States:
    """Joint states as another ROS program decodes them."""

    def __init__(self, peer) -> None:
        self._raw = peer.listen(JointState, 'joint_states')

    def __len__(self) -> int:
        return len(self._raw)

    def __getitem__(self, index: int) -> JointState:
        return deserialize_message(self._raw[index][0], JointState)

    @property
    def stamps(self) -> list[int]:
        return [_stamp(self[i]) for i in range(len(self))]

    @property
    def numbers(self) -> list[int]:
        """What the publisher numbered them with."""
        return [info['publication_sequence_number'] for _, info in self._raw]


def _stamp(state: JointState) -> int:
    return state.header.stamp.sec * 10**9 + state.header.stamp.nanosec


def _arrays(state: JointState) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return tuple(np.array(field) for field in (state.position, state.velocity, state.effort))


@pytest.fixture
def rig(graph, wait_until):
    """Return ``rig(**parameters)``: driver, its states, publisher of commands; not yet running."""
    def make(**parameters):
        driver = graph.make(ArmDriver, **{**START, **parameters})
        peer = graph.peer()
        states = _States(peer)
        commands = peer.create_publisher(Float64MultiArray, 'effort_controller/commands', 10)
        wait_until(lambda: commands.get_subscription_count() == 1
                   and driver.count_subscribers('joint_states') == 1, what='the match')
        return driver, states, lambda *torque: commands.publish(
            Float64MultiArray(data=[float(value) for value in torque]))

    return make


class _HandClock:
    """Stands in for the module ``time``: moves when the test says so."""

    def __init__(self) -> None:
        self.now_ns = 5_000_000_000

    def monotonic_ns(self) -> int:
        return self.now_ns

    def monotonic(self) -> float:
        return self.now_ns * 1e-9

    def time_ns(self) -> int:
        return self.now_ns


@pytest.fixture
def by_hand(graph, wait_until, monkeypatch):
    """Return a driver at 100 Hz whose clock the test moves, the clock, and its states."""
    clock = _HandClock()
    monkeypatch.setattr(arm_driver, 'time', clock)
    driver = graph.make(ArmDriver, rate=100.0, torque_limit=[50.0, 40.0], **START)
    states = _States(graph.peer())
    wait_until(lambda: driver.count_subscribers('joint_states') == 1)
    driver.start_clock()

    def state_at(ms: float) -> JointState:
        """Move the clock to ``ms`` after the start, serve what is due, return the last state."""
        before = len(states)
        clock.now_ns = 5_000_000_000 + round(ms * 1e6)
        driver.catch_up(clock.now_ns)
        wait_until(lambda: len(states) == before + 1, what=f'the state at {ms} ms')
        return states[-1]

    def command_at(ms: float, *torque: float, **info: int) -> None:
        clock.now_ns = 5_000_000_000 + round(ms * 1e6)
        driver.on_command(_command(*torque), info)

    return driver, state_at, command_at, states


def set_live(driver: ArmDriver, **values: object) -> None:
    results = driver.set_parameters([Parameter(name, value=value)
                                     for name, value in values.items()])
    assert all(result.successful for result in results), results


def _advanced(q, qd, *pieces: tuple[tuple[float, float], float]):
    for torque, ms in pieces:
        q, qd = DYNAMICS.advance(q, qd, np.array(torque), ms * 1e-3, 1)
    return q, qd


def test_effort_is_the_mean_torque_of_the_interval_and_the_state_its_result(by_hand) -> None:
    _, state_at, command_at, _ = by_hand
    a, b, c = (10.0, -4.0), (-30.0, 8.0), (5.0, 20.0)
    state_at(0.0)
    command_at(4.0, *a)  # begins the motion within the first interval
    q, qd, effort = _arrays(state_at(10.0))
    np.testing.assert_allclose(effort, a, rtol=1e-12)
    expected = _advanced(np.array(START['initial_position']), np.array(START['initial_velocity']),
                         (a, 6.0))
    np.testing.assert_allclose([q, qd], expected, rtol=0.0, atol=1e-12)
    command_at(13.0, *b)
    command_at(18.0, *c)
    expected = _advanced(q, qd, (a, 3.0), (b, 5.0), (c, 2.0))
    q, qd, effort = _arrays(state_at(20.0))
    np.testing.assert_allclose(effort, 0.3 * np.array(a) + 0.5 * np.array(b) + 0.2 * np.array(c),
                               rtol=1e-12)
    np.testing.assert_allclose([q, qd], expected, rtol=0.0, atol=1e-12)
    q, qd, effort = _arrays(state_at(30.0))
    np.testing.assert_allclose(effort, c, rtol=1e-12)


def test_a_state_that_is_due_does_not_see_a_command_that_came_after(by_hand, wait_until) -> None:
    _, state_at, command_at, states = by_hand
    a, b = (10.0, -4.0), (-30.0, 8.0)
    state_at(0.0)
    command_at(0.0, *a)
    q, qd, _ = _arrays(state_at(10.0))
    command_at(23.0, *b)  # the state of 20 ms was not served in time
    wait_until(lambda: len(states) == 3)
    at_20 = _arrays(states[-1])
    np.testing.assert_allclose(at_20[2], a, rtol=1e-12)
    np.testing.assert_allclose(at_20[:2], _advanced(q, qd, (a, 10.0)), rtol=0.0, atol=1e-12)
    at_30 = _arrays(state_at(30.0))
    np.testing.assert_allclose(at_30[2], 0.3 * np.array(a) + 0.7 * np.array(b), rtol=1e-12)


def test_periods_that_passed_unseen_are_missed_not_squeezed(by_hand) -> None:
    driver, state_at, command_at, states = by_hand
    state_at(0.0)
    command_at(0.0, 10.0, -4.0)
    q, qd, _ = _arrays(state_at(10.0))
    late = state_at(57.0)  # 20 to 40 ms were missed, 50 ms is served
    assert driver.grid.missed == 3
    np.testing.assert_allclose(_arrays(late)[2], (10.0, -4.0), rtol=1e-12)
    np.testing.assert_allclose(
        _arrays(late)[:2], _advanced(q, qd, *[((10.0, -4.0), 10.0)] * 4), rtol=0.0, atol=1e-9)
    state_at(60.0)
    assert [stamp - states.stamps[0] for stamp in states.stamps] == [
        0, 10_000_000, 50_000_000, 60_000_000]


def test_answers_within_their_period_are_counted_of_all_that_were_due(
        by_hand, monkeypatch) -> None:
    driver, state_at, command_at, _ = by_hand
    monkeypatch.setattr(data_node, 'time', arm_driver.time)
    state_at(0.0)
    state_at(700.0)  # 70 periods without an answer, before the motion
    for k in range(70, 371):
        if k > 70:
            state_at(10.0 * k)
        if k % 5:  # each fifth is not answered
            now_ns = 5_000_000_000 + round((10.0 * k + 2.0) * 1e6)
            command_at(10.0 * k + 2.0, 1.0, 1.0, source_timestamp=now_ns)
    figures = driver.status()[2]
    # The motion begins at 71, settles for 2 s from 72 to 272; 98 periods later the last state.
    key = 'answered within their period so far [%]'
    assert float(figures[key]) == pytest.approx(100.0 * (98 - 19) / 98, abs=1e-3)


def test_after_a_long_stall_the_arm_has_moved_in_steps_of_a_period(by_hand) -> None:
    _, state_at, command_at, _ = by_hand
    state_at(0.0)
    command_at(0.0, 20.0, 5.0)
    driver = by_hand[0]
    set_live(driver, command_timeout=10.0)
    q, qd, effort = _arrays(state_at(2000.0))
    fine = _advanced(np.array(START['initial_position']), np.array(START['initial_velocity']),
                     *[((20.0, 5.0), 1.0)] * 2000)
    np.testing.assert_allclose([q, qd], fine, rtol=1e-3)
    np.testing.assert_allclose(effort, (20.0, 5.0), rtol=1e-12)


def test_without_commands_the_torque_goes_to_zero_until_the_next_one(by_hand) -> None:
    driver, state_at, command_at, _ = by_hand
    state_at(0.0)
    command_at(5.0, 10.0, -4.0)
    for ms in range(10, 101, 10):
        np.testing.assert_allclose(_arrays(state_at(ms))[2], (10.0, -4.0), rtol=1e-12)
    assert not driver.drives.timed_out
    np.testing.assert_array_equal(_arrays(state_at(110.0))[2], (0.0, 0.0))
    assert driver.drives.timed_out
    assert 'zero torque' in driver.status()[1]
    assert driver.faults.last == 'no command for 0.1 s: zero torque'
    command_at(115.0, 6.0, 2.0)
    np.testing.assert_allclose(_arrays(state_at(120.0))[2], (3.0, 1.0), rtol=1e-12)
    assert not driver.drives.timed_out


def test_timeout_action_damping_brakes_the_motion_until_the_next_command(by_hand) -> None:
    driver, state_at, command_at, _ = by_hand
    set_live(driver, timeout_action='damping', damping=[4.0, 0.5])
    state_at(0.0)
    command_at(0.0, 10.0, -4.0)
    for ms in range(10, 101, 10):
        q, qd, _ = _arrays(state_at(ms))
    energy = []
    for ms in range(110, 301, 10):
        torque = np.array([-4.0, -0.5]) * qd  # of the state before, held over the interval
        expected = _advanced(q, qd, (torque, 10.0))
        q, qd, effort = _arrays(state_at(ms))
        np.testing.assert_allclose(effort, torque, rtol=1e-12)
        np.testing.assert_allclose([q, qd], expected, rtol=0.0, atol=1e-12)
        energy.append(0.5 * qd @ TwoLinkArm().Y1(q, qd) @ THETA)
    assert (np.diff(energy) < 0.0).all()
    assert driver.drives.timed_out
    assert driver.faults.last == 'no command for 0.1 s: damping torque'
    assert 'damping torque' in driver.status()[1]
    command_at(300.0, 6.0, 2.0)
    np.testing.assert_allclose(_arrays(state_at(310.0))[2], (6.0, 2.0), rtol=1e-12)
    assert not driver.drives.timed_out


def test_one_publisher_of_commands_is_obeyed_until_it_has_been_silent(by_hand) -> None:
    driver, state_at, _, _ = by_hand
    a, b = (10.0, -4.0), (-30.0, 8.0)

    def command(number: int, torque, label: str = '') -> None:
        driver.on_command(Float64MultiArrayCodec(2, label).encode(torque),
                          {'publication_sequence_number': number})

    state_at(0.0)
    command(500, a, FIRST)
    state_at(10.0)
    for number in (1, 2, 501, 502, 9000):  # whatever it counts
        command(number, b)
        command(number, b, SECOND)
    np.testing.assert_allclose(_arrays(state_at(20.0))[2], a, rtol=1e-12)
    refused = 'command of a second publisher'
    assert driver.faults.drops == {refused: 10}
    assert driver.faults.last == f'{SECOND!r} is refused while {FIRST!r} speaks'
    command(9900, (1.0, 2.0), FIRST)
    np.testing.assert_allclose(_arrays(state_at(30.0))[2], (1.0, 2.0), rtol=1e-12)
    state_at(110.0)
    command(4, b)  # the first has been silent for 90 ms: less than command_timeout
    assert driver.faults.drops == {refused: 11}
    state_at(130.0)
    command(5, b)  # the second one takes over, and is the one now
    command(9901, a, FIRST)
    np.testing.assert_allclose(_arrays(state_at(140.0))[2], b, rtol=1e-12)
    assert driver.faults.drops == {refused: 12}


def test_of_two_publishers_without_a_label_neither_moves_the_arm(
        by_hand, monkeypatch) -> None:
    driver, state_at, _, _ = by_hand
    monkeypatch.setattr(driver, 'count_publishers', lambda _: 2)
    state_at(0.0)
    numbers = [(500, (10.0, -4.0)), (1, (-30.0, 8.0))]
    for ms in range(10, 150, 10):
        for k, (number, torque) in enumerate(numbers):
            driver.on_command(_command(*torque), {'publication_sequence_number': number})
            numbers[k] = number + 1, torque
        effort = _arrays(state_at(float(ms)))[2]
        expected = (10.0, -4.0) if ms <= 100 else (0.0, 0.0)  # held, then the watchdog
        if ms > 10:
            np.testing.assert_allclose(effort, expected, rtol=1e-12)
    assert driver.faults.drops == {'command of one of two publishers': 27}
    assert 'cannot be told apart' in driver.faults.last


def test_a_command_after_a_stall_does_not_let_the_one_before_act_all_the_while(
        by_hand, wait_until) -> None:
    driver, state_at, command_at, states = by_hand
    state_at(0.0)
    command_at(0.0, 10.0, -4.0)
    state_at(10.0)
    before = len(states)
    command_at(2013.0, 1.0, 1.0)
    wait_until(lambda: len(states) == before + 1, what='the state at 2010 ms')
    np.testing.assert_array_equal(_arrays(states[-1])[2], 0.0)
    assert 'no command for' in driver.faults.last
    np.testing.assert_allclose(_arrays(state_at(2020.0))[2], 0.7, rtol=1e-12)


def test_a_state_that_was_held_up_before_it_could_be_sent_is_not_sent(
        by_hand, monkeypatch) -> None:
    driver, state_at, command_at, states = by_hand
    state_at(0.0)
    command_at(0.0, 10.0, -4.0)
    first = state_at(10.0)
    measure = driver.plant.measure

    def stopped(*given: object) -> object:
        arm_driver.time.now_ns += 30_000_000  # by SIGSTOP, or a busy machine
        return measure(*given)

    with monkeypatch.context() as within:
        within.setitem(vars(driver.plant), 'measure', stopped)
        arm_driver.time.now_ns = 5_020_000_000
        assert driver.catch_up(5_020_000_000)
    assert driver.faults.drops == {'state that was held up': 1}
    after = Time.from_msg(state_at(60.0).header.stamp) - Time.from_msg(first.header.stamp)
    assert after.nanoseconds == 50_000_000


def test_an_answer_to_a_state_older_than_command_timeout_is_refused(by_hand) -> None:
    driver, state_at, command_at, states = by_hand
    state_at(0.0)
    command_at(0.0, 10.0, -4.0)
    for ms in range(10, 80, 10):
        state_at(float(ms))
    codec = Float64MultiArrayCodec(2, FIRST)
    driver.settings = driver.settings.replace(command_timeout=0.05)
    driver.commands.source.source = None
    driver.on_command(codec.encode([1.0, 1.0], states.stamps[0]), {})
    assert driver.faults.drops == {'command to an old state': 1}
    driver.on_command(codec.encode([1.0, 1.0], states.stamps[-1]), {})
    driver.on_command(codec.encode([2.0, 2.0]), {})  # answers none: a ramp, a final zero
    assert driver.faults.drops == {'command to an old state': 1}


def test_a_new_rate_counts_from_the_last_state_on(by_hand) -> None:
    driver, state_at, command_at, states = by_hand
    state_at(0.0)
    command_at(0.0, 10.0, -4.0)
    q, qd, _ = _arrays(state_at(10.0))
    assert driver.set_parameters([Parameter('rate', value=250.0)])[0].successful
    at_14 = _arrays(state_at(14.0))
    np.testing.assert_allclose(at_14[:2], _advanced(q, qd, ((10.0, -4.0), 4.0)), rtol=0.0,
                               atol=1e-12)
    np.testing.assert_allclose(at_14[2], (10.0, -4.0), rtol=1e-12)
    assert driver.set_parameters([Parameter('rate', value=20.0)])[0].successful
    driver.catch_up(5_063_999_999)
    state_at(64.0)
    assert np.diff(states.stamps).tolist() == [10_000_000, 4_000_000, 50_000_000]
    assert driver.grid.missed == 0


def test_a_second_real_publisher_does_not_move_the_arm(rig, graph, wait_until) -> None:
    driver, states, send = rig(rate=100.0, command_timeout=1.0)
    graph.run(driver)

    def obeyed(*torque: float) -> bool:
        send(*torque)
        return len(states) and np.allclose(states[-1].effort, torque)

    wait_until(lambda: obeyed(3.0, -2.0) and driver.commands.source.number > 30)
    second = graph.peer().create_publisher(Float64MultiArray, 'effort_controller/commands', 10)
    wait_until(lambda: second.get_subscription_count() == 1)
    for _ in range(5):
        second.publish(Float64MultiArray(data=[50.0, 50.0]))
    wait_until(lambda: driver.faults.drops == {'command of one of two publishers': 5},
               what='five drops')
    wait_until(lambda: driver.status()[1].startswith(
        'several publishers of effort_controller/commands: /peer'))
    wait_until(lambda: obeyed(4.0, -1.0), 'the one that goes on')  # after the second's silence
    assert all(np.isnan(states[i].effort[0]) or states[i].effort[0] < 4.001
               for i in range(len(states)))


def test_a_command_while_inactive_is_dropped(by_hand) -> None:
    driver, state_at, command_at, _ = by_hand
    state_at(0.0)
    driver.trigger_deactivate()
    command_at(4.0, 10.0, -4.0)
    assert driver.faults.drops == {'command while inactive': 1}
    state = state_at(10.0)
    assert (list(state.position), driver.started) == (START['initial_position'], False)
    assert np.isnan(state.effort).all()
    assert driver.status()[1] == 'inactive: brakes on'
    driver.trigger_activate()
    command_at(15.0, 10.0, -4.0)
    np.testing.assert_allclose(_arrays(state_at(20.0))[2], (10.0, -4.0), rtol=1e-12)


def test_deactivated_the_torque_goes_to_zero_over_the_ramp_and_the_brakes_hold(by_hand) -> None:
    driver, state_at, command_at, _ = by_hand
    set_live(driver, ramp_time=0.05)
    state_at(0.0)
    command_at(0.0, 10.0, -4.0)
    state_at(10.0)
    driver.trigger_deactivate()
    efforts = []
    for ms in range(20, 61, 10):
        command_at(ms - 5.0, 10.0, -4.0)  # the controller has not noticed yet
        efforts.append(_arrays(state_at(ms))[2])
    np.testing.assert_allclose(efforts, np.outer([0.8, 0.6, 0.4, 0.2, 0.0], (10.0, -4.0)),
                               atol=1e-12)
    assert not driver.started
    held = state_at(70.0)
    later = state_at(170.0)
    np.testing.assert_array_equal(later.position, held.position)
    np.testing.assert_array_equal(later.velocity, 0.0)
    assert np.isnan(later.effort).all()


def test_after_cleanup_during_a_ramp_the_brakes_hold_and_nothing_is_measured(
        by_hand, wait_until) -> None:
    driver, state_at, command_at, states = by_hand
    state_at(0.0)
    command_at(0.0, 10.0, -4.0)
    state_at(10.0)
    driver.trigger_deactivate()
    state_at(20.0)
    assert driver.started
    driver.trigger_cleanup()
    assert not driver.started
    driver.trigger_configure()
    driver.trigger_activate()
    driver.start_clock()
    count = len(states)
    driver.catch_up(arm_driver.time.monotonic_ns())
    wait_until(lambda: len(states) > count, what='a state')
    assert not driver.started
    assert driver.status()[1] == 'brakes on, waiting for a command'
    assert (list(states[-1].position), list(states[-1].velocity)) == ([0.1, 2.0], [0.5, -0.3])
    assert np.isnan(states[-1].effort).all()


def test_stamps_are_those_of_the_system_clock(rig, graph, wait_until) -> None:
    driver, states, _ = rig(rate=100.0)
    graph.run(driver)
    wait_until(lambda: len(states))
    assert abs(_stamp(states[0]) - time.time_ns()) < PATIENCE * 1e9


def test_the_drives_saturate(by_hand) -> None:
    _, state_at, command_at, _ = by_hand
    state_at(0.0)
    command_at(0.0, 1e6, -1e300)
    np.testing.assert_allclose(_arrays(state_at(10.0))[2], (50.0, -40.0), rtol=1e-12)


def test_until_the_first_command_the_brakes_hold_and_nothing_is_measured(rig, graph,
                                                                         wait_until) -> None:
    driver, states, send = rig(rate=200.0, frame_id='world')
    graph.run(driver)
    wait_until(lambda: len(states) >= 10)
    assert 'brakes' in driver.status()[1]
    send(0.0, 0.0)
    first = wait_until(lambda: next((i for i in range(len(states))
                                     if np.isfinite(states[i].effort).all()), None))
    assert first >= 10
    for i in range(first):
        state = states[i]
        assert (list(state.name), state.header.frame_id) == (['joint1', 'joint2'], 'world')
        assert (list(state.position), list(state.velocity)) == ([0.1, 2.0], [0.5, -0.3])
        assert np.isnan(state.effort).all()
    wait_until(lambda: len(states) > first + 3)
    assert list(states[first + 2].position) != [0.1, 2.0]


def test_stamps_lie_on_the_grid_at_a_rate_that_cannot_be_held(rig, graph, wait_until) -> None:
    driver, states, _ = rig(rate=10000.0)  # more than Python can serve: periods are missed
    runner = graph.run(driver)
    wait_until(lambda: len(states) >= 500)
    runner.end()
    count = len(states)
    steps = np.diff(states.stamps[:count])
    unbroken = np.diff(states.numbers[:count]) == 1  # nothing was lost on the way to the test
    assert (steps % 100_000 == 0).all()
    assert (steps > 0).all()
    assert int((steps // 100_000 - 1)[unbroken].sum()) <= driver.grid.missed


def test_real_commands_act_within_the_interval_in_which_they_arrive(rig, graph,
                                                                    wait_until) -> None:
    driver, states, send = rig(rate=20.0, command_timeout=5.0, torque_limit=[90.0])
    graph.run(driver)
    levels = [(10.0, -4.0), (-30.0, 8.0), (5.0, 20.0), (-7.0, -11.0)]
    for level in levels:
        send(*level)
        wait_until(lambda level=level: len(states) and np.allclose(states[-1].effort, level),
                   what=f'an effort of {level}')
    moving = [i for i in range(len(states)) if np.isfinite(states[i].effort).all()]
    mixed = 0
    for i in moving[1:]:
        q, qd, _ = _arrays(states[i - 1])
        effort = np.array(states[i].effort)
        pieces = _pieces(effort, levels)
        mixed += len(pieces) > 1
        np.testing.assert_allclose(_arrays(states[i])[:2], _advanced(q, qd, *pieces), rtol=0.0,
                                   atol=1e-9)
    assert mixed >= 1


def _pieces(effort, levels):
    """Split 50 ms into one or two neighbouring levels whose mean is ``effort``."""
    for a, b in zip(levels, levels[1:]):
        weight = (effort[0] - a[0]) / (b[0] - a[0])
        if -1e-9 <= weight <= 1 + 1e-9 and np.isclose(
                effort[1], a[1] + weight * (b[1] - a[1]), atol=1e-9):
            weight = min(max(weight, 0.0), 1.0)
            return [(level, share * 50.0) for level, share in ((a, 1.0 - weight), (b, weight))
                    if share > 1e-9]
    pytest.fail(f'{effort} is not a mean of two neighbours of {levels}')


def test_a_bad_command_is_dropped_whole_and_counted(rig, graph, wait_until) -> None:
    driver, states, send = rig(rate=100.0, command_timeout=5.0)
    graph.run(driver)
    send(3.0, -2.0)
    wait_until(lambda: len(states) and np.allclose(states[-1].effort, (3.0, -2.0)))
    begin = len(states)
    for bad in ((), (1.0,), (1.0, 2.0, 3.0), (9.0, np.nan), (np.inf, 9.0), (9.0, -np.inf)):
        send(*bad)
    wait_until(lambda: sum(driver.faults.drops.values()) == 6, what='six drops')
    assert driver.faults.drops == {'command of wrong length': 3, 'non-finite command': 3}
    wait_until(lambda: len(states) >= begin + 5)
    for i in range(begin, len(states)):
        np.testing.assert_allclose(states[i].effort, (3.0, -2.0), rtol=1e-9)


def test_a_bad_first_command_does_not_release_the_brakes(rig, graph, wait_until) -> None:
    driver, states, send = rig(rate=100.0)
    graph.run(driver)
    send(np.nan, 0.0)
    wait_until(lambda: sum(driver.faults.drops.values()) == 1 and len(states) > 5)
    assert not driver.started
    assert list(states[-1].position) == [0.1, 2.0]


def test_no_bytes_on_the_command_topic_make_the_state_non_finite(graph) -> None:
    hypothesis = pytest.importorskip('hypothesis')
    driver = graph.make(ArmDriver, **START)
    driver.start_clock()
    good = _command(3.0, -2.0)
    corrupted = hypothesis.strategies.tuples(
        hypothesis.strategies.integers(0, len(good) - 1), hypothesis.strategies.binary(max_size=9)
    ).map(lambda cut: good[:cut[0]] + cut[1] + good[cut[0] + len(cut[1]):])

    @hypothesis.settings(max_examples=2000)
    @hypothesis.given(data=hypothesis.strategies.binary(max_size=80) | corrupted)
    def any_bytes(data: bytes) -> None:
        driver.on_command(data, {})
        assert np.isfinite(driver.plant.torque).all()
        assert np.isfinite([driver.plant.q, driver.plant.qd]).all()

    any_bytes()
    assert driver.faults.drops['unreadable command'] > 100


def test_duration_ends_the_run_with_0_counted_from_the_first_command(rig, graph,
                                                                     wait_until) -> None:
    driver, states, send = rig(rate=200.0, duration=0.3)
    runner = graph.run(driver)
    wait_until(lambda: len(states) > 100)  # longer than the duration, still with brakes
    assert runner.code is None
    send(1.0, 1.0)
    assert runner.join() == 0
    moving = [_stamp(states[i]) for i in range(len(states)) if np.isfinite(states[i].effort).all()]
    assert 0.29 <= (moving[-1] - moving[0]) * 1e-9 <= 0.5


def test_no_state_before_enough_have_subscribed(graph, wait_until) -> None:
    driver = graph.make(ArmDriver, wait_for_subscribers=2, **START)
    peer = graph.peer()
    first, diagnostics = _States(peer), peer.listen(DiagnosticArray, '/diagnostics')
    wait_until(lambda: driver.count_subscribers('joint_states') == 1)
    graph.run(driver)
    wait_until(lambda: diagnostics)  # it has been running for a while
    assert not first
    second = _States(graph.peer())
    wait_until(lambda: len(first) and len(second))
    assert _stamp(first[0]) == _stamp(second[0])


def test_states_reach_best_effort_and_reliable_subscribers(graph, wait_until) -> None:
    driver = graph.make(ArmDriver, **START)
    peer = graph.peer()
    sensor_data = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
    reliable, best_effort = peer.listen(JointState, 'joint_states'), []
    peer.create_subscription(JointState, 'joint_states', best_effort.append, sensor_data)
    graph.run(driver)
    wait_until(lambda: reliable and best_effort)


def test_parameters_of_an_encoder_are_a_warning_where_none_measures(graph, capfd) -> None:
    said = ("arm_driver.sensors.{} is without effect: only arm_driver.sensors.model 'encoder' "
            'looks at it')
    driver = graph.make(ArmDriver, sensors__encoder_counts=4096, sensors__torque_noise=0.1)
    log = capfd.readouterr().err
    assert '[WARN]' in log
    assert said.format('encoder_counts') in log
    assert driver.set_parameters([Parameter('sensors.gear_ratio', value=50.0)])[0].successful
    assert said.format('gear_ratio') in capfd.readouterr().err


def test_parameters_of_an_encoder_that_measures_are_no_warning(graph, capfd) -> None:
    driver = graph.make(ArmDriver, sensors__model='encoder', sensors__encoder_counts=4096)
    assert driver.set_parameters([Parameter('sensors.gear_ratio', value=50.0)])[0].successful
    graph.make(ArmDriver, sensors__torque_noise=0.1)  # which any sensor has
    assert 'without effect' not in capfd.readouterr().err
