# SPDX-License-Identifier: Apache-2.0
"""Where the links of a planar arm are, for drawing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

__all__ = ['planar_points']


def planar_points(q: np.ndarray, lengths: Sequence[float]) -> np.ndarray:
    """Return the base and the far end of every link, shape (n + 1, 3) [m], in the x-y plane.

    Args:
        q: Joint positions, each relative to the link before, shape (n,) [rad].
        lengths: Link lengths, length n [m].
    """
    angles = np.cumsum(np.asarray(q, dtype=float))
    steps = np.column_stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)])
    ends = np.cumsum(steps * np.array(lengths)[:, None], axis=0)
    return np.vstack([np.zeros((1, 3)), ends])
