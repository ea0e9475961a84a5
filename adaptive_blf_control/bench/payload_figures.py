# SPDX-License-Identifier: Apache-2.0
"""How soon a load was found in one run, and what its model was worth meanwhile."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.identification.payload import PayloadEstimate, PayloadEstimator

__all__ = ['CLOSE', 'LoadRun', 'LoadWatch', 'ratios']

CLOSE = 0.05
"""Part of the mass that an estimate may be off by."""
_WINDOW = 1.0  # s over which predictions are compared


class LoadRun(NamedTuple):
    """Figures of a run; times in s from the attachment on.

    Attributes:
        noticed: When a load was reported.
        close: From when on the mass stayed within `CLOSE` of what it should be; infinite where
            it did not.
        mass: The last mass [kg].
        overall: Largest ratio of the RMS error of the predicted torque since the attachment to
            that of the model without the load, over all times: at most 1 where it never lost.
        meanwhile: The same within windows of a second, from the attachment until the mass is
            ``close`` to what it should be.
        window: The same within all windows of a second.
    """

    noticed: float
    close: float
    mass: float
    overall: float
    meanwhile: float
    window: float


class LoadWatch:
    """Feeds an estimator and notes what it says from an attachment on."""

    def __init__(self, found: PayloadEstimator, attached: float) -> None:
        """Watch ``found`` while a load is attached at ``attached`` [s]."""
        self.found, self._attached = found, attached
        self._said: list[tuple[float, PayloadEstimate]] = []
        self._errors: list[tuple[float, float, float]] = []

    def take(self, t: float, regressor: np.ndarray, torque: np.ndarray) -> None:
        """Take a pair of settled filters at ``t`` [s], arguments as of the estimator."""
        if t >= self._attached:
            error = torque - regressor @ self.found.baseline
            left = error - self.found.added_torque(regressor)
            self._errors.append((t, float(error @ error), float(left @ left)))
        if self.found.take(t, regressor, torque) and self.found.estimate is not None:
            self._said.append((t, self.found.estimate))

    def figures(self, mass: float, until: float = np.inf) -> LoadRun:
        """Return the figures for a load of ``mass`` [kg] that is there ``until`` [s]."""
        said = [(t - self._attached, each) for t, each in self._said
                if self._attached <= t <= until]
        times = np.array([t for t, _ in said])
        off = np.array([abs(each.load.mass / mass - 1.0) > CLOSE for _, each in said])
        first = int(np.flatnonzero(off)[-1]) + 1 if off.any() else 0
        close = float(times[first]) if first < len(times) else np.inf
        return LoadRun(
            next((t for t, each in said if each.attached), np.inf), close,
            said[-1][1].load.mass,
            *ratios([row for row in self._errors if row[0] <= until], close))

    def removed(self, since: float) -> float:
        """Return how long after a removal at ``since`` [s] no load was reported any more [s]."""
        still = [t for t, each in self._said if t >= since and each.attached]
        after = [t for t, each in self._said if t > max([since, *still])]
        return after[0] - since if after else np.inf


def ratios(errors: Sequence[tuple[float, float, float]],
           close: float = np.inf) -> tuple[float, float, float]:
    """Return `LoadRun.overall`, `LoadRun.meanwhile` and `LoadRun.window`.

    Args:
        errors: Time [s] and square of the error of the predicted torque [N²·m²], without and with
            the load, of all samples.
        close: From when on the mass is what it should be, counted from the first sample [s]; the
            first window is looked at in any case.
    """
    table = np.array(errors)
    t, summed = table[:, 0] - table[0, 0], np.cumsum(table[:, 1:], axis=0)
    overall = np.sqrt(summed[:, 1] / np.maximum(summed[:, 0], 1e-300)).max()
    begin = np.searchsorted(t, t - _WINDOW)
    whole = t >= _WINDOW
    within = (summed - summed[begin])[whole]
    window = np.sqrt(within[:, 1] / np.maximum(within[:, 0], 1e-300))
    meanwhile = window[t[whole] <= max(close, t[whole].min(initial=np.inf))]
    return float(overall), float(meanwhile.max(initial=0.0)), float(window.max(initial=0.0))
