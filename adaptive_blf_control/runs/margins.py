# SPDX-License-Identifier: Apache-2.0
"""Distances to the bounds of both sets along a recorded run."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptive_blf_control.runs.recording import Recording

__all__ = ['Margins', 'margins_of']


class Margins(NamedTuple):
    """Margins over time.

    Attributes:
        t: Shape (N,) [s].
        values: Distance to the nearer bound of each set, shape (N, sets, n) [rad].
        sets: Names of the sets.
    """

    t: np.ndarray
    values: np.ndarray
    sets: tuple[str, ...]


def margins_of(recording: Recording) -> Margins | None:
    """Return the margins from positions and errors, else as the controller published them."""
    answered, safety, performance = recording.answered, recording.safety, recording.performance
    if answered is not None and safety is not None and performance is not None:
        both = np.stack([safety.margin(answered.q), performance.margin(answered.e1)], axis=1)
        return Margins(answered.t, both, ('safety', 'performance'))
    if recording.margins is not None:
        return Margins(recording.margins.t, recording.margins.values[:, None, :], ('nearer',))
    return None
