# SPDX-License-Identifier: Apache-2.0
"""`bench payload`: what the model with the load is worth, over windows of a second."""

import numpy as np
import pytest

from adaptive_blf_control.bench.payload_figures import ratios

RATE = 100  # samples a second


def errors(*with_load):
    """Squares of the errors: 1 without the load, and for a second each what is given with it."""
    squares = np.repeat(with_load, RATE)
    t = 5.0 + np.arange(1, squares.size + 1) / RATE
    return [(float(a), 1.0, float(b)) for a, b in zip(t, squares, strict=True)]


def test_a_bad_second_after_the_mass_is_right_is_not_one_until_then():
    overall, meanwhile, window = ratios(errors(1.0, 0.25, 0.25, 4.0), close=2.5)
    assert (overall, meanwhile) == pytest.approx((np.sqrt(5.5 / 4.0), 1.0), abs=0.01)
    assert window == pytest.approx(2.0, abs=0.01)


def test_a_bad_second_until_the_mass_is_right_is_one():
    _, meanwhile, window = ratios(errors(0.25, 4.0, 0.25, 0.25), close=2.5)
    assert meanwhile == window == pytest.approx(2.0, abs=0.01)


def test_the_first_second_counts_however_soon_the_mass_is_right():
    assert ratios(errors(4.0, 0.25), close=0.1)[1] == pytest.approx(2.0, abs=0.01)


def test_where_the_mass_is_never_right_every_second_counts():
    assert ratios(errors(1.0, 0.25, 9.0))[1] == pytest.approx(3.0, abs=0.01)
