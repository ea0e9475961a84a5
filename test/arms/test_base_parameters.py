# SPDX-License-Identifier: Apache-2.0
"""Facts about the choice of independent regressor columns."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.arms.base_parameters import decompose, preferred_columns


def dependent_stack(seed: int) -> np.ndarray:
    """Seven columns of rank 4: two combinations of others and one of zeros."""
    stack = np.random.default_rng(seed).normal(size=(60, 7))
    stack[:, 2] = 2.0 * stack[:, 0] - 3.0 * stack[:, 1]
    stack[:, 5] = 0.5 * stack[:, 3]
    stack[:, 6] = 0.0
    return stack


def test_first_columns_of_the_order_are_kept() -> None:
    stack = dependent_stack(0)
    assert decompose(stack, np.arange(7)).independent.tolist() == [0, 1, 3, 4]
    assert decompose(stack, np.arange(7)[::-1]).independent.tolist() == [1, 2, 4, 5]


def test_choice_does_not_depend_on_the_samples() -> None:
    bases = [decompose(dependent_stack(seed), np.arange(7)) for seed in range(5)]
    for base in bases[1:]:
        np.testing.assert_array_equal(base.independent, bases[0].independent)
        np.testing.assert_allclose(base.from_standard, bases[0].from_standard, atol=1e-12)


def test_kept_columns_reproduce_the_whole_product() -> None:
    stack = dependent_stack(1)
    base = decompose(stack, np.arange(7))
    standard = np.random.default_rng(2).normal(size=7)
    np.testing.assert_allclose(stack[:, base.independent] @ base.from_standard @ standard,
                               stack @ standard, atol=1e-12)
    np.testing.assert_array_equal(base.from_standard[:, 6], 0.0)
    assert np.count_nonzero(base.from_standard) == 4 + 3  # rounding is cleaned away


def test_nearest_standard_parameters_map_back_and_keep_the_rest() -> None:
    base = decompose(dependent_stack(3), np.arange(7))
    reference, theta = np.arange(7.0), np.array([4.0, 3.0, 2.0, 1.0])
    standard = base.nearest_standard(theta, reference)
    np.testing.assert_allclose(base.from_standard @ standard, theta)
    np.testing.assert_array_equal(standard[[2, 5, 6]], reference[[2, 5, 6]])
    unchanged = base.nearest_standard(base.from_standard @ reference, reference)
    np.testing.assert_array_equal(unchanged, reference)


def test_what_only_rounding_tells_apart_is_one_parameter() -> None:
    stack = dependent_stack(4)
    stack[:, 5] += 1e-6 * stack[:, 4]
    stack[:, 6] = 1e-6 * stack[:, 4][::-1]
    assert decompose(stack, np.arange(7)).independent.tolist() == [0, 1, 3, 4]


def test_no_signal_gives_no_parameters() -> None:
    base = decompose(np.zeros((30, 7)), np.arange(7))
    assert base.independent.size == 0
    assert base.from_standard.shape == (0, 7)


def test_every_column_is_tried_once_and_masses_last() -> None:
    order = preferred_columns(3)
    assert sorted(order) == list(range(30))
    assert order[-3:].tolist() == [20, 10, 0]
