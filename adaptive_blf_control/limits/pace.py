# SPDX-License-Identifier: Apache-2.0
"""How fast the path of a reference may be followed so that velocity and torque suffice.

The reference is y_d(σ(t)) with 0 ≤ σ̇ ≤ 1 and |σ̈| ≤ D(σ). At points of the path ahead the largest σ̇
is looked for with which, for every θ of the set,

    |Y(y, σ̇ y', σ̇² y'') θ| + D |M y'| ≤ ρ τ̄,    σ̇ |y'| ≤ ρ_v v̄,

D being 2/s, or half of what the torque that holds the arm there leaves for it: with more, a point
could be passed at no rate, and the path would end before it. σ̇² ≤ σ̇_j² + 2 ∫D dσ up to each of the
points lets the path slow down in time, and come to rest before the first one that nobody has seen.
Where e1 comes near its bound the path slows down, too, and harder.
"""

from __future__ import annotations

from collections.abc import Callable
import math

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.control.reference import Reference
from adaptive_blf_control.limits.prior import Prior

__all__ = ['NEAR', 'NEARER', 'Pace', 'slowed']

AHEAD = 40  # points of the path that are looked at
STEP = 0.02  # between them [s]
CHANGE = 2.0  # largest D [1/s]
LEAST_CHANGE = 0.1  # a point that leaves less torque for D is not passed [1/s]
SHARE = 0.5  # of the D that the torque at rest leaves: the rest is for σ̇
HARDER = 5.0  # times the largest D where e1 comes near its bound
TORQUE_PART, SPEED_PART = 0.85, 0.9  # ρ and ρ_v: the rest is for the law
SMOOTHING = 0.005  # time constant of σ̇ [s]
HALVINGS = 5
AGAIN = 4  # points that are looked at again with one sample where the set of θ has changed
NEAR, NEARER = 0.4, 0.8  # parts of the bound of e1 between which the path slows down to rest


class Pace:
    """Path time of a reference.

    Attributes:
        time: σ [s].
        rate: σ̇.
        change: σ̈ [1/s].
    """

    def __init__(self, arm: Arm, known: Prior, speed: np.ndarray, torque: np.ndarray, *,
                 slowly: bool = True) -> None:
        """Take the arm.

        Args:
            arm: The arm.
            known: The set that its θ* is in.
            speed: Largest velocities, shape (n,) [rad/s].
            torque: Largest torques, shape (n,) [N·m].
            slowly: Whether D may be less than 2/s; else a posture that leaves no torque for that
                is not passed.
        """
        self._share, self._least = (SHARE, LEAST_CHANGE) if slowly else (1.0, CHANGE)
        self._arm, self._known = arm, known
        self._speed, self._torque = SPEED_PART * speed, TORQUE_PART * torque
        self.time, self.rate, self.change = 0.0, 1.0, 0.0
        self._t: float | None = None
        self._lag = 0.0  # t − σ: where it is zero σ is t bit for bit
        self._of: Reference | None = None
        self._first = 0
        self._points = np.zeros((0, 2))  # σ̇ and D of those that are looked at, from the first on
        self._again = 0  # how many of these, from the last one, are of a set before

    def advance(self, t: float, reference: Reference, nearness: float) -> None:
        """Go on along the path.

        Args:
            t: Time of the sample [s]; the first one is on the path at that time.
            reference: The path.
            nearness: Largest |e1| in units of its bound, at the last sample.
        """
        dt = 0.0 if self._t is None else t - self._t
        before, self._t = t - dt - self._lag, t
        first = max(int(before / STEP), 0)
        kept = self._points[max(first - self._first, 0):]
        if reference is not self._of or first < self._first:
            self._of, kept = reference, kept[:0]
        if first != self._first or len(kept) <= AHEAD:
            self._first, self._points = first, np.concatenate((kept, [
                self._largest(reference, (first + j) * STEP)
                for j in range(len(kept), AHEAD + 1)]))
        self._look_again(reference)
        allowed, most = self._allowed(before - first * STEP)
        part = slowed(nearness)
        hardest = HARDER * CHANGE if part < 1.0 else most
        wanted = (allowed * part - self.rate) / SMOOTHING
        self.change = min(max(wanted, -hardest), most) if dt > 0.0 else 0.0
        rate = min(max(self.rate + dt * self.change, 0.0), 1.0)
        self.change = (rate - self.rate) / dt if dt > 0.0 else 0.0
        self._lag += dt * (1.0 - 0.5 * (self.rate + rate))
        self.time, self.rate = t - self._lag, rate

    def _allowed(self, beyond: float) -> tuple[float, float]:
        """Return the largest σ̇ and D at a σ that is ``beyond`` [s] the first point."""
        rates, changes = self._points.T
        between = np.minimum(changes[:-1], changes[1:])
        lost = np.zeros(changes.size)  # of σ̇² on the way
        np.cumsum(2.0 * STEP * between, out=lost[1:])
        lost -= 2.0 * between[0] * beyond
        square = min((rates ** 2 + np.maximum(lost, 0.0)).min(), lost[-1])
        return min(1.0, math.sqrt(max(square, 0.0))), float(between[0])

    def narrow(self, known: Prior) -> None:
        """Take another set of θ; the points ahead are looked at again with the next samples."""
        self._known, self._again = known, AHEAD + 1

    def _look_again(self, reference: Reference) -> None:
        """Look at some of the points whose σ̇ and D are of a set before, the nearest first."""
        if self._again == 0:
            return
        points = self._points = self._points.copy()  # a copy of this pace may go on from the old
        begin = len(points) - min(self._again, len(points))
        end = min(begin + AGAIN, len(points))
        for j in range(begin, end):
            points[j] = self._largest(reference, (self._first + j) * STEP)
        self._again = len(points) - end

    def set_clock(self, t: float) -> None:
        """Go on from the same place with a clock that now shows ``t`` [s]."""
        self._t, self._lag = t, t - self.time

    def go_on_from(self, before: Pace) -> None:
        """Take path time and rate from another pace."""
        self.time, self.rate, self.change = before.time, before.rate, before.change
        self._t, self._lag = before._t, before._lag

    def _largest(self, reference: Reference, at: float) -> tuple[float, float]:
        """Return the largest σ̇ at a point of the path, 0 where even rest asks too much, and D."""
        y, slope, bend = reference.at(at)
        rest = np.zeros_like(y)
        still = self._arm.X(y, rest, rest, rest)
        faster = self._most(self._arm.X(y, rest, rest, slope) - still)
        left = float(((self._torque - self._most(still)) / np.maximum(faster, 1e-9)).min())
        most = min(CHANGE, self._share * left)
        if most < self._least:
            return 0.0, CHANGE
        change = most * faster

        def fits(rate: float) -> bool:
            speed = rate * slope
            rows = self._arm.X(y, speed, speed, rate * rate * bend)
            return bool((self._most(rows) + change <= self._torque).all())

        quickest = float(np.min(self._speed / np.maximum(np.abs(slope), 1e-9)))
        return _bisected(fits, min(1.0, quickest)), most

    def _most(self, rows: np.ndarray) -> np.ndarray:
        """Return the largest torque of the set, (n, m) → (n,) [N·m]."""
        return np.abs(rows @ self._known.centre) + self._known.support(rows)


def slowed(nearness: float) -> float:
    """Return the part of its rate that e1 leaves, its largest being ``nearness`` of its bound."""
    return min(1.0, max(0.0, (NEARER - nearness) / (NEARER - NEAR)))


def _bisected(fits: Callable[[float], bool], high: float) -> float:
    if fits(high):
        return high
    low = 0.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if fits(middle) else (low, middle)
    return low
