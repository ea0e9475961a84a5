# SPDX-License-Identifier: Apache-2.0
"""Times of samples that a motion cannot have: what is answered then, and what is said of them."""

from __future__ import annotations

from collections.abc import Iterator
import math
import warnings

import numpy as np

from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.time_units import epoch_unit, question, SLOWEST, unit_of_period, UNITS

__all__ = ['OddTimes']


class OddTimes:
    """What was odd about the times of a motion's samples."""

    def __init__(self) -> None:
        """Begin without a sample."""
        self._set_back: tuple[float, float] | None = None
        self._leap: tuple[float, float] | None = None
        self._warned = False

    def answered(self, t: float, last: np.ndarray) -> float:
        """Return the time to answer at.

        Args:
            t: Time of a sample that is the first one, late, or not after the last one [s].
            last: That of the last sample, NaN for none, shape (1,) [s]; set where the motion
                begins without a time.

        Raises:
            ParameterError: the motion would begin years after its start.
        """
        before, first = float(last[0]), math.isnan(last[0])
        if not math.isfinite(t):
            if first:  # the motion begins now, without a torque
                last[0] = before = 0.0
            return before
        if first and (unit := epoch_unit(t)) is not None:
            raise ParameterError('t', t, f'a time since the start of the motion, 0 at its first '
                                 f'sample, not since 1970: (t - t0) / {UNITS[unit]:g}')
        if t < before:
            self._set_back = before, t
        elif t - before > SLOWEST and self._leap is None:
            self._leap = before, t
        return t

    def warn(self) -> None:
        """Warn once of a leap, where ``Controller.update`` is called; a node has its own words."""
        if self._leap is not None and not self._warned:
            self._warned = True
            warnings.warn(next(self.notes()), stacklevel=4)

    def notes(self) -> Iterator[str]:
        """Yield what was odd, in sentences."""
        if self._leap is not None:
            before, t = self._leap
            unit = unit_of_period(t - before)
            yield (f'the time went on by {t - before:.6g} s in one sample, from {before:.6g} to '
                   f'{t:.6g} s: the reference was left behind'
                   + (f'; {question(unit)}' if unit != 's' else ''))
        if self._set_back is not None:
            yield ('the time went back from {:.6g} to {:.6g} s: begin(q, qd) begins another '
                   'motion'.format(*self._set_back))
