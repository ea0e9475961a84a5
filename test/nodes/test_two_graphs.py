# SPDX-License-Identifier: Apache-2.0
"""Two whole graphs in two namespaces of one domain: neither hears anything of the other."""

from __future__ import annotations

import signal
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
import numpy as np
import pytest
from rcl_interfaces.srv import GetParameters
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from adaptive_blf_control.messages.command import read_command
from adaptive_blf_control.messages.joint_state import decode_joint_state
from adaptive_blf_control.messages.topics import COMMANDS, JOINT_STATES, THETA_HAT

NODES = ('identifier', 'controller', 'arm_driver')
RATES = {'left': 100, 'right': 40}  # Hz
LIMITS = {'left': 4.0, 'right': 9.0}  # N·m
JOINTS = {'left': ['shoulder', 'elbow'], 'right': ['joint1', 'joint2']}
FILE = """
/**: {{ros__parameters: {{arm: two_link, joints: [{joints}], rate: {rate}}}}}
/{side}/controller:
  ros__parameters: {{torque_limit: [{limit}], state_timeout: 2.0, safety: {{lower: [-50.0],
    upper: [50.0]}}}}
/{side}/arm_driver:
  ros__parameters: {{command_timeout: 2.0}}
"""


class _Side:
    """One graph as three processes, and what is heard in its namespace."""

    def __init__(self, side: str, processes: Any, peer: Any) -> None:
        self.side, self._peer = side, peer
        file = processes.folder / f'{side}.yaml'
        file.write_text(FILE.format(side=side, rate=float(RATES[side]), limit=LIMITS[side],
                                    joints=', '.join(JOINTS[side])), encoding='utf-8')
        self.processes = {kind: processes.start(
            kind, '--ros-args', '-r', f'__ns:=/{side}', '--params-file', str(file))
            for kind in NODES}
        self.commands, self.states, self.estimates = (
            peer.listen(kind, f'/{side}/{topic}') for kind, topic in (
                (Float64MultiArray, COMMANDS), (JointState, JOINT_STATES),
                (JointState, THETA_HAT)))

    def goes_on(self) -> Any:
        """Return whether twenty more commands were heard since now."""
        before = len(self.commands)

        def more() -> bool:
            ended = [kind for kind, each in self.processes.items()
                     if each.popen.poll() is not None]
            assert not ended, self.processes[ended[0]].text
            return len(self.commands) > before + 20

        return more

    def check(self) -> None:
        """Check that all that was heard is of this side."""
        for data, _ in list(self.commands):
            torque, source, _ = read_command(data)
            assert source.startswith(f'/{self.side}/controller#'.encode())
            assert np.abs(torque).max() <= LIMITS[self.side]
        records = [decode_joint_state(data) for data, _ in list(self.states)]
        assert {record.names for record in records} == {tuple(JOINTS[self.side])}
        period = round(1e9 / RATES[self.side])
        steps = np.diff([record.stamp_ns for record in records])
        assert not (steps % period).any()  # one driver: all on the grid of its rate
        assert (steps > 0).all()
        frames = {decode_joint_state(data).frame_id for data, _ in list(self.estimates)}
        assert len(frames) == 1
        assert frames.pop().startswith(f'/{self.side}/identifier#')

    def parameter(self, node: str, name: str) -> Any:
        """Return a parameter as its node has it."""
        answer = self._peer.call(GetParameters, f'/{self.side}/{node}/get_parameters',
                                 GetParameters.Request(names=[name]))
        return answer.values[0]


@pytest.fixture
def sides(processes, graph_of):
    """Return both graphs, started side by side, and all diagnostics."""
    peer = graph_of(processes.domain).peer()
    diagnostics = peer.listen(DiagnosticArray, '/diagnostics')
    return *(_Side(side, processes, peer) for side in RATES), diagnostics


def test_two_graphs_in_two_namespaces_do_not_hear_each_other(sides, wait_until) -> None:
    left, right, diagnostics = sides
    for side in (left, right):
        wait_until(lambda side=side: side.commands and side.estimates, f'motion of {side.side}')
    for side in (left, right):
        wait_until(side.goes_on(), f'more of {side.side}')
        side.check()
        assert list(side.parameter('controller', 'torque_limit').double_array_value) == [
            LIMITS[side.side]]
        assert side.parameter('arm_driver', 'rate').double_value == RATES[side.side]
    for kind in reversed(NODES):  # the end of one is nothing to the other
        assert left.processes[kind].signal(signal.SIGINT) == 0, left.processes[kind].text
    wait_until(right.goes_on(), 'the right one, alone')
    right.check()
    for data, _ in list(diagnostics):
        status = deserialize_message(data, DiagnosticArray).status[0]
        assert 'second publisher' not in status.message
        assert 'several publishers' not in status.message
        if status.hardware_id == 'right':
            assert status.level != DiagnosticStatus.ERROR, status
            values = {value.key: value.value for value in status.values}
            assert not [key for key in values if 'second publisher' in key], values
