# SPDX-License-Identifier: Apache-2.0
"""Facts about the obstacles that the controller node is told of."""

from __future__ import annotations

import pytest

pytest.importorskip('rclpy', reason='no ROS 2 here')

from contextlib import nullcontext
from types import SimpleNamespace

from rclpy.serialization import serialize_message
from visualization_msgs.msg import Marker, MarkerArray

from adaptive_blf_control.configuration.node_settings import ControllerNodeSettings
from adaptive_blf_control.nodes.obstacle_input import ObstacleInput


class Told:
    """Stands for the loop of a node and its motion: what arrives there, and what is refused."""

    def __init__(self, safety_filter='limits'):
        self.seen, self.dropped = [], []
        self.settings = ControllerNodeSettings(safety_filter=safety_filter)
        self.faults = SimpleNamespace(drop=lambda reason, text: self.dropped.append(text))
        self.between_samples = nullcontext()

    def see(self, seen, gone):
        self.seen.append((dict(seen), gone))


def marker(number, action=Marker.ADD, frame='base_link', size=0.2):
    made = Marker(ns='cart', id=number, type=Marker.SPHERE, action=action)
    made.header.frame_id = frame
    made.pose.orientation.w = 1.0
    made.scale.x = made.scale.y = made.scale.z = size
    return made


def send(told, *markers):
    ObstacleInput(told, told).receive(bytes(serialize_message(MarkerArray(markers=list(markers)))))


def test_obstacles_arrive_by_their_key_and_go_by_it():
    told = Told()
    send(told, marker(1), marker(2), marker(3, Marker.DELETE))
    seen, gone = told.seen[0]
    assert set(seen) == {('cart', 1), ('cart', 2)}
    assert gone == {('cart', 3)}
    send(told, marker(9), marker(0, Marker.DELETEALL), marker(1))
    seen, gone = told.seen[1]
    assert set(seen) == {('cart', 1)}
    assert gone is None
    assert told.dropped == []


@pytest.mark.parametrize(('wrong', 'said'), [
    (marker(2, frame='camera'), "expected 'base_link'"), (marker(2, size=float('nan')), 'finite'),
    (marker(2, action=7), 'action 7'), (marker(2, size=-0.1), 'lengths > 0')])
def test_one_marker_that_cannot_be_used_refuses_its_whole_message(wrong, said):
    told = Told()
    send(told, marker(1), wrong)
    assert told.seen == []
    assert said in told.dropped[0]


def test_without_a_safety_filter_obstacles_are_refused_and_it_is_said():
    told = Told('none')
    send(told, marker(1))
    assert told.seen == []
    assert 'nothing keeps away from them' in told.dropped[0]
