# SPDX-License-Identifier: Apache-2.0
"""Facts about obstacles that come: the reference gives way to them."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.arms.chain import Chain
from adaptive_blf_control.limits.evasion import evasion_of, gives_way
from adaptive_blf_control.limits.link_spheres import LinkSpheres
from adaptive_blf_control.limits.obstacles import joined, sphere
from adaptive_blf_control.limits.quadratic_program import solve
from adaptive_blf_control.limits.scene import scene_with

DT = 0.002
MOST = np.array([8.0, 8.0])


def plane(reach=0.4):
    """Return a chain of two links in the plane z = 0, and a sphere at the end of each."""
    turned = np.eye(3, 4)
    along = turned.copy()
    along[0, 3] = reach
    chain = Chain(np.stack([turned, along]), np.array([[0.0, 0.0, 1.0]] * 2),
                  np.zeros(2, dtype=bool), np.arange(2), np.arange(2), np.zeros(3))
    ends = np.array([[reach, 0.0, 0.0]] * 2)
    return chain, LinkSpheres(np.array([1, 2]), ends, np.full(2, 0.05))


def scene(*obstacles):
    chain, spheres = plane()
    return scene_with(chain, spheres, joined(obstacles), np.empty((0, 2), dtype=np.int64))


def evading(parts, y, yd, wanted):
    """Return the nearest acceleration within ±MOST that keeps the rows, as far as one does."""
    evasion = evasion_of(parts, y, yd, wanted, 0.4)
    if gives_way(evasion, wanted):
        return wanted
    unit, count = np.eye(2), evasion.bounds.size
    rows = np.concatenate([unit, -unit, evasion.rows])
    bounds = np.concatenate([-MOST, -MOST, evasion.bounds])
    softness = np.concatenate([np.zeros(4), np.full(count, 1e-6)])
    return solve(unit, wanted, rows, bounds, softness, np.empty(4 + count))[0]


def gap_beside(speed, gives_way=True):
    """Return how near a sphere comes that moves through an arm which wants to stand."""
    y, yd, least = np.array([0.3, 0.4]), np.zeros(2), np.inf
    chain, spheres = plane()
    for k in range(int(1.2 / speed / DT)):
        centre = [0.6, -0.4 + speed * k * DT, 0.0]
        parts = scene(sphere(centre, 0.08, [0.0, speed, 0.0]))
        wanted = np.clip(-20.0 * yd, -MOST, MOST)
        a = evading(parts, y, yd, wanted) if gives_way else wanted
        y, yd = y + DT * yd + 0.5 * DT * DT * a, yd + DT * a
        first = 0.4 * np.array([np.cos(y[0]), np.sin(y[0])])
        second = first + 0.4 * np.array([np.cos(y.sum()), np.sin(y.sum())])
        least = min(least, *(np.linalg.norm(end - centre[:2]) - 0.13 for end in (first, second)))
    return least


def test_an_arm_that_stands_gives_way_to_what_comes():
    assert gap_beside(0.2, gives_way=False) < -0.03
    for speed in (0.1, 0.3):
        assert gap_beside(speed) > 0.0


def test_what_comes_faster_is_kept_farther_away():
    y, wanted = np.array([0.3, 0.4]), np.zeros(2)
    end = 0.4 * np.array([np.cos(0.3) + np.cos(0.7), np.sin(0.3) + np.sin(0.7)])
    for speed in (0.1, 0.4):
        for part in (1.1, 0.9):  # of (T + 2 / alpha) v = 0.8 v
            gap = 0.13 + part * 0.8 * speed
            parts = scene(sphere([end[0], end[1] - gap, 0.0], 0.08, [0.0, speed, 0.0]))
            a = evading(parts, y, np.zeros(2), wanted)
            assert np.any(a != 0.0) == (part < 1.0)


def test_what_stands_or_goes_away_changes_nothing():
    y, wanted = np.array([0.3, 0.4]), np.array([1.0, -2.0])
    for velocity in ([0.0, 0.0, 0.0], [0.0, -0.5, 0.0]):
        parts = scene(sphere([0.6, 0.0, 0.0], 0.05, velocity))
        a = evading(parts, y, np.zeros(2), wanted)
        assert np.array_equal(a, wanted)


def test_between_two_that_come_the_acceleration_stays_within_its_bounds():
    y = np.array([0.3, 0.4])
    end = [0.4 * (np.cos(0.3) + np.cos(0.7)), 0.4 * (np.sin(0.3) + np.sin(0.7)), 0.0]
    parts = scene(sphere([end[0], end[1] + 0.15, 0.0], 0.05, [0.0, -0.5, 0.0]),
                  sphere([end[0], end[1] - 0.15, 0.0], 0.05, [0.0, 0.5, 0.0]))
    a = evading(parts, y, np.zeros(2), np.array([20.0, -20.0]))
    assert np.isfinite(a).all()
    assert (np.abs(a) <= MOST).all()


def test_pairs_with_what_moves_are_apart_from_those_with_what_stands():
    stands, comes = sphere([0.6, 0.0, 0.0], 0.05), sphere([0.0, 0.6, 0.0], 0.05, [0.0, 0.1, 0.0])
    chain, spheres = plane()
    own = np.array([(1, -1)])
    parts = scene_with(chain, spheres, joined([comes, stands]), own)
    np.testing.assert_array_equal(parts.pairs, [(0, 1), (1, 1), *own])
    np.testing.assert_array_equal(parts.coming, [(0, 0), (1, 0)])


def test_of_many_that_come_the_rows_that_are_the_nearest_to_be_broken_count():
    y, at_rest = np.array([0.3, 0.4]), np.zeros(2)
    end = 0.4 * np.array([np.cos(0.3) + np.cos(0.7), np.sin(0.3) + np.sin(0.7)])
    gaps = 0.2 + 0.1 * np.random.default_rng(0).permutation(12)
    parts = scene(*(sphere([end[0], end[1] - gap, 0.0], 0.08, [0.0, 0.2, 0.0]) for gap in gaps))
    evasion = evasion_of(parts, y, at_rest, np.zeros(2), 0.4)
    alone = evasion_of(scene(sphere([end[0], end[1] - 0.2, 0.0], 0.08, [0.0, 0.2, 0.0])), y,
                       at_rest, np.zeros(2), 0.4)
    assert evasion.bounds.size == 8
    assert evasion.bounds.max() == alone.bounds.max()
    assert evasion.clearance == alone.clearance
