# SPDX-License-Identifier: Apache-2.0
"""Facts about stops: no posture of the box is nearer to an obstacle than was said."""

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
from adaptive_blf_control.limits.stop_box import clearances, stop_box

OBSTACLES = joined([
    sphere([0.5, 0.1, 0.5], 0.1), capsule([0.3, -0.4, 0.2], [0.4, 0.5, 0.9], 0.05),
    box([-0.3, 0.3, 0.6], [0.2, 0.3, 0.4]), half_space([0.0, 0.0, 0.1], [0.0, 0.0, 1.0])])


@pytest.fixture(scope='module')
def chain():
    model, joints = reduced_model(read_urdf('package://panda_description/urdf/panda.urdf', ()),
                                  [f'panda_joint{i}' for i in range(1, 8)])
    return chain_of_model(model, joints)


def found_in(chain, spheres, q, low, high, standstill=0.0, obstacles=OBSTACLES):
    shape = (spheres.body.size, obstacles.radius.size)
    found, now, gradients = np.empty(shape), np.empty(shape), np.empty((*shape, q.size))
    clearances(chain, spheres, obstacles, q, low, high, standstill, found, now, gradients)
    return found, now, gradients


def true_clearances(chain, spheres, q):
    normal = np.empty(3)
    return np.array([[distance(OBSTACLES, k, p, normal) - r
                      for k in range(OBSTACLES.radius.size)]
                     for p, r in zip(sphere_centres(chain, spheres, q), spheres.radius)])


@pytest.mark.parametrize('width', [0.02, 0.2, 0.7])
def test_no_posture_of_the_box_is_nearer_than_the_bound(chain, width):
    random, spheres = np.random.default_rng(0), link_spheres_along(chain, 0.08)
    closest = np.inf
    for _ in range(6):
        q = random.uniform(-2.0, 2.0, 7)
        low, high = -random.uniform(0.0, width, 7), random.uniform(0.0, width, 7)
        found, now, _ = found_in(chain, spheres, q, low, high)
        np.testing.assert_allclose(now, true_clearances(chain, spheres, q), atol=1e-12)
        for _ in range(40):
            corner = np.where(random.random(7) < 0.5, low, high)
            x = corner * random.choice([1.0, 1.0, random.random()])
            slack = true_clearances(chain, spheres, q + x) - found
            assert slack.min() > -1e-12
            closest = min(closest, slack.min())
    assert closest < 2.0 * width  # no empty promise


def test_the_gradient_is_that_of_the_bound(chain):
    random, spheres = np.random.default_rng(1), link_spheres_along(chain, 0.08)
    q, low, high = random.uniform(-2.0, 2.0, 7), np.full(7, -1e-4), np.full(7, 0.02)
    found, _, gradients = found_in(chain, spheres, q, low, high)
    for j in range(7):
        wider = high.copy()
        wider[j] += 1e-6
        change = (found_in(chain, spheres, q, low, wider)[0] - found) / 1e-6
        np.testing.assert_allclose(change, gradients[:, :, j], atol=2e-3)


def test_an_obstacle_that_comes_nearer_counts_until_the_arm_stands(chain):
    spheres = link_spheres_along(chain, 0.08)
    still = np.zeros(7)
    coming = joined([sphere([2.0, 0.0, 0.5], 0.1, (-1.0, 0.0, 0.0))])
    leaving = joined([sphere([2.0, 0.0, 0.5], 0.1, (1.0, 0.0, 0.0))])
    for obstacles, closing in ((coming, True), (leaving, False)):
        found, now, _ = found_in(chain, spheres, still, still, still, 0.25, obstacles)
        assert ((now - found) > 0.1).all() == closing
        assert (found <= now + 1e-12).all()


def test_a_joint_that_brakes_harder_than_stated_stays_in_its_box_which_shrinks():
    random, h = np.random.default_rng(2), 1e-3
    for _ in range(300):
        braking = random.uniform(1.0, 10.0, 3)
        q, qd = np.zeros(3), random.uniform(-2.0, 2.0, 3)
        a, error = random.uniform(-20.0, 20.0, 3), random.uniform(0.0, 2.0, 3)
        low, high, _ = stop_box(qd, a, error, braking, h)
        a = a + error * random.uniform(-1.0, 1.0, 3)
        for _ in range(6000):
            q, qd = q + h * qd + 0.5 * h * h * a, qd + h * a
            assert (q >= low - 1e-12).all()
            assert (q <= high + 1e-12).all()
            if not qd.any():
                break
            a = np.clip(-qd / h, -braking * random.uniform(1.0, 2.0), braking)
            a = np.where(np.abs(qd) <= braking * h, -qd / h,
                         -np.sign(qd) * np.minimum(braking * random.uniform(1.0, 2.0, 3),
                                                   np.abs(qd) / h))
        assert not qd.any()


def test_the_box_holds_every_stop_after_a_sample_whose_acceleration_is_within_its_error():
    random, period = np.random.default_rng(5), 0.01
    for _ in range(300):
        braking = random.uniform(0.5, 5.0, 20)
        speed = random.uniform(-30.0, 30.0, 20) * braking * period
        wanted = random.uniform(-30.0, 30.0, 20) * braking
        error = random.uniform(0.0, 3.0, 20) * braking
        low, high, _ = stop_box(speed, wanted, error, braking, period)
        for part in (-1.0, 0.0, 1.0):
            a = wanted + part * error
            end = speed + period * a
            moved = 0.5 * period * (speed + end)
            turned = np.where(speed * end < 0.0, -0.5 * speed ** 2 / np.where(a, a, 1.0), moved)
            stands = moved + end * np.abs(end) / (2.0 * braking)
            for where in (moved, turned, stands):
                assert (low <= where).all()
                assert (where <= high).all()
