# SPDX-License-Identifier: Apache-2.0
"""Facts about obstacles that move: how fast, until when, and what of them is refused."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.control.limit_settings import ObstacleSettings
from adaptive_blf_control.limits.moving_obstacles import MovingObstacles
from adaptive_blf_control.limits.obstacles import sphere


def moving_obstacles(speed, timeout, least_speed=0.02):
    return MovingObstacles(ObstacleSettings(speed=speed, timeout=timeout,
                                            least_speed=least_speed))


def test_the_velocity_is_that_between_two_sights_and_carries_them_on():
    moving = moving_obstacles(2.0, 0.5)
    moving.update(1.0, {'a': sphere([0.0, 0.0, 1.0], 0.1)})
    assert not moving.at(1.0).velocity.any()
    moving.update(1.1, {'a': sphere([0.1, 0.0, 1.0], 0.1), 'b': sphere([5.0, 0.0, 0.0], 0.2)})
    there = moving.at(1.3)
    np.testing.assert_allclose(there.velocity, [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]], atol=1e-12)
    np.testing.assert_allclose(there.centre, [[0.3, 0.0, 1.0], [5.0, 0.0, 0.0]], atol=1e-12)


def test_what_a_camera_sees_of_things_that_stand_stands_and_what_moves_moves_steadily():
    random, speeds, found = np.random.default_rng(0), (0.0, 0.1), {0.0: [], 0.1: []}
    moving = moving_obstacles(2.0, 0.5)
    for k in range(300):
        t = k / 30.0
        moving.update(t, {speed: sphere([*random.normal([speed * t, 0.0], 0.001), 1.0], 0.1)
                          for speed in speeds})
        if k > 10:
            for speed, velocity in zip(speeds, moving.at(t).velocity):
                found[speed].append(velocity)
    assert np.mean(np.any(found[0.0], axis=1)) < 0.02
    np.testing.assert_allclose(np.mean(found[0.1], axis=0), [0.1, 0.0, 0.0], atol=2e-3)
    # Between the two last messages it would be 0.042 m/s.
    assert np.std(found[0.1], axis=0).max() < 0.01


def test_a_velocity_is_of_the_last_fifth_of_a_second():
    moving, x = moving_obstacles(2.0, 0.5), 0.0
    for k in range(40):
        x += 0.01 if k < 20 else -0.02
        moving.update(0.05 * k, {'a': sphere([x, 0.0, 1.0], 0.1)})
        if k in (19, 24):
            np.testing.assert_allclose(moving.at(0.05 * k).velocity[0, 0],
                                       0.2 if k == 19 else -0.4, atol=1e-12)


def test_an_obstacle_is_taken_to_be_no_faster_than_stated():
    moving = moving_obstacles(0.5, 0.5)
    moving.update(1.0, {'a': sphere([0.0, 0.0, 1.0], 0.1)})
    moving.update(1.1, {'a': sphere([0.0, 3.0, 1.0], 0.1)})
    np.testing.assert_allclose(moving.at(1.1).velocity, [[0.0, 0.5, 0.0]], atol=1e-12)


def test_after_the_timeout_they_stand_where_they_were_seen_and_it_is_said():
    moving = moving_obstacles(2.0, 0.5)
    assert not moving.silent(100.0)  # nothing is known
    moving.update(1.0, {'a': sphere([0.0, 0.0, 1.0], 0.1)})
    moving.update(1.1, {'a': sphere([0.1, 0.0, 1.0], 0.1)})
    assert not moving.silent(1.6)
    assert moving.silent(1.61)
    assert moving.silent(0.4)  # a clock that was set back says nothing of how long that is
    assert moving.at(1.61).centre.tolist() == [[0.1, 0.0, 1.0]]
    assert not moving.at(1.61).velocity.any()
    moving.update(1.7, {}, gone=frozenset(['a']))
    assert not moving.silent(9.0)
    assert moving.at(9.0).radius.size == 0


def test_all_can_be_taken_away_at_once():
    moving = moving_obstacles(2.0, 0.5)
    moving.update(1.0, {k: sphere([0.0, 0.0, 1.0], 0.1) for k in range(3)})
    moving.update(1.1, {7: sphere([0.0, 0.0, 2.0], 0.1)}, gone=None)
    assert moving.at(1.1).centre.tolist() == [[0.0, 0.0, 2.0]]


def test_a_marker_that_cannot_be_used_is_refused_with_what_is_expected():
    pytest.importorskip('rclpy', reason='no ROS 2 here')
    from adaptive_blf_control.errors import BagError
    from adaptive_blf_control.messages.marker_reader import Marker
    from adaptive_blf_control.nodes.obstacle_input import obstacle_of

    good = Marker(0, '/base_link', 'cart', 4, 2, 0, (0.1, 0.2, 0.3), (0.0, 0.0, 0.0, 1.0),
                  (0.2, 0.2, 0.2))
    assert obstacle_of(good, 'base_link').radius.tolist() == [0.1]
    for change, said in (({'frame': 'camera'}, "frame 'camera': expected 'base_link'"),
                         ({'position': (0.0, float('nan'), 0.0)}, 'expected finite numbers'),
                         ({'scale': (0.2, 0.0, 0.2)}, 'lengths > 0 m'),
                         ({'type': 9}, 'type 9.*cube'),
                         ({'type': 1, 'orientation': (0.0, 0.0, 0.0, 0.0)}, 'length 1')):
        with pytest.raises(BagError, match=said):
            obstacle_of(good._replace(**change), 'base_link')


def test_a_cylinder_is_inside_its_obstacle():
    pytest.importorskip('rclpy', reason='no ROS 2 here')
    from adaptive_blf_control.limits.obstacles import distance
    from adaptive_blf_control.messages.marker_reader import Marker
    from adaptive_blf_control.nodes.obstacle_input import obstacle_of

    turned = (np.sin(0.4), 0.0, 0.0, np.cos(0.4))  # about x by 0.8 rad
    found = obstacle_of(Marker(0, 'base_link', '', 0, 3, 0, (1.0, 0.0, 0.5), turned,
                               (0.2, 0.2, 0.6)), 'base_link')
    axis = np.array([0.0, -np.sin(0.8), np.cos(0.8)])
    across = np.array([1.0, 0.0, 0.0])
    for along in (-0.3, 0.0, 0.3):
        rim = np.array([1.0, 0.0, 0.5]) + along * axis + 0.1 * across
        assert distance(found, 0, rim, np.empty(3)) <= 1e-12
    assert distance(found, 0, np.array([1.0, 0.0, 0.5]) + 0.45 * axis, np.empty(3)) > 0.0
