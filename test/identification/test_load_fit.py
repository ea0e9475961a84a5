# SPDX-License-Identifier: Apache-2.0
"""Facts about a load as it is described: mass, centre of mass, inertia about it."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.identification.load_fit import described

MASS, COM = 2.0, np.array([0.1, -0.2, 0.3])
INERTIA = np.array([[0.03, 0.002, -0.001], [0.002, 0.04, 0.003], [-0.001, 0.003, 0.05]])
ORDER = ([0, 1, 1, 2, 2, 2], [0, 0, 1, 0, 1, 2])  # of the six elements


def inertial(mass: float, com: np.ndarray) -> np.ndarray:
    """Return the ten parameters, the inertia among them about the origin of the frame."""
    about_origin = INERTIA + mass * (com @ com * np.eye(3) - np.outer(com, com))
    return np.concatenate([[mass], mass * com, about_origin[ORDER]])


def test_the_inertia_of_a_load_is_about_its_centre_of_mass() -> None:
    load, std = described(inertial(MASS, COM), np.zeros((10, 10)))
    assert load.mass == MASS
    np.testing.assert_allclose(load.com, COM, rtol=1e-14)
    np.testing.assert_allclose(load.inertia, INERTIA[ORDER], rtol=1e-10)
    assert not std.vector.any()


def test_the_deviations_follow_those_of_the_parameters() -> None:
    random = np.random.default_rng(3)
    root = 1e-4 * random.normal(size=(10, 10))
    _, std = described(inertial(MASS, COM), root @ root.T)
    drawn = [described(inertial(MASS, COM) + root @ random.normal(size=10),
                       np.zeros((10, 10)))[0].vector for _ in range(4000)]
    np.testing.assert_allclose(std.vector, np.std(drawn, axis=0), rtol=0.06)
