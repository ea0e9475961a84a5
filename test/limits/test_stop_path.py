# SPDX-License-Identifier: Apache-2.0
"""Facts about stops: no posture on the way is nearer to an obstacle than was said."""

from __future__ import annotations

from hypothesis import given, settings, strategies as st
import numpy as np
import pytest

from adaptive_blf_control.arms.chain import Chain, chain_of_model
from adaptive_blf_control.arms.urdf_model import reduced_model
from adaptive_blf_control.arms.urdf_source import read_urdf
from adaptive_blf_control.limits.filter_look import JointLimits
from adaptive_blf_control.limits.filter_step import narrowed
from adaptive_blf_control.limits.link_spheres import LinkSpheres, sphere_centres
from adaptive_blf_control.limits.obstacles import (
    box,
    capsule,
    distance,
    half_space,
    joined,
    sphere,
)
from adaptive_blf_control.limits.scene import link_spheres_along
from adaptive_blf_control.limits.stop_clearance import stop_clearances
from adaptive_blf_control.limits.stop_path import (
    GROWTH,
    held_by_limits,
    kept_to,
    PIECES,
    stop_path,
)
from adaptive_blf_control.limits.viability import acceleration_bounds

OBSTACLES = joined([
    sphere([0.5, 0.1, 0.5], 0.1), capsule([0.3, -0.4, 0.2], [0.4, 0.5, 0.9], 0.05),
    box([-0.3, 0.3, 0.6], [0.2, 0.3, 0.4]), half_space([0.0, 0.0, 0.1], [0.0, 0.0, 1.0])])


@pytest.fixture(scope='module')
def chain():
    model, joints = reduced_model(read_urdf('package://panda_description/urdf/panda.urdf', ()),
                                  [f'panda_joint{i}' for i in range(1, 8)])
    return chain_of_model(model, joints)


H = 1e-3
BRAKING = np.array([2.0, 2.0, 3.0, 3.0, 4.0, 4.0, 9.0])
NONE = np.zeros(7)


# Two joints that slide, along x and then along y, and a sphere of 10 mm on the second.
TABLE = Chain(np.broadcast_to(np.eye(3, 4), (2, 3, 4)).copy(), np.eye(3)[:2].copy(),
              np.array([True, True]), np.arange(2), np.arange(2), np.zeros(3))
BALL = LinkSpheres(np.array([2]), np.zeros((1, 3)), np.array([0.01]))


def found_on(chain, spheres, q, qd, a, error=NONE, obstacles=OBSTACLES, pairs=None,
             braking=BRAKING):
    if pairs is None:
        pairs = np.array([(s, k) for s in range(spheres.body.size)
                          for k in range(obstacles.radius.size)])
    found, now = np.empty(len(pairs)), np.empty(len(pairs))
    gradients = np.empty((len(pairs), q.size))
    path = stop_path(qd, a, error, braking, H, np.zeros(q.size, dtype=bool))
    stop_clearances(chain, spheres, obstacles, pairs, q, path, found, now, gradients)
    return found, now, gradients


def stops(random, q, qd, a, error=NONE, braking=BRAKING, limits=None):
    """Yield postures on the way to a stand, each sample off by part or all of the error.

    After the first sample the error is up to twice as large. Where there are limits, accelerations
    are what these allow.
    """
    nominal, speed = q.copy(), qd.copy()
    q, qd = q.copy(), qd.copy()
    always, grown = random.choice([-1.0, 1.0], q.size), error
    while True:
        wrong = grown * (always if random.random() < 0.7 else random.uniform(-1.0, 1.0, q.size))
        off = kept_to(a, nominal, speed, q, qd, grown, H)
        if limits is not None:
            off = np.clip(off, *narrowed(*acceleration_bounds(q, qd, *limits, H), grown))
        off = off + wrong
        for part in (0.5, 1.0):
            yield q + part * H * (qd + 0.5 * part * H * off)
        q, qd = q + H * (qd + 0.5 * H * off), qd + H * off
        nominal, speed = nominal + H * (speed + 0.5 * H * a), speed + H * a
        if not speed.any():
            return
        a = np.clip(-speed / H, -braking, braking)
        grown = GROWTH * error if random.random() < 0.5 else error


