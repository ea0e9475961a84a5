# SPDX-License-Identifier: Apache-2.0
"""A measured log as a file or bag gives it, before rows that cannot be used are left out."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

__all__ = ['RawLog']


class RawLog(NamedTuple):
    """All rows of a source, N of them, for n joints.

    Attributes:
        joints: Joint names, or None where the source has none.
        clock: Times, shape (N,), integers or floats.
        per_second: How much the clock advances in a second.
        table: Positions [rad], then velocities [rad/s] where there are any, then torques [N·m],
            shape (N, 3 n) or (N, 2 n); NaN where there is no value.
        n: Number of joints.
        velocity: Whether there are velocities.
        skipped: Rows that could not be read at all.
        notes: What was assumed or is odd, in sentences.
        problem: Why the source ends early, or None.
    """

    joints: tuple[str, ...] | None
    clock: np.ndarray
    per_second: float
    table: np.ndarray
    n: int
    velocity: bool
    skipped: int
    notes: tuple[str, ...]
    problem: str | None
