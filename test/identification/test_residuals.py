# SPDX-License-Identifier: Apache-2.0
"""Facts about the residuals over time."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.identification.identifier import Identifier
from adaptive_blf_control.identification.residuals import Residuals


def watched(samples: list, noise: np.ndarray | float = 0.0,
            constant: float = 0.02) -> tuple[Identifier, Residuals, dict[bytes, float]]:
    """Return an identifier after a log with noise on its torques, and what was seen of it."""
    arm = TwoLinkArm()
    identifier = Identifier(arm, kt=0.0, kh=0.0, initial_estimate=arm.nominal.tolist(),
                            filter={'time_constant': constant}, change={'window': 0.0},
                            history={'size': 30})
    residuals, taken = Residuals(2), {}
    for i, sample in enumerate(samples):
        error = noise if isinstance(noise, float) else noise[i]
        before = identifier.stack.insertions
        identifier.update(sample.t, sample.q, sample.qd, sample.tau + error)
        residuals.observe(sample.t, identifier)
        if identifier.stack.insertions > before:
            taken[identifier.pair[1].tobytes()] = sample.t
    return identifier, residuals, taken


def test_every_recorded_pair_has_the_time_it_was_taken_at(record: Callable[..., list]) -> None:
    identifier, residuals, taken = watched(record(3000))
    stack = identifier.stack
    assert stack.insertions > 30  # so that pairs were replaced
    times = residuals.times(stack)
    assert times.shape == (30,)
    assert times.tolist() == [taken[row.tobytes()] for row in stack.torques]


@pytest.mark.parametrize('correlation', [0.02, 0.06])
def test_correlation_time_is_that_of_the_noise(record: Callable[..., list],
                                               correlation: float) -> None:
    """Of first-order noise, filtered by 10 ms: the sum of both times."""
    count = 20000
    random, keep = np.random.default_rng(1), np.exp(-1e-3 / correlation)
    noise = np.zeros((count + 1, 2))
    for i in range(count):
        noise[i + 1] = keep * noise[i] + random.normal(scale=0.01, size=2)
    still = [record(1)[0]._replace(t=1e-3 * i) for i in range(count + 1)]
    arm = TwoLinkArm()
    identifier = Identifier(arm, kt=0.0, kh=0.0, initial_estimate=np.zeros(5).tolist(),
                            filter={'time_constant': 0.01}, change={'window': 0.0})
    residuals = Residuals(2)
    for i, sample in enumerate(still):
        identifier.observe(sample.t, np.zeros(2), np.zeros(2), noise[i])
        residuals.observe(sample.t, identifier)
    np.testing.assert_allclose(residuals.correlation_time, correlation + 0.01, rtol=0.4)


def test_it_is_at_least_what_the_filters_remember(record: Callable[..., list]) -> None:
    _, residuals, _ = watched(record(1500), 0.0, constant=0.05)
    assert residuals.correlation_time.min() >= 0.05


def test_rms_is_that_of_the_residual(record: Callable[..., list]) -> None:
    _, residuals, _ = watched(record(3000), 0.3)
    np.testing.assert_allclose(residuals.rms, 0.3, rtol=0.05)
