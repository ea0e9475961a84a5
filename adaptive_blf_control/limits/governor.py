# SPDX-License-Identifier: Apache-2.0
"""The reference governor: slows the reference down, and leads it round obstacles.

Where there are obstacles the reference is a motion (y, ẏ) of its own that is drawn to the path by
ÿ = ÿ_p + k_d (ẏ_p − ẏ) + k_p (y_p − y), nearest to which its acceleration is chosen as the filter
does it: within the safety set less the performance set, the velocities, the stops before
obstacles and out of the way of what moves. Its acceleration is what it is told, so that nothing is
uncertain in it. Where e1 comes near its bound it slows down as the path does.
"""

from __future__ import annotations

import copy
import math
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.compiled import Handle, handle, jit
from adaptive_blf_control.control.reference import full_range, Reference, ReferencePoint
from adaptive_blf_control.control.safety_filter import Governed
from adaptive_blf_control.control.sets import Bounds, TOLERANCE
from adaptive_blf_control.limits.acceleration_error import Posture
from adaptive_blf_control.limits.filter_look import FilterParts, Moment, Scene, Stop, stop_after
from adaptive_blf_control.limits.filter_step import filter_step
from adaptive_blf_control.limits.pace import NEAR, NEARER, Pace, slowed
from adaptive_blf_control.limits.prior import Prior

__all__ = ['Deflection', 'Governor', 'LEAD', 'SPEED_PART']

STIFFNESS, DAMPING = 100.0, 20.0  # k_p [1/s²], k_d [1/s]
HARDEST = 4.0  # how far its acceleration may be from the path's, in units of the braking
FAR, FARTHER = 0.3, 0.6  # distances from the path between which it waits [rad]
COMING = 1.0  # velocity towards the path from which on it waits for all it may [rad/s]
LEAD = 0.4  # by which it gives way to what comes before the filter does [s]
LEAST = 0.6  # of its rate that the path keeps while it waits
LONGEST_SAMPLE = 0.1  # a longer time between two samples is a jump of the clock [s]
LONGEST_STEP = 0.02  # of the deflection, which is a spring of 10 rad/s with a damper [s]
SPEED_PART = 0.95  # of the largest velocity; more than the path has, so that it catches up


class Deflection:
    """The motion of the reference beside its path.

    Attributes:
        position: y, shape (n,) [rad].
        velocity: ẏ, shape (n,) [rad/s].
    """

    def __init__(self, parts: FilterParts, period: float, begin: ReferencePoint) -> None:
        """Begin on the path; ``period``: for how long the filter takes a torque to be held [s]."""
        n = begin.position.size
        unit, none = np.eye(n), np.zeros((n, n))
        self._exact = parts._replace(exact=True,
                                     given=Posture(unit, np.zeros(n), unit, unit, none))
        self._period = period
        self._hardest = HARDEST * parts.limits.braking
        self.position, self.velocity = begin.position.copy(), begin.velocity.copy()
        self._stop = self._now()
        self.look(parts.scene)

    def look(self, scene: Handle) -> None:
        """Take another scene, see `Governor.look`."""
        self._parts = handle(self._exact._replace(scene=scene))

    def awaited(self, path: ReferencePoint) -> float:
        """Return how much the path is to wait for it, from 0 to 1.

        A path that waits while nothing comes nearer would wait for ever: what is in the way now
        is not further on.
        """
        way = path.position - self.position
        joint = int(np.abs(way).argmax())
        off, coming = abs(way[joint]), np.sign(way[joint]) * self.velocity[joint]
        wait = min(max((off - FAR) / (FARTHER - FAR), 0.0), 1.0 - LEAST)
        return float(wait * min(max(coming / COMING, 0.0), 1.0))

    def advance(self, dt: float, path: ReferencePoint, part: float) -> ReferencePoint:
        """Go on for a sample after which the path is at ``path``; return where it is then.

        Args:
            dt: Length of the sample [s].
            path: The path.
            part: How much of what leads to the path counts, from 0 to 1; the rest comes to rest.
        """
        steps = max(math.ceil(dt / LONGEST_STEP), 1)
        for _ in range(steps):
            self.position, self.velocity, acceleration, self._stop = _drawn(
                self._parts, path, part, self._hardest, self._period, dt / steps, self._now(),
                self._stop)
        return ReferencePoint(self.position, self.velocity, acceleration)

    def _now(self) -> Stop:
        return Stop(self.position, self.velocity, np.zeros_like(self.position))