def true_clearances(chain, spheres, q):
    normal = np.empty(3)
    return np.array([distance(OBSTACLES, k, p, normal) - r
                     for p, r in zip(sphere_centres(chain, spheres, q), spheres.radius)
                     for k in range(OBSTACLES.radius.size)])


@pytest.mark.parametrize('speed', [0.05, 0.5, 2.0])
def test_no_posture_of_a_stop_is_nearer_than_the_bound(chain, speed):
    random, spheres = np.random.default_rng(0), link_spheres_along(chain, 0.08)
    closest, looked_at = np.inf, 0
    for _ in range(8):
        q, qd = random.uniform(-2.0, 2.0, 7), speed * random.uniform(-1.0, 1.0, 7)
        a, error = random.uniform(-20.0, 20.0, 7), random.uniform(0.0, 2.0, 7)
        found, now, gradients = found_on(chain, spheres, q, qd, a, error)
        np.testing.assert_allclose(now, true_clearances(chain, spheres, q), atol=1e-12)
        # Only those whose path was looked at piece by piece promise to be tight.
        tight = found < 0.05
        looked_at += tight.sum()
        least = np.full(found.shape, np.inf)
        for posture in list(stops(random, q, qd, a, error))[::5]:
            least = np.minimum(least, true_clearances(chain, spheres, posture))
        assert (least - found).min() > -1e-12
        closest = min(closest, (least - found)[tight].min(initial=np.inf))
    assert looked_at > 8
    assert closest < 0.005  # no empty promise


def test_the_way_of_a_link_that_turns_bulges_beyond_its_straight_line():
    chain = Chain(np.eye(3, 4)[None].copy(), np.array([[0.0, 0.0, 1.0]]), np.zeros(1, dtype=bool),
                  np.zeros(1, dtype=np.intp), np.arange(1), np.zeros(3))
    spheres = LinkSpheres(np.array([1]), np.array([[0.8, 0.0, 0.0]]), np.full(1, 0.01))
    still, braking = np.zeros(1), np.full(1, 2.0)
    # It turns by 4 rad until it stands, and comes 5 mm near to each of these walls.
    ways = [np.array([np.cos(x), np.sin(x), 0.0]) for x in np.linspace(0.0, 4.0, 81)]
    walls = joined([half_space(0.815 * way, -way) for way in ways])
    found, _, _ = found_on(chain, spheres, still, np.full(1, 4.0), -braking, still, walls,
                           braking=braking)
    assert found.max() <= 0.005 + 1e-9
    assert found.min() > -0.4


def test_the_gradient_is_that_of_the_bound(chain):
    random, spheres = np.random.default_rng(1), link_spheres_along(chain, 0.08)
    compared = 0
    for _ in range(20):
        q, qd = random.uniform(-2.0, 2.0, 7), random.uniform(-0.5, 0.5, 7)
        found, _, gradients = found_on(chain, spheres, q, qd, NONE)
        for j in range(7):
            up, down = (found_on(chain, spheres, q, qd, sign * 0.1 * np.eye(7)[j])[0]
                        for sign in (1.0, -1.0))
            change = (up - down) / 0.2
            # Where the least is at the begin of the path no acceleration changes it.
            moves = (np.abs(gradients[:, j]) > 1e-5) & (np.abs(change) > 1e-5)
            compared += moves.sum()
            np.testing.assert_allclose(change[moves], gradients[moves, j], rtol=0.3, atol=2e-5)
    assert compared > 50


