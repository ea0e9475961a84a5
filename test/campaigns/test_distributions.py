# SPDX-License-Identifier: Apache-2.0
"""Facts about distributions: what is drawn follows them, and is the same again."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.campaigns.distributions import read_distribution, unit_numbers
from adaptive_blf_control.errors import ParameterError

N = 4000


def drawn(given: dict, latin: bool = True) -> np.ndarray:
    numbers = unit_numbers(N, 7, 'arm_driver.payload', latin)
    return np.array(read_distribution('arm_driver.payload', given).quantile(numbers))


@pytest.mark.parametrize('latin', [True, False])
@pytest.mark.parametrize(('given', 'quartiles'), [
    ({'uniform': [2.0, 4.0]}, [2.5, 3.0, 3.5]),
    ({'log_uniform': [1.0, 1e4]}, [10.0, 100.0, 1000.0]),
    ({'normal': [1.0, 2.0]}, [1.0 - 2.0 * 0.67449, 1.0, 1.0 + 2.0 * 0.67449]),
])
def test_the_quartiles_of_what_is_drawn_are_those_of_the_distribution(given, quartiles, latin):
    np.testing.assert_allclose(np.quantile(drawn(given, latin), [0.25, 0.5, 0.75]), quartiles,
                               rtol=0.15 if not latin else 0.01, atol=0.1 if not latin else 0.01)


def test_integers_have_both_ends_equally_often():
    values, counts = np.unique(drawn({'integers': [0, 3]}), return_counts=True)
    assert values.tolist() == [0, 1, 2, 3]
    assert counts.tolist() == [N // 4] * 4


def test_a_choice_gives_each_value_equally_often():
    values, counts = np.unique(drawn({'choice': [0, 2, 8]}), return_counts=True)
    assert values.tolist() == [0, 2, 8]
    assert np.abs(counts - N / 3).max() <= 1.0


def test_latin_hypercube_sampling_has_one_number_in_each_interval():
    numbers = unit_numbers(N, 3, 'a', latin=True)
    assert sorted((numbers * N).astype(int).tolist()) == list(range(N))
    assert (np.diff(numbers) < 0.0).any()  # in random order


def test_numbers_are_the_same_again_and_others_for_another_seed_or_name():
    first = unit_numbers(5, 1, 'a', latin=False)
    np.testing.assert_array_equal(first, unit_numbers(5, 1, 'a', latin=False))
    np.testing.assert_array_equal(first, unit_numbers(9, 1, 'a', latin=False)[:5])
    assert (first != unit_numbers(5, 2, 'a', latin=False)).all()
    assert (first != unit_numbers(5, 1, 'b', latin=False)).all()


@pytest.mark.parametrize(('given', 'words'), [
    ({'uniform': [2.0, 1.0]}, 'the smallest value before the largest'),
    ({'uniform': [1.0]}, 'two numbers'),
    ({'uniform': ['a', 1.0]}, 'two numbers'),
    ({'uniform': [0.0, float('inf')]}, 'finite'),
    ({'log_uniform': [0.0, 1.0]}, '> 0'),
    ({'normal': [0.0, 0.0]}, 'a standard deviation > 0'),
    ({'integers': [0, 1.5]}, 'integers'),
    ({'choice': []}, 'a list of values'),
    ({'uniform': 3.0}, 'a list of values'),
    ({'triangular': [0.0, 1.0]}, 'one of uniform, log_uniform'),
    ({}, 'a mapping with one of'),
    (3.0, 'a mapping with one of'),
])
def test_a_distribution_that_cannot_be_used_is_named(given, words):
    with pytest.raises(ParameterError, match='arm_driver.payload') as error:
        read_distribution('arm_driver.payload', given)
    assert words in str(error.value)
