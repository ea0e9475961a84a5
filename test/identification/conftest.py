# SPDX-License-Identifier: Apache-2.0
"""A 2-DoF arm driven by torques that are held over each interval, sampled without noise."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest

from adaptive_blf_control.arms.two_link import TwoLinkArm


class Sample(NamedTuple):
    """Time [s], positions, velocities and the torque held over the interval that ends there."""

    t: float
    q: np.ndarray
    qd: np.ndarray
    tau: np.ndarray


def _record(steps: int = 1500, jitter: float = 0.0, seed: int = 5) -> list[Sample]:
    random = np.random.default_rng(seed)
    dynamics = TwoLinkArm().dynamics(TwoLinkArm().nominal)
    t, q, qd = 0.0, np.array([0.0, 1.0]), np.array([0.5, -1.0])
    samples = [Sample(t, q, qd, np.zeros(2))]
    for _ in range(steps):
        dt = 1e-3 * (1.0 + jitter * random.uniform(-1.0, 1.0))
        tau = random.normal(scale=0.5, size=2) + [
            8.0 * np.sin(3.0 * t) + 4.0 * np.sin(11.0 * t), 2.5 * np.cos(4.0 * t)]
        q, qd = dynamics.advance(q, qd, tau, dt, 4)
        t += dt
        samples.append(Sample(t, q, qd, tau))
    return samples


@pytest.fixture(scope='session')
def record() -> Callable[..., list[Sample]]:
    """Return ``record(steps, jitter, seed)``: a simulated log at 1 kHz, jitter relative."""
    return _record
