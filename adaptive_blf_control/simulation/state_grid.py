# SPDX-License-Identifier: Apache-2.0
"""When states are due: on the grid of the rate. Periods that passed unseen are missed."""

from __future__ import annotations

__all__ = ['StateGrid']


class StateGrid:
    """Times of the states, one a period, by one clock in whole nanoseconds.

    Where the machine is late, periods are missed, not squeezed: the next state is the newest that
    is due.

    Attributes:
        period_ns: Interval between two states [ns].
        missed: Periods in which no state was asked for.
    """

    def __init__(self, rate: float) -> None:
        """Take the rate [Hz]; no grid is laid yet."""
        self.period_ns = round(1e9 / rate)
        self.missed = 0
        self._due_ns: int | None = None

    @property
    def laid(self) -> bool:
        """Whether a grid is laid."""
        return self._due_ns is not None

    def begin(self, now_ns: int) -> None:
        """Lay the grid; its first state is due at ``now_ns`` [ns]."""
        self._due_ns = now_ns

    def end(self) -> None:
        """Take the grid away: nothing is due any longer."""
        self._due_ns = None

    def left(self, now_ns: int) -> float:
        """Return the time until a state is due [s], 0 where one is or no grid is laid."""
        return 0.0 if self._due_ns is None else max(self._due_ns - now_ns, 0) * 1e-9

    def take(self, now_ns: int) -> int | None:
        """Return when the state was due that is to be sent at ``now_ns`` [ns]; None: not yet."""
        if self._due_ns is None or now_ns < self._due_ns:
            return None
        late = (now_ns - self._due_ns) // self.period_ns
        self.missed += late
        due_ns = self._due_ns + late * self.period_ns
        self._due_ns = due_ns + self.period_ns
        return due_ns

    def retune(self, rate: float) -> bool:
        """Take another rate [Hz], counted from the last state on; False where it is the same."""
        period_ns = round(1e9 / rate)
        if period_ns == self.period_ns:
            return False
        if self._due_ns is not None:
            self._due_ns += period_ns - self.period_ns
        self.period_ns = period_ns
        return True
