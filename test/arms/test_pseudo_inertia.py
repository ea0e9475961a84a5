# SPDX-License-Identifier: Apache-2.0
"""Facts about pseudo-inertias: what a rigid body is."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.arms.pseudo_inertia import (
    feasible,
    GYRATION,
    inertial_parameters,
    pseudo_inertias,
)


def cloud(seed: int, count: int = 6) -> tuple[np.ndarray, np.ndarray]:
    """Return point masses [kg] and where they are [m], shapes (count,) and (count, 3)."""
    random = np.random.default_rng(seed)
    return random.uniform(0.1, 2.0, count), random.normal(size=(count, 3))


def parameters_of(masses: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Sum the ten parameters of point masses by their definition: I = Σ m (xᵀx 1 − x xᵀ)."""
    inertia = sum(m * (x @ x * np.eye(3) - np.outer(x, x)) for m, x in zip(masses, points))
    return np.concatenate([[masses.sum()], masses @ points, inertia[np.tril_indices(3)]])


def test_it_is_the_second_moment_of_homogeneous_points() -> None:
    masses, points = cloud(0)
    homogeneous = np.column_stack([points, np.ones(len(points))])
    expected = homogeneous.T @ (masses[:, None] * homogeneous)
    found = pseudo_inertias(parameters_of(masses, points)[None])[0]
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_parameters_come_back() -> None:
    given = np.random.default_rng(1).normal(size=(5, 10))
    np.testing.assert_allclose(inertial_parameters(pseudo_inertias(given)), given, atol=1e-14)


def test_moments_that_break_the_triangle_inequality_are_no_body() -> None:
    flat = np.array([[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 1.9]])
    broken = flat.copy()
    broken[0, 9] = 2.1  # Izz > Ixx + Iyy
    assert np.linalg.eigvalsh(pseudo_inertias(flat))[0, 0] > 0.0
    assert np.linalg.eigvalsh(pseudo_inertias(broken))[0, 0] < 0.0


def test_a_possible_body_is_left_as_it_is() -> None:
    given = pseudo_inertias(parameters_of(*cloud(2))[None])
    np.testing.assert_allclose(feasible(given), given, atol=1e-12)


@pytest.mark.parametrize('inertial', [
    [2.0, 0.2, 0.0, 0.4, *[0.0] * 6], [3.0, 0.0, 0.3, 0.0, 0.01, 0.0, 0.01, 0.0, 0.0, 9.0]])
def test_an_impossible_body_keeps_mass_and_centre_and_gets_a_thickness(
        inertial: list[float]) -> None:
    given = pseudo_inertias(np.array([inertial]))
    found = feasible(given)
    np.testing.assert_array_equal(found[:, 3], given[:, 3])
    mass, first = found[0, 3, 3], found[0, :3, 3]
    about_centre = found[0, :3, :3] - np.outer(first, first) / mass
    assert np.linalg.eigvalsh(about_centre)[0] >= 0.999 * mass * GYRATION ** 2


def test_a_link_without_mass_becomes_a_ball_of_a_kilogram() -> None:
    found = feasible(np.zeros((1, 4, 4)))
    np.testing.assert_allclose(found[0], np.diag([GYRATION ** 2] * 3 + [1.0]))