def test_two_spheres_of_links_count_as_they_come_together(chain):
    random, spheres = np.random.default_rng(3), link_spheres_along(chain, 0.08)
    pairs = np.array([(spheres.body.size - 1, -1 - s) for s in range(3)])
    closest = np.inf
    for _ in range(20):
        q, qd = random.uniform(-2.0, 2.0, 7), random.uniform(-1.0, 1.0, 7)
        found, _, _ = found_on(chain, spheres, q, qd, NONE, pairs=pairs)
        for posture in list(stops(random, q, qd, NONE))[::20]:
            points = sphere_centres(chain, spheres, posture)
            apart = np.array([np.linalg.norm(points[s] - points[-1 - k]) - 0.16
                              for s, k in pairs])
            assert (apart - found).min() > -1e-12
            closest = min(closest, (apart - found)[found < 0.05].min(initial=np.inf))
    assert closest < 0.01


def off_the_line(path, t, postures, joint):
    """Return how far a joint is from the straight line of a piece, and how far it may be.

    Args:
        path: A stop path.
        t: Time, shape (N,) [s].
        postures: Shape (N, n) [rad].
        joint: Which of them.

    Returns:
        Both of shape (N,) [rad].
    """
    piece = np.clip(np.searchsorted(path.time, t, side='right') - 1, 0, PIECES - 1)
    part = np.minimum((t - path.time[piece]) / (path.time[piece + 1] - path.time[piece]), 1.0)
    begin, end = path.shift[piece, joint], path.shift[piece + 1, joint]
    off = postures[:, joint] - begin - part * (end - begin)
    room = 4.0 * part * (1.0 - part) * path.bend[piece, joint] + path.spread[piece + 1, joint]
    return np.abs(off), room


@pytest.mark.parametrize('near', [False, True])
def test_who_keeps_to_a_stop_is_within_its_spread(near):
    random, seen, most = np.random.default_rng(2), np.zeros(2, dtype=int), 0.0
    far = np.full(7, 9.0)
    for _ in range(50):
        q, error = np.zeros(7), random.uniform(0.0, 20.0, 7)
        qd, braking = random.uniform(-2.0, 2.0, 7), BRAKING * random.uniform(0.5, 2.0, 7)
        limits = JointLimits(-far, far, far, braking)
        if near:  # of limits that the stop, and a sample that goes wrong before it, just keeps
            fast = np.abs(qd) + random.uniform(0.5, 6.0, 7) * error * H
            room = 0.5 * fast ** 2 / braking + random.uniform(1.0, 20.0, 7) * error * H ** 2
            limits = JointLimits(-room, room, fast, braking)
        low, high = narrowed(*acceleration_bounds(q, qd, *limits, H), error)
        a = np.clip(random.uniform(-20.0, 20.0, 7), low, high)
        held = held_by_limits(q, qd, a, error, *limits, H)
        seen += [(~held).sum(), held.sum()]
        path = stop_path(qd, a, error, braking, H, held)
        postures = np.array(list(stops(random, q, qd, a, error, braking, limits)))
        t = 0.5 * H * np.arange(1, len(postures) + 1)
        for joint in range(7):
            off, room = off_the_line(path, t, postures, joint)
            assert (off <= room + 1e-12).all()
        last = np.abs(postures[-1] - path.shift[-1]) / path.spread[-1]
        assert (last <= 1.0 + 1e-9).all()
        most = max(most, last.max())
    assert (seen[int(near)] > 100)
    assert most > 0.5


@settings(max_examples=200, deadline=None)
@given(st.lists(st.tuples(st.floats(-3.0, 3.0), st.floats(0.1, 20.0), st.floats(-40.0, 40.0)),
                min_size=1, max_size=4))
def test_no_joint_is_off_the_line_by_more_than_its_bend(joints):
    qd, braking, a = np.array(joints).T.copy()
    n = qd.size
    path = stop_path(qd, a, np.zeros(n), braking, H, np.zeros(n, dtype=bool))
    if not H < path.time[-1] < 3.0:  # all stand after the sample, or one takes very long
        return
    postures = np.array(list(stops(np.random.default_rng(0), np.zeros(n), qd, a, np.zeros(n),
                                   braking)))
    t = 0.5 * H * np.arange(1, len(postures) + 1)
    for joint in range(n):
        off, room = off_the_line(path, t, postures, joint)
        assert (off <= room + 1e-12).all()


