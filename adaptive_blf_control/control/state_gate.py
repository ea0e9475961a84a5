# SPDX-License-Identifier: Apache-2.0
"""Joint states that can be answered: finite, and in the order of their stamps."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.compiled import both_finite, entry_for
from adaptive_blf_control.control.refusal import Refusal

__all__ = ['StateGate']

OUT_OF_ORDER = 'joint state out of order'


class StateGate:
    """Lets the joint states of a motion through, one after the other.

    A stamp far ahead of the last one counts once a second state confirms it: one wild stamp would
    otherwise throw the reference ahead and make every later state old.

    Attributes:
        last_ns: Stamp of the state answered last [ns], None before the first.
    """

    def __init__(self, joints: tuple[str, ...]) -> None:
        """Take the names of the joints, for messages."""
        self.last_ns: int | None = None
        self._joints = joints
        nothing = np.zeros(len(joints))
        self._both_finite = entry_for(both_finite, nothing, nothing)  # compiled before any sample
        self._ahead_ns: int | None = None  # stamp far ahead that waits to be confirmed

    def take(self, stamp: int) -> None:
        """Note that the state with this stamp [ns] is answered."""
        self.last_ns = stamp

    def not_finite(self, q: np.ndarray, qd: np.ndarray) -> Refusal | None:
        """Refuse positions (n,) [rad] and velocities (n,) [rad/s] that are not all finite.

        Both are contiguous float64.
        """
        if self._both_finite(q, qd):
            return None
        i = int(np.argmin(np.isfinite(q) & np.isfinite(qd)))
        return Refusal('non-finite joint state',
                       f'joint {self._joints[i]!r}: {q[i]:g} rad, {qd[i]:g} rad/s')

    def repeated(self, stamp: int) -> Refusal | None:
        """Refuse the stamp [ns] answered last: from a source that has stopped."""
        if stamp != self.last_ns:
            return None
        return Refusal(OUT_OF_ORDER, f'stamp {stamp} ns again')

    def out_of_order(self, stamp: int, longest: float) -> Refusal | None:
        """Refuse a stamp [ns] that is not later than the last one, or too far ahead of it.

        Args:
            stamp: Of a state during a motion.
            longest: Time between two states that is not too far ahead [s].
        """
        if self.last_ns is None:
            return None
        ahead = stamp - self.last_ns
        if ahead <= 0:
            return Refusal(OUT_OF_ORDER, f'stamp {stamp} ns after {self.last_ns} ns')
        longest_ns, waiting = longest * 1e9, self._ahead_ns
        if ahead > longest_ns and (waiting is None or not 0 < stamp - waiting <= longest_ns):
            self._ahead_ns = stamp
            return Refusal('stamp jumps ahead', f'{ahead * 1e-9:.6g} s after the last one')
        self._ahead_ns = None
        return None

    def jumped(self, stamp: int, longest: float) -> bool:
        """Whether an admitted stamp [ns] goes on on a clock that has jumped ahead and stays so."""
        return self.last_ns is not None and stamp - self.last_ns > longest * 1e9
