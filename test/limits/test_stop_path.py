# SPDX-License-Identifier: Apache-2.0
"""Facts about stops: no posture on the way is nearer to an obstacle than was said."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.arms.chain import chain_of_model
from adaptive_blf_control.arms.urdf_model import reduced_model
from adaptive_blf_control.arms.urdf_source import read_urdf
from adaptive_blf_control.limits.link_spheres import sphere_centres
from adaptive_blf_control.limits.obstacles import (
    box,
    capsule,
    distance,
    half_space,
    joined,
    sphere,
)
from adaptive_blf_control.limits.scene import link_spheres_along
from adaptive_blf_control.limits.stop_path import kept_to, stop_clearances, stop_path

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


def found_on(chain, spheres, q, qd, a, error=NONE, obstacles=OBSTACLES, pairs=None):
    if pairs is None:
        pairs = np.array([(s, k) for s in range(spheres.body.size)
                          for k in range(obstacles.radius.size)])
    found, now = np.empty(len(pairs)), np.empty(len(pairs))
    gradients = np.empty((len(pairs), q.size))
    path = stop_path(qd, a, error, BRAKING, H)
    stop_clearances(chain, spheres, obstacles, pairs, q, path, found, now, gradients)
    return found, now, gradients


def stops(random, q, qd, a, error=NONE):
    """Yield postures on the way to a stand, each sample off by part or all of the error."""
    nominal, speed = q.copy(), qd.copy()
    q, qd = q.copy(), qd.copy()
    always = random.choice([-1.0, 1.0], q.size)
    while True:
        wrong = error * (always if random.random() < 0.7 else random.uniform(-1.0, 1.0, q.size))
        off = kept_to(a, nominal, speed, q, qd, error, H) + wrong
        for part in (0.5, 1.0):
            yield q + part * H * (qd + 0.5 * part * H * off)
        q, qd = q + H * (qd + 0.5 * H * off), qd + H * off
        nominal, speed = nominal + H * (speed + 0.5 * H * a), speed + H * a
        if not speed.any():
            return
        a = np.clip(-speed / H, -BRAKING, BRAKING)


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


def test_an_obstacle_that_moves_counts_where_it_will_be(chain):
    spheres = link_spheres_along(chain, 0.08)
    rolling = np.array([0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    place = sphere_centres(chain, spheres, NONE)[-1] + [0.24, 0.0, 0.0]
    still = found_on(chain, spheres, NONE, rolling, NONE,
                     obstacles=joined([sphere(place, 0.1)]))[0]
    coming = found_on(chain, spheres, NONE, rolling, NONE,
                      obstacles=joined([sphere(place, 0.1, (-0.2, 0.0, 0.0))]))[0]
    leaving = found_on(chain, spheres, NONE, rolling, NONE,
                       obstacles=joined([sphere(place, 0.1, (0.2, 0.0, 0.0))]))[0]
    # It moves for the quarter of a second that joint 1 takes to stand.
    assert still[-1] - 0.06 < coming[-1] < still[-1] - 0.03
    assert leaving[-1] >= still[-1] - 1e-3


def test_who_keeps_to_a_stop_is_within_its_spread():
    random = np.random.default_rng(2)
    for _ in range(100):
        q, qd = np.zeros(7), random.uniform(-2.0, 2.0, 7)
        a, error = random.uniform(-20.0, 20.0, 7), random.uniform(0.0, 2.0, 7)
        path = stop_path(qd, a, error, BRAKING, H)
        for k, posture in enumerate(stops(random, q, qd, a, error)):
            t = 0.5 * (k + 1) * H
            if t >= path.time[1]:
                at = [np.interp(t, path.time, path.shift[:, j]) for j in range(7)]
                room = path.bend + path.spread[np.searchsorted(path.time, min(t, path.time[-1]))]
                assert (np.abs(posture - at) <= room + 1e-12).all()
        assert (np.abs(posture - path.shift[-1]) <= path.spread[-1] + 1e-12).all()
