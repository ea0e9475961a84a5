# SPDX-License-Identifier: Apache-2.0
"""The way of the torque down to zero."""

from __future__ import annotations

from collections.abc import Iterator
import math

import numpy as np

__all__ = ['RAMP_STEP', 'ramp_down']

RAMP_STEP = 1e-3  # s between the torques of a ramp
ROUNDING = 1e-9  # steps
LONGEST_RAMP = 5.0  # s that the rate limit may stretch it to: a stop is a stop


def ramp_down(torque: np.ndarray, ramp_time: float,
              rate_limit: np.ndarray) -> Iterator[np.ndarray]:
    """Yield the torques every ``RAMP_STEP`` from ``torque`` down, without the zero at the end.

    Args:
        torque: Commanded last, shape (n,) [N·m].
        ramp_time: Duration of the ramp [s]; longer where ``rate_limit`` asks for it.
        rate_limit: Largest rate of change, shape (n,) [N·m/s].
    """
    needed = float((np.abs(torque) / rate_limit).max())
    steps = math.ceil(max(ramp_time, min(needed, LONGEST_RAMP)) / RAMP_STEP - ROUNDING)
    for left in range(steps - 1, 0, -1):
        yield torque * (left / steps)
