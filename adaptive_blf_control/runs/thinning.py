# SPDX-License-Identifier: Apache-2.0
"""Thins curves to few points and keeps every extreme."""

from __future__ import annotations

import numpy as np

__all__ = ['POINTS', 'thin']

POINTS = 2000  # drawn per curve


def thin(t: np.ndarray, y: np.ndarray, points: int = POINTS) -> tuple[np.ndarray, np.ndarray]:
    """Thin a curve to about ``points``: first, last, least and largest value of each section.

    Args:
        t: Times, shape (N,).
        y: Values, shape (N,); NaN is never preferred to a number.
        points: Roughly how many points are kept; a shorter curve is returned as it is.

    Returns:
        The kept times and values, in their order.
    """
    if t.size <= points:
        return t, y
    low, high = np.where(np.isnan(y), np.inf, y), np.where(np.isnan(y), -np.inf, y)
    starts = np.linspace(0, t.size, points // 2 + 1).astype(int)
    keep = [0, t.size - 1]
    for begin, end in zip(starts[:-1], starts[1:]):
        keep += [begin + int(np.argmin(low[begin:end])), begin + int(np.argmax(high[begin:end]))]
    index = np.unique(keep)
    return t[index], y[index]
