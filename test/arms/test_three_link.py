# SPDX-License-Identifier: Apache-2.0
"""Facts about the planar 3-DoF arm, against an arm built from rods and points independently."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from adaptive_blf_control.arms.three_link import (
    three_link_mass,
    three_link_parameters,
    ThreeLinkArm,
)
from adaptive_blf_control.errors import ArmError, ParameterError

MASSES, LENGTHS, FRICTION = (6.0, 5.0, 4.0), (0.4, 0.4, 0.35), 1.5
STATES = 30
Mass = Callable[[np.ndarray], np.ndarray]


def rods_and_point(payload: float) -> Mass:
    """M(q) as the sum of m JᵀJ over the points of each rod and the payload."""
    # Three Gauss points per rod integrate the square of a linear velocity exactly.
    nodes, weights = np.polynomial.legendre.leggauss(3)
    points = [(link, 0.5 * (1.0 + x) * LENGTHS[link], 0.5 * w * MASSES[link])
              for link in range(3) for x, w in zip(nodes, weights, strict=True)]
    points.append((2, LENGTHS[2], payload))

    def mass(q: np.ndarray) -> np.ndarray:
        angles = np.cumsum(q)
        total = np.zeros((3, 3))
        for link, distance, weight in points:
            jacobian = np.zeros((2, 3))
            for i in range(link + 1):
                length = distance if i == link else LENGTHS[i]
                # joint j <= i turns segment i
                jacobian[:, :i + 1] += length * np.array([[-np.sin(angles[i])],
                                                          [np.cos(angles[i])]])
            total += weight * jacobian.T @ jacobian
        return total

    return mass


def mass_derivatives(mass: Mass, q: np.ndarray) -> np.ndarray:
    """∂M/∂q_k by central differences, shape (3, 3, 3), k first."""
    h = 1e-5
    return np.array([(mass(q + h * unit) - mass(q - h * unit)) / (2.0 * h) for unit in np.eye(3)])


def christoffel(mass: Mass, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
    d = mass_derivatives(mass, q)
    return 0.5 * (np.einsum('kij,k->ij', d, qd) + np.einsum('jik,k->ij', d, qd)
                  - np.einsum('ijk,k->ij', d, qd))


@pytest.fixture(params=[0.0, 0.5, 2.0], ids=lambda payload: f'payload {payload} kg')
def case(request):
    return ThreeLinkArm(), rods_and_point(request.param), three_link_parameters(request.param)


def states(count: int = STATES):
    random = np.random.default_rng(7)
    return zip(random.uniform(-np.pi, np.pi, (count, 3)), random.normal(size=(count, 3)),
               random.normal(size=(count, 3)), random.normal(size=(count, 3)), strict=True)


def test_nominal_parameters_are_those_of_the_rods_rounded():
    rounded = [2.83, 0.56, 2.08, 0.56, 1.07, 0.28, 1.04, 0.163, 0.28, 0.56, 1.5]
    np.testing.assert_allclose(ThreeLinkArm().nominal, rounded, atol=5e-4)


def test_mass_matrix_is_that_of_the_rods_with_a_point_at_the_tip(case):
    _, mass, theta = case
    for q, *_ in states():
        np.testing.assert_allclose(three_link_mass(q, theta), mass(q), atol=1e-12)


def test_momentum_regressor_equals_mass_matrix_times_velocity(case):
    arm, mass, theta = case
    for q, qd, *_ in states():
        np.testing.assert_allclose(arm.Y1(q, qd) @ theta, mass(q) @ qd, atol=1e-12)


def test_second_regressor_equals_minus_mass_rate_plus_coriolis_plus_friction(case):
    arm, mass, theta = case
    for q, qd, *_ in states():
        rate = np.einsum('kij,k->ij', mass_derivatives(mass, q), qd)
        expected = (christoffel(mass, q, qd) - rate) @ qd + FRICTION * qd
        np.testing.assert_allclose(arm.Y2(q, qd) @ theta, expected, atol=1e-8)


def test_control_regressor_is_that_of_the_paper(case):
    arm, mass, theta = case
    for q, qd, alpha, alpha_dot in states():
        rate = np.einsum('kij,k->ij', mass_derivatives(mass, q), qd)
        expected = (mass(q) @ alpha_dot + christoffel(mass, q, qd) @ qd + FRICTION * qd
                    - 0.5 * rate @ (qd - alpha))
        np.testing.assert_allclose(arm.X(q, qd, alpha, alpha_dot) @ theta, expected, atol=1e-8)


def test_both_regressors_at_once_are_the_two_regressors():
    arm = ThreeLinkArm()
    for q, qd, *_ in states():
        y1, y2 = arm.Y12(q, qd)
        np.testing.assert_array_equal(y1, arm.Y1(q, qd))
        np.testing.assert_array_equal(y2, arm.Y2(q, qd))


def test_mass_rate_minus_twice_coriolis_does_no_work(case):
    """e2ᵀ(½Ṁ − C)e2 = 0, C q̇ and Ṁ taken from the regressors: X θ = … − ½Ṁ e2 at α = 0."""
    arm, _, theta = case
    zero = np.zeros(3)
    for q, qd, *_ in states():
        coriolis_less_half_rate = arm.X(q, qd, zero, zero) @ theta - FRICTION * qd
        assert abs(qd @ coriolis_less_half_rate) < 1e-12


def test_forward_dynamics_invert_the_regressors(case):
    """M q̈ + C q̇ + F q̇ = τ, where X at α = q̇, α̇ = q̈ is the left-hand side."""
    arm, _, theta = case
    plant = arm.dynamics(theta)
    for q, qd, tau, _ in states():
        qdd = plant.acceleration(q, qd, tau)
        np.testing.assert_allclose(arm.X(q, qd, qd, qdd) @ theta, tau, atol=1e-10)


def test_energy_falls_by_what_friction_takes_away():
    arm, theta = ThreeLinkArm(), three_link_parameters(payload=1.0)
    q, qd, plant = np.array([0.3, -1.0, 2.0]), np.array([1.0, -2.0, 3.0]), arm.dynamics(theta)
    energy = 0.5 * qd @ arm.Y1(q, qd) @ theta
    loss, h = 0.0, 1e-3
    for _ in range(1000):
        power = FRICTION * qd @ qd
        q, qd = plant.advance(q, qd, np.zeros(3), h, 2)
        loss += 0.5 * h * (power + FRICTION * qd @ qd)
    assert energy - 0.5 * qd @ arm.Y1(q, qd) @ theta == pytest.approx(loss, rel=1e-4)


def test_all_eleven_columns_are_independent():
    arm = ThreeLinkArm()
    stack = np.vstack([arm.X(*state) for state in states()])
    assert np.linalg.matrix_rank(stack) == 11
    filtered = np.vstack([np.vstack([arm.Y1(q, a) + arm.Y2(q, qd)]) for q, qd, a, _ in states()])
    assert np.linalg.matrix_rank(filtered) == 11


def test_a_payload_adds_to_the_parameters_in_proportion():
    empty, one = three_link_parameters(), three_link_parameters(1.0)
    np.testing.assert_allclose(three_link_parameters(2.0) - empty, 2.0 * (one - empty), atol=1e-14)


def test_payload_direction_is_one_kilogram_at_the_tip():
    np.testing.assert_allclose(ThreeLinkArm().nominal + 0.5 * ThreeLinkArm().payload_direction,
                               three_link_parameters(0.5), atol=1e-14)


def test_friction_is_the_last_parameter():
    assert three_link_parameters(friction=0.25)[10] == 0.25
    assert ThreeLinkArm().parameters == (*(f'p{i}' for i in range(1, 11)), 'f')


@pytest.mark.parametrize('arguments', [{'payload': -0.1}, {'payload': np.inf},
                                       {'friction': -1.0}])
def test_negative_payload_or_friction_is_refused_by_name(arguments):
    with pytest.raises(ParameterError, match=next(iter(arguments))):
        three_link_parameters(**arguments)


def test_inertia_that_is_not_positive_definite_is_refused():
    theta = three_link_parameters()
    theta[7] = 0.01  # the third link would be lighter than its coupling to the others
    with pytest.raises(ArmError, match='not positive definite'):
        ThreeLinkArm().dynamics(theta)


@pytest.mark.parametrize(('place', 'value', 'posture'), [
    (9, 3.0, [0.0, 0.0, np.pi]), (6, 3.0, [0.0, np.pi, 0.0]), (6, -3.0, [0.0, 0.0, 0.0])])
def test_inertia_that_is_indefinite_in_some_postures_only_is_refused(place, value, posture):
    theta = three_link_parameters()
    theta[place] = value
    assert np.linalg.eigvalsh(three_link_mass(np.array(posture), theta))[0] < 0.0
    with pytest.raises(ArmError, match='not positive definite'):
        ThreeLinkArm().dynamics(theta)


@pytest.mark.parametrize('joints', [('a', 'b'), ('a', 'b', 'a')])
def test_other_than_three_distinct_joints_are_refused(joints):
    with pytest.raises(ArmError, match='three joints'):
        ThreeLinkArm(joints)


def test_link_points_end_at_the_tip_whose_velocity_the_payload_feels():
    arm, h = ThreeLinkArm(), 1e-6
    per_kilogram = three_link_parameters(1.0) - three_link_parameters()
    for q, qd, *_ in states(5):
        points = arm.link_points(q)
        assert points.shape == (4, 3)
        np.testing.assert_allclose(np.linalg.norm(np.diff(points, axis=0), axis=1), LENGTHS)
        velocity = (arm.link_points(q + h * qd)[-1] - arm.link_points(q - h * qd)[-1]) / (2.0 * h)
        assert qd @ arm.Y1(q, qd) @ per_kilogram == pytest.approx(velocity @ velocity, rel=1e-6)
