# SPDX-License-Identifier: Apache-2.0
"""Facts about the inertia that joints see along a reference."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.control.reference import Posture
from adaptive_blf_control.tuning.inertia import (
    damping_rate,
    known_masses,
    mass_matrices,
    reference_states,
    seen_inertia,
    viscous_friction,
)

ARM = TwoLinkArm()
POSTURES = np.random.default_rng(3).uniform(-np.pi, np.pi, (30, 2))
MASSES = mass_matrices(ARM, ARM.nominal, POSTURES)


def test_the_least_inertia_is_that_with_the_other_joints_giving_way() -> None:
    seen = seen_inertia(MASSES)
    for q, mass in zip(POSTURES, MASSES):
        np.testing.assert_allclose(
            mass, np.column_stack([ARM.Y1(q, unit) @ ARM.nominal for unit in np.eye(2)]))
        for i in range(2):  # a torque on joint i alone accelerates it by torque/inertia
            acceleration = np.linalg.solve(mass, np.eye(2)[i])[i]
            assert seen.least[i] <= 1.0 / acceleration * (1.0 + 1e-12)
            assert mass[i, i] <= seen.most[i] * (1.0 + 1e-12)


def test_gains_within_the_coupling_never_damp_faster_than_asked() -> None:
    seen, random = seen_inertia(MASSES), np.random.default_rng(4)
    assert 1.0 <= seen.coupling <= 2.0
    assert damping_rate(MASSES, 70.0 / seen.coupling * seen.least) == pytest.approx(70.0)
    for _ in range(20):
        gains = 70.0 / seen.coupling * seen.least * random.uniform(0.0, 1.0, 2)
        assert damping_rate(MASSES, gains) <= 70.0 * (1.0 + 1e-12)


def test_the_damping_rate_is_the_largest_eigenvalue_of_all_postures() -> None:
    gains = np.array([30.0, 5.0])
    assert damping_rate(MASSES, gains) == pytest.approx(max(
        np.linalg.eigvals(np.linalg.solve(mass, np.diag(gains))).real.max() for mass in MASSES))


def test_the_nominal_arm_counts_where_the_estimate_has_no_inertia_in_some_posture() -> None:
    for theta in (np.zeros(5), np.array([0.0, 9.0, 6.0, 0.0, 0.0]), np.full(5, np.nan)):
        name, masses = known_masses(ARM, theta, POSTURES)
        assert name == 'nominal'
        np.testing.assert_array_equal(masses, MASSES)
    name, masses = known_masses(ARM, 2.0 * ARM.nominal, POSTURES)
    assert name == 'estimate'
    np.testing.assert_allclose(masses, 2.0 * MASSES)


def test_without_any_model_nothing_is_known() -> None:
    arm = TwoLinkArm()
    vars(arm)['nominal'] = np.zeros(5)  # closed to others
    assert known_masses(arm, np.zeros(5), POSTURES) is None


def test_a_posture_is_looked_at_as_often_as_asked() -> None:
    states = reference_states(Posture([0.3, -0.2]), 7)
    np.testing.assert_array_equal(states.q, np.tile([0.3, -0.2], (7, 1)))
    assert not states.qd.any()


def test_viscous_friction_is_found_by_the_names_of_the_joints() -> None:
    np.testing.assert_array_equal(viscous_friction(ARM, np.array([1.0, 2.0, 3.0, 4.0, -5.0])),
                                  [4.0, 0.0])