@jit
def _drawn(parts: Handle, path: ReferencePoint, part: float, hardest: np.ndarray, period: float,
           dt: float, now: Stop, left: Stop,
           ) -> tuple[np.ndarray, np.ndarray, np.ndarray, Stop]:
    """Draw a reference to its path for one step.

    The program knows how long the step is, however late the sample was: a stop is still free
    after it.

    Args:
        parts: Handle of what the reference has to keep, see `FilterParts`.
        path: Where the path is after the step.
        part: See `Deflection.advance`.
        hardest: How far the acceleration may be from the path's, shape (n,) [rad/s²].
        period: Shortest time that the program takes the acceleration to be held [s].
        dt: Length of the step [s].
        now: Where the reference is.
        left: Where it is on the stop that the step before has left.

    Returns:
        Position, velocity and acceleration after it, each (n,), and the stop that is left.
    """
    y, yd = now.position, now.velocity
    wanted, least, most = np.empty(y.size), np.empty(y.size), np.empty(y.size)
    for j in range(y.size):
        pull = (path.acceleration[j] + DAMPING * (path.velocity[j] - yd[j])
                + STIFFNESS * (path.position[j] - y[j]))
        pull = part * pull - (1.0 - part) * DAMPING * yd[j]
        least[j] = min(path.acceleration[j], 0.0) - hardest[j]
        most[j] = max(path.acceleration[j], 0.0) + hardest[j]
        wanted[j] = min(max(pull, least[j]), most[j])
    report = filter_step(parts, Moment(y, yd, least, most, max(period, dt)), wanted, left, 0.0)
    a = report.acceleration
    return y + dt * (yd + 0.5 * dt * a), yd + dt * a, a, stop_after(report.stop, dt)


class Governor:
    """Path time and deflection of one motion.

    Attributes:
        pace: Of the path.
        waits: Whether the path comes to rest, whatever allows it to go on.
    """

    def __init__(self, pace: Pace, parts: FilterParts, period: float) -> None:
        """Take the pace, and the filter with the limits that the reference is to keep.

        Args:
            pace: Of the path.
            parts: The filter.
            period: For how long it takes a torque to be held [s].
        """
        self.pace = pace
        self._parts, self._period = parts, period
        self._deflection: Deflection | None = None
        self._last: _Last | None = None
        self._off = 0.0
        self.waits = False
        self._of: Reference | None = None
        self._beyond = False

    def look(self, scene: Scene) -> None:
        """Take another scene."""
        self._parts = self._parts._replace(scene=handle(scene))
        if self._deflection is not None:
            self._deflection.look(self._parts.scene)

    def narrow(self, model: Handle, known: Prior) -> None:
        """Take another set of θ: the `Model` with it, and the set."""
        self._parts = self._parts._replace(model=model)
        self.pace.narrow(known)

    @property
    def off(self) -> float:
        """How far the reference was from its path at the last sample [rad]."""
        return self._off

    def governed(self, t: float, q: np.ndarray, reference: Reference) -> Governed:
        """Return the reference at ``t`` [s], the arm being at q, shape (n,) [rad].

        Where the clock jumps, ahead or back, the path waits for that sample and goes on from
        where it is.
        """
        pace, last = self.pace, self._last
        if last is not None and abs(t - last.t) > LONGEST_SAMPLE:
            pace.set_clock(t)
            self._last = last._replace(t=t)
            return last.governed
        if last is not None and t <= last.t:
            return last.governed
        nearness = 0.0 if last is None or last.bounds is None else _nearness(
            q - last.governed.point.position, last.bounds)
        dt = 0.0 if last is None else t - last.t
        wait = 0.0
        if self._deflection is not None:
            wait = self._deflection.awaited(reference.at(pace.time))
        wait = 1.0 if self.waits else wait
        pace.advance(t, reference, max(nearness, NEAR + (NEARER - NEAR) * wait))
        path = _paced(reference.at(pace.time), pace)
        point = path
        scene: Scene = self._parts.scene.value
        if (self._deflection is not None or len(scene.pairs) or len(scene.coming)
                or self._leaves(reference)):
            if self._deflection is None:
                self._deflection = Deflection(self._parts, self._period, path)
            if dt > 0.0:
                point = self._deflection.advance(dt, path, slowed(nearness))
        self._off = float(np.abs(point.position - path.position).max())
        result = Governed(point, pace.time, pace.rate)
        self._last = _Last(t, result, None)
        return result

    def _leaves(self, reference: Reference) -> bool:
        """Return whether a reference goes where there is no room for e1."""
        if reference is not self._of:
            lower, upper = full_range(reference)
            limits = self._parts.limits
            self._beyond = bool((lower < limits.lower - TOLERANCE).any()
                                or (upper > limits.upper + TOLERANCE).any())
            self._of = reference
        return self._beyond

    def __copy__(self) -> Governor:
        """Return a governor that goes on from here without a trace in this one."""
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__)
        other.pace = copy.copy(self.pace)
        other._deflection = copy.copy(self._deflection)
        return other

    def go_on_from(self, before: Governor) -> None:
        """Take place and speed from the governor that is replaced."""
        self.pace.go_on_from(before.pace)
        self._last = before._last
        if before._deflection is not None and self._last is not None:
            self._deflection = Deflection(self._parts, self._period,
                                          self._last.governed.point)

    def heed(self, bounds: Bounds) -> None:
        """Take the performance bounds of this sample."""
        if self._last is not None:
            self._last = self._last._replace(bounds=bounds)


class _Last(NamedTuple):
    """What the sample before was answered."""

    t: float
    governed: Governed
    bounds: Bounds | None


def _paced(point: ReferencePoint, pace: Pace) -> ReferencePoint:
    """Return a point of the path as it is passed at a pace."""
    return ReferencePoint(point.position, pace.rate * point.velocity,
                          pace.rate ** 2 * point.acceleration + pace.change * point.velocity)


def _nearness(e1: np.ndarray, bounds: Bounds) -> float:
    """Return the largest |e1| in units of its bound."""
    return float((np.abs(e1) / np.where(e1 > 0.0, bounds.upper, -bounds.lower)).max())
