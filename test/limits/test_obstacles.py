# SPDX-License-Identifier: Apache-2.0
"""Facts about obstacles: distances, normals, convexity, and shapes that cannot be."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.limits.obstacles import (
    box,
    capsule,
    distance,
    half_space,
    joined,
    sphere,
)

TURNED = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
SHAPES = {
    'sphere': sphere([0.1, -0.2, 0.3], 0.4),
    'capsule': capsule([0.0, 0.0, 0.0], [0.3, 0.4, 0.1], 0.2),
    'box': box([0.2, 0.1, 0.0], [0.6, 0.3, 0.9], TURNED),
    'half-space': half_space([0.0, 0.0, -0.1], [0.1, -0.2, 2.0]),
}


def measured(shape, point):
    normal = np.full(3, np.nan)
    value = distance(shape, 0, np.asarray(point, dtype=float), normal)
    return value, normal


@pytest.mark.parametrize(('shape', 'point', 'expected'), [
    (sphere([0, 0, 0], 0.5), [3, 4, 0], 4.5),
    (sphere([0, 0, 0], 0.5), [0, 0, 0], -0.5),
    (capsule([0, 0, 0], [0, 0, 2], 0.5), [1, 0, 1], 0.5),
    (capsule([0, 0, 0], [0, 0, 2], 0.5), [0, 0, 5], 2.5),
    (box([0, 0, 0], [2, 2, 2]), [3, 0, 0], 2.0),
    (box([0, 0, 0], [2, 2, 2]), [2, 2, 1], np.sqrt(2.0)),
    (box([0, 0, 0], [2, 2, 2]), [0.9, 0, 0], -0.1),
    (half_space([0, 0, 1], [0, 0, 1]), [7, -3, 1.25], 0.25),
    (half_space([0, 0, 1], [0, 0, 1]), [7, -3, 0.75], -0.25),
])
def test_distances_are_those_of_geometry(shape, point, expected):
    assert measured(shape, point)[0] == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize('name', SHAPES)
def test_the_normal_is_the_gradient_of_the_distance(name):
    random, shape, step = np.random.default_rng(1), SHAPES[name], 1e-6
    for point in random.uniform(-1.5, 1.5, (200, 3)):
        value, normal = measured(shape, point)
        if abs(value) < 1e-3 or (name == 'box' and value < 0.0):
            continue  # inside a box the nearest face may change within a step
        gradient = [(measured(shape, point + step * axis)[0]
                     - measured(shape, point - step * axis)[0]) / (2.0 * step)
                    for axis in np.eye(3)]
        np.testing.assert_allclose(normal, gradient, atol=1e-4)
        assert np.linalg.norm(normal) == pytest.approx(1.0)


@pytest.mark.parametrize('name', SHAPES)
def test_the_distance_is_convex(name):
    random, shape = np.random.default_rng(2), SHAPES[name]
    for a, b in random.uniform(-2.0, 2.0, (500, 2, 3)):
        part = random.uniform()
        between = measured(shape, part * a + (1.0 - part) * b)[0]
        chord = part * measured(shape, a)[0] + (1.0 - part) * measured(shape, b)[0]
        assert between <= chord + 1e-12


def test_joined_obstacles_keep_their_distances():
    shapes = joined(list(SHAPES.values()))
    for k, shape in enumerate(SHAPES.values()):
        normal = np.empty(3)
        assert distance(shapes, k, np.ones(3), normal) == measured(shape, np.ones(3))[0]
    assert joined([]).radius.size == 0


@pytest.mark.parametrize(('make', 'name'), [
    (lambda: sphere([0, 0, np.nan], 1.0), 'sphere.centre'),
    (lambda: sphere([0, 0], 1.0), 'sphere.centre'),
    (lambda: sphere([0, 0, 0], 0.0), 'sphere.radius'),
    (lambda: capsule([0, 0, 0], [0, 0, 0], 1.0), 'capsule.end'),
    (lambda: capsule([0, 0, 0], [0, 0, 1], np.inf), 'capsule.radius'),
    (lambda: box([0, 0, 0], [1, 0, 1]), 'box.sides'),
    (lambda: box([0, 0, 0], [1, 1, 1], 2.0 * np.eye(3)), 'box.rotation'),
    (lambda: half_space([0, 0, 0], [0, 0, 0]), 'half_space.normal'),
    (lambda: sphere([0, 0, 0], 1.0, [0, np.inf, 0]), 'velocity'),
])
def test_a_shape_that_cannot_be_is_refused(make, name):
    with pytest.raises(ParameterError, match=name):
        make()
