# SPDX-License-Identifier: Apache-2.0
"""One controller at a time, by the names of those that DDS has only just discovered."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import time

import numpy as np
import pytest
from rclpy.context import Context
from rclpy.node import Node, NodeNameNonExistentError
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Float64MultiArray

from adaptive_blf_control.control.ramp import RAMP_STEP
from adaptive_blf_control.errors import BlfError
from adaptive_blf_control.messages.topics import COMMANDS
from adaptive_blf_control.nodes.command_topic import CommandTopic, KNOWN
from adaptive_blf_control.nodes.controller import ControllerNode
from patience import PATIENCE

# DDS is ahead of a node's name in one of three tries.
TRIES = 8


@pytest.fixture
def controller(graph) -> ControllerNode:
    """Return a controller that is inactive."""
    return graph.make(ControllerNode, initial_estimate=[1.0])


@pytest.fixture
def commands(controller) -> CommandTopic:
    """Return its command topic."""
    return controller.commands


def endpoints(of: ControllerNode, known_to: Node) -> list[list[tuple[str, list[str]]]]:
    """Return the publishers, subscriptions and services of a node that another one knows."""
    asks = (known_to.get_publisher_names_and_types_by_node,
            known_to.get_subscriber_names_and_types_by_node,
            known_to.get_service_names_and_types_by_node)
    try:
        return [sorted(ask(of.get_name(), of.get_namespace())) for ask in asks]
    except NodeNameNonExistentError:
        return []


@pytest.fixture
def newcomer(graph, controller, wait_until) -> Iterator[Callable[[str], Node]]:
    """Return ``newcomer(name)``: a node that is a DDS participant; the last one ends before."""
    running: list[tuple[Context, Node]] = []

    def end() -> None:
        for context, node in running:
            # Fast DDS 2.14 waits for ever where a participant ends that just discovers something.
            wait_until(lambda new=node: endpoints(controller, new) == endpoints(
                controller, controller), what='all of the controller')
            node.destroy_node()
            context.try_shutdown()
        running.clear()

    def start(name: str) -> Node:
        end()
        context = Context()
        context.init(domain_id=graph.context.get_domain_id())
        node = Node(name, context=context, enable_rosout=False, start_parameter_services=False)
        running.append((context, node))
        return node

    yield start
    end()


def test_a_refused_claim_names_the_other_however_early_it_is_made(
        commands, newcomer, wait_until) -> None:
    for _ in range(TRIES):
        newcomer('first').create_publisher(Float64MultiArray, COMMANDS, 10)
        give_up = time.monotonic() + PATIENCE
        while not len(commands.senders) and time.monotonic() < give_up:
            pass  # without a pause: the moment in which the name is not known is short
        with pytest.raises(BlfError, match=f'^/{COMMANDS}: /first sends commands already'):
            commands.claim()
        assert not commands.claimed
    newcomer('last')
    wait_until(lambda: not len(commands.senders), what='the end of the other')
    commands.claim()
    assert commands.claimed


def test_a_recorder_does_not_count_as_an_arm_before_its_name_is_known(
        commands, newcomer, wait_until) -> None:
    for _ in range(TRIES):
        recorder = newcomer('recorder')
        recorder.create_subscription(Float64MultiArray, COMMANDS, lambda _: None, 10)
        known = False
        give_up = time.monotonic() + PATIENCE
        while not known and time.monotonic() < give_up:
            assert not commands.someone_drives()
            known = '/recorder' in commands.listeners.names()
        assert known
    newcomer('arm').create_subscription(Float64MultiArray, COMMANDS, lambda _: None, 10)
    wait_until(commands.someone_drives, what='an arm')


def test_a_listener_that_the_publisher_has_not_found_has_not_confirmed(
        commands, newcomer, graph, wait_until) -> None:
    # It asks for more than the publisher offers: it is shown, and never found.
    newcomer('arm').create_subscription(Float64MultiArray, COMMANDS, lambda _: None, QoSProfile(
        depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL))
    graph.peer().listen(Float64MultiArray, COMMANDS)
    wait_until(lambda: len(commands.listeners) == 2 and commands.someone_drives())
    commands.claim()
    wait_until(lambda: commands.heard, what='one that hears')

    def judged() -> bool:
        commands.send(np.ones(2))
        return commands.unheard() or commands.confirmed

    wait_until(judged)
    assert not commands.confirmed


def test_torques_of_a_ramp_say_nothing_of_how_long_one_takes_to_compute(commands) -> None:
    torque, unlimited = np.ones(2), np.full(2, np.inf)
    commands.claim()
    commands.interval()
    time.sleep(0.1)  # the first torque of a process takes long
    commands.send(torque)
    commands.ramp_down(torque, 2.0 * KNOWN * RAMP_STEP, unlimited)
    before = time.monotonic()
    commands.send(torque)
    interval = commands.interval()
    assert interval <= time.monotonic() - before