def test_a_joint_that_stands_has_no_bend_but_that_of_a_sample():
    braking = np.array([1.0, 10.0, 10.0])
    path = stop_path(np.array([1.0, 0.0, 0.5]), np.zeros(3), np.zeros(3), braking, H,
                     np.zeros(3, dtype=bool))
    assert path.bend[:, 0].min() > 0.99 * 0.125 * (1.0 / PIECES) ** 2
    assert path.bend[0, 1] < 0.3 * 10.0 * H / PIECES
    assert (path.bend[1:, 1:] == 0.0).all()  # the third stops in the first piece
    # A quarter of what a stop of the whole piece has: it stands after 0.3 of it.
    assert 0.2 < path.bend[0, 2] / (0.125 * 10.0 / PIECES ** 2) < 0.6


class Always:
    """In place of a random generator: errors of one sign."""

    def __init__(self, sign):
        self.sign = sign

    def choice(self, ends, n):
        return np.full(n, self.sign)

    def random(self):
        return 0.0


def least_on_a_table(q, qd, braking, obstacle, error):
    """Return what is found, and the least clearance of a stop that goes wrong one way."""
    found = found_on(TABLE, BALL, q, qd, np.zeros(2), error, obstacle, braking=braking)[0][0]
    normal, least = np.empty(3), np.inf
    for sign in (-1.0, 1.0):
        always = Always(sign)
        for posture in stops(always, q, qd, np.zeros(2), error, braking):
            least = min(least, distance(obstacle, 0, np.array([*posture, 0.0]), normal) - 0.01)
    return found, least


def test_the_bend_of_a_joint_that_stops_early_decides_what_is_free():
    # y stops within half of the first sixth of the way of x: the way has a knee, 3 mm off
    # the line.
    qd, braking = np.array([0.12, 0.24]), np.array([0.2, 6.0])
    for side in (-1.0, 1.0):
        knee = joined([sphere([0.0, side * 0.0212, 0.0], 0.01)])
        found, least = least_on_a_table(np.array([-0.007, 0.0]), side * qd * [side, 1.0], braking,
                                        knee, np.zeros(2))
        assert found <= least
        assert least < found + 0.004


def test_the_error_of_a_joint_that_stands_decides_what_is_free_beside_it():
    # x slides along a wall, and y, which stands, is pushed towards it all the time.
    braking, qd, error = np.array([0.1, 2.0]), np.array([0.1, 0.0]), np.array([0.0, 100.0])
    wall = joined([half_space([0.0, -0.012, 0.0], [0.0, 1.0, 0.0])])
    found, least = least_on_a_table(np.zeros(2), qd, braking, wall, error)
    assert least < 0.002 - 7e-4
    assert found <= least
    assert least < found + 6e-4


def test_a_joint_that_its_own_limit_holds_back_is_farther_from_its_stop():
    still, qd, far = np.zeros(1), np.ones(1), np.full(1, 9.0)
    a, error, braking = np.zeros(1), np.ones(1), np.full(1, 2.0)
    for upper, speed, is_held in ((9.0, 9.0, False), (0.252, 9.0, True), (9.0, 1.003, True),
                                  (0.3, 1.05, False)):
        held = held_by_limits(still, qd, a, error, -far, np.full(1, upper), np.full(1, speed),
                              braking, H)
        assert held.tolist() == [is_held]
        spread = stop_path(qd, a, error, braking, H, held).spread[-1, 0]
        assert (spread > 1e-3) == is_held
    back = held_by_limits(still, -qd, a, error, np.full(1, -0.252), far, far, braking, H)
    assert back.tolist() == [True]
