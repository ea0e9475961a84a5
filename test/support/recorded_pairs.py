# SPDX-License-Identifier: Apache-2.0
"""Pairs as an identifier records them, of which it is known how wrong they are."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.arms.arm import Arm


def recorded_pairs(random: np.random.Generator, arm: Arm, theta: np.ndarray, count: int,
                   delta: np.ndarray, scale: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Return regressors along random motions, (count, n, m), and torques, (count, n).

    The torques are those of ``theta``, many of them wrong by just ``delta``, shape (n,).
    """
    regressors = np.array([arm.X(*scale * random.normal(size=(4, arm.n))) for _ in range(count)])
    wrong = random.choice([-1.0, 0.0, 1.0], (count, arm.n)) * delta
    return regressors, regressors @ theta + wrong
