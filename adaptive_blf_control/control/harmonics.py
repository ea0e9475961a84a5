# SPDX-License-Identifier: Apache-2.0
"""Between which values a sum of sinusoids stays."""

from __future__ import annotations

import numpy as np

__all__ = ['extremes']

_EXACT = 1e-12  # relative: multiples of one frequency as far as a double can tell
_HIGHEST = 200  # multiple that is looked at
_SAMPLES = 64  # of a period of the highest harmonic


def extremes(amplitude: np.ndarray, frequency: np.ndarray,
             phase: np.ndarray) -> tuple[float, float]:
    """Return bounds that Σ_k amplitude_k sin(frequency_k t + phase_k) never leaves.

    ∓ Σ |amplitude|, which several frequencies approach in the long run; where all are multiples
    of the smallest, the sum has a period, and the bounds are those of one. Between two samples h
    apart it is at most h²/8 max |ÿ| beyond them.

    Args:
        amplitude: Shape (K,).
        frequency: Shape (K,) [rad/s].
        phase: Shape (K,) [rad].
    """
    reach = float(np.sum(np.abs(amplitude)))
    base = float(np.min(np.abs(frequency), initial=np.inf))
    if reach == 0.0 or not 0.0 < base < np.inf:  # a term of zero frequency counts like others
        return -reach, reach
    multiples = np.abs(frequency) / base
    if np.any(np.abs(multiples - np.round(multiples)) > _EXACT * multiples) or (
            multiples.max() > _HIGHEST):
        return -reach, reach
    count = _SAMPLES * int(round(multiples.max()))
    step = 2.0 * np.pi / base / count
    values = np.sin(np.outer(np.arange(count) * step, frequency) + phase) @ amplitude
    beyond = float(np.sum(np.abs(amplitude) * frequency ** 2)) * step ** 2 / 8.0
    return max(-reach, float(values.min()) - beyond), min(reach, float(values.max()) + beyond)
