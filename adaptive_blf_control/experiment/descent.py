# SPDX-License-Identifier: Apache-2.0
"""Quasi-Newton descent with limited memory (L-BFGS; Nocedal and Wright, algorithm 7.4)."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np

__all__ = ['descend']

MEMORY = 12
DECREASE = 1e-4  # Armijo
HALVINGS = 12
ENOUGH = 1e-5  # relative to 1: less than this over `STALLED` steps ends the descent
STALLED = 8


def descend(value: Callable[[np.ndarray], float],
            gradient: Callable[[np.ndarray], np.ndarray], start: np.ndarray,
            steps: int, report: Callable[[int, float], None] | None = None) -> np.ndarray:
    """Return a point with a lower value, at most ``steps`` quasi-Newton steps from ``start``.

    Args:
        value: Of a point, shape (d,).
        gradient: At a point, shape (d,); called after ``value`` at the same point.
        start: Shape (d,).
        steps: Largest number of steps.
        report: Called with the number of steps done and the value.
    """
    x, memory = start.copy(), deque[tuple[np.ndarray, np.ndarray]](maxlen=MEMORY)
    best, slope = value(x), gradient(x)
    recent = deque[float]([best], maxlen=STALLED)
    for step in range(steps):
        direction = -_solved(memory, slope)
        if direction @ slope >= 0.0:
            memory.clear()
            direction = -slope
        length = 1.0 if memory else min(1.0, 0.05 / max(float(np.abs(slope).max()), 1e-12))
        for _ in range(HALVINGS):
            tried = x + length * direction
            there = value(tried)
            if there <= best + DECREASE * length * float(direction @ slope):
                break
            length *= 0.5
        else:
            if not memory:
                break
            memory.clear()
            continue
        new = gradient(tried)
        if (tried - x) @ (new - slope) > 1e-12:
            memory.append((tried - x, new - slope))
        x, best, slope = tried, there, new
        if report is not None:
            report(step + 1, best)
        if len(recent) == STALLED and recent[0] - best < ENOUGH:
            break
        recent.append(best)
    return x


def _solved(memory: deque[tuple[np.ndarray, np.ndarray]], slope: np.ndarray) -> np.ndarray:
    """Return H slope with the inverse Hessian H that the remembered steps tell of."""
    rest, parts = slope.copy(), []
    for s, y in reversed(memory):
        part = float(s @ rest) / float(s @ y)
        parts.append(part)
        rest = rest - part * y
    if memory:
        s, y = memory[-1]
        rest = rest * (float(s @ y) / float(y @ y))
    for (s, y), part in zip(memory, reversed(parts)):
        rest = rest + (part - float(y @ rest) / float(s @ y)) * s
    return rest
