# SPDX-License-Identifier: Apache-2.0
"""Facts about the persistence-of-excitation index (21)."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.excitation import Excitation, PARTS

DT, WINDOW = 1e-3, 0.2
SAMPLES = round(WINDOW / DT)


def fed(regressors, window=WINDOW) -> Excitation:
    excitation = Excitation(regressors.shape[2], window)
    for regressor in regressors:
        excitation.update(DT, regressor)
    return excitation


def integral(regressors):
    return DT * np.einsum('kij,kil->jl', regressors, regressors)


def test_index_is_the_smallest_eigenvalue_of_the_integral_over_the_last_window():
    regressors = np.random.default_rng(1).normal(size=(5 * SAMPLES, 2, 5))
    expected = np.linalg.eigvalsh(integral(regressors[-SAMPLES:]))[0]
    assert fed(regressors).index == pytest.approx(expected, rel=1e-12)


def test_window_slides_in_steps_of_one_part():
    regressors = np.random.default_rng(2).normal(size=(3 * SAMPLES + SAMPLES // PARTS - 1, 2, 5))
    whole = 3 * SAMPLES  # the part that has just begun does not count yet
    expected = np.linalg.eigvalsh(integral(regressors[whole - SAMPLES:whole]))[0]
    assert fed(regressors).index == pytest.approx(expected, rel=1e-12)


def test_a_regressor_that_does_not_change_excites_no_more_than_its_rank():
    regressor = np.random.default_rng(3).normal(size=(1, 2, 5))
    assert fed(np.repeat(regressor, 2 * SAMPLES, axis=0)).index < 1e-12


def test_what_is_older_than_the_window_is_forgotten():
    rich = np.random.default_rng(4).normal(size=(SAMPLES, 2, 5))
    excitation = fed(rich)
    assert excitation.index > 1e-3
    for _ in range(SAMPLES):
        excitation.update(DT, rich[0])
    assert excitation.index < 1e-12


def test_before_the_first_window_is_over_the_index_only_grows():
    regressors = np.random.default_rng(5).normal(size=(SAMPLES, 2, 5))
    indices = [fed(regressors[:count]).index for count in range(0, SAMPLES, SAMPLES // PARTS)]
    assert indices[0] == 0.0
    assert np.all(np.diff(indices) >= 0.0)


def test_index_is_never_negative():
    assert fed(np.full((SAMPLES, 1, 4), 0.1)).index >= 0.0


def test_a_window_of_zero_switches_the_index_off():
    assert fed(np.ones((10, 1, 3)), window=0.0).index is None


@pytest.mark.parametrize('window', [-1.0, np.nan, np.inf])
def test_an_unusable_window_is_refused_by_name(window):
    with pytest.raises(ParameterError, match='excitation.window'):
        Excitation(3, window)
