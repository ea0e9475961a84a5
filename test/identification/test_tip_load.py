# SPDX-License-Identifier: Apache-2.0
"""Facts about the fit of a load at the tip."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.identification.tip_load import (
    certain_part,
    fit_tip_load,
    forget_tip_load,
    load_directions,
    new_tip_load,
    TipLoad,
)

SCALES = 5.0 * np.array([1.0, *3 * (0.2,), *6 * (0.04,)])
CENTRE = np.array([0.1, -0.05, 0.08])


class _Body:
    """An arm whose parameters are the ten of its last link."""

    m, last_body, base_from_standard = 10, 0, np.eye(10)


def _body(mass: float, centre: np.ndarray, own: float = 0.0) -> np.ndarray:
    """Return the ten parameters of a ball with a radius of gyration, about the link's origin."""
    about = mass * (centre @ centre * np.eye(3) - np.outer(centre, centre)
                    + own ** 2 * np.eye(3))
    return np.array([mass, *mass * centre, *about[np.tril_indices(3)]])


def _fitted(p: np.ndarray, seen: int, pairs: int = 200) -> TipLoad:
    """Return the fit of p from pairs that show its first parameters."""
    random, fit = np.random.default_rng(1), new_tip_load(2, load_directions(_Body()))
    forget_tip_load(fit, np.zeros(10))
    scale = np.full(2, 0.01 ** 2)
    for _ in range(pairs):
        regressor = np.zeros((2, 10))
        regressor[:, :seen] = random.normal(size=(2, seen))
        torque = regressor @ p + 0.01 * random.normal(size=2)
        fit_tip_load(fit, 0.1, 0.01, regressor, torque, scale)
    return fit


def test_an_inertia_that_no_pair_shows_is_that_of_the_mass_in_its_centre() -> None:
    p = _body(2.0, CENTRE)
    np.testing.assert_allclose(SCALES * _fitted(p, seen=4).found, p, atol=0.01)
    off = _body(-2.0, CENTRE)  # a load that is taken off
    np.testing.assert_allclose(SCALES * _fitted(off, seen=4).found, off, atol=0.01)


def test_pairs_that_show_another_inertia_are_believed() -> None:
    p = _body(2.0, CENTRE, own=0.3)
    np.testing.assert_allclose(SCALES * _fitted(p, seen=10).found, p, atol=0.02)


def test_a_load_may_come_in_the_place_of_one_of_the_same_mass() -> None:
    p = _body(2.0, CENTRE) - _body(2.0, -CENTRE)
    found = SCALES * _fitted(p, seen=4, pairs=20).found
    np.testing.assert_allclose(found[:4], p[:4], atol=0.02)


def test_what_may_as_well_be_zero_is_no_certain_part() -> None:
    fit = new_tip_load(1, np.zeros((4, 3)))
    fit.found[:] = [0.4, 0.1, 0.02]
    fit.inverse[:] = np.diag([1e-6, 0.1, 0.1]) ** 2
    np.testing.assert_allclose(certain_part(fit), [0.4, 0.05, 0.0], atol=1e-3)
