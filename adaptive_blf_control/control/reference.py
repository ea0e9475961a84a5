# SPDX-License-Identifier: Apache-2.0
"""Reference trajectories y_d(t) with two exact derivatives (Assumption 1: bounded)."""

from __future__ import annotations

import functools
from typing import Any, NamedTuple, Protocol

import numpy as np

from adaptive_blf_control.arrays import checked_array, checked_number, dimensions, record
from adaptive_blf_control.calls import checked_call, without_argument
from adaptive_blf_control.compiled import borrowed, cos_sin, Handle, handle, jit, uncompiled
from adaptive_blf_control.control.harmonics import extremes
from adaptive_blf_control.errors import ParameterError, with_hints
from adaptive_blf_control.parameters.guided import Guided

__all__ = ['Crossfade', 'Posture', 'Reference', 'ReferencePoint', 'Sinusoids', 'SmoothStart',
           'SumOfSinusoids', 'along', 'from_time', 'full_range', 'hull', 'quintic',
           'write_sinusoids']

Range = tuple[np.ndarray, np.ndarray]
DEEPEST = 16  # crossfades that may be under way at once
SHORTEST = 1e-9  # of a blend time, the step of ROS time [s]


@record
@functools.partial(with_hints, instead={
    **dict.fromkeys(('q', 'y_d', 'yd', 'value'), 'position is y_d'),
    **dict.fromkeys(('qd', 'yd_dot', 'rate'), 'velocity is its derivative'),
    **dict.fromkeys(('qdd', 'yd_ddot'), 'acceleration is its second derivative')})
class ReferencePoint(NamedTuple):
    """Reference at one instant: position [rad], velocity [rad/s], acceleration [rad/s²], (n,)."""

    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray


class Reference(Protocol):
    """A twice differentiable trajectory, with the range it never leaves."""

    def at(self, t: float) -> ReferencePoint:
        """Evaluate at ``t`` [s] since the start of the motion."""
        ...

    def range(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the least and the largest position, each of shape (n,) [rad].

        Assumption 1 writes them −y̲_d and ȳ_d: the first is negative for a motion around zero.
        """
        ...


class Sinusoids(NamedTuple):
    """y_d,i(t) = offset_i + Σ_k amplitude_ik sin(frequency_ik t + phase_ik), as arrays.

    Attributes:
        offset: Shape (n,) [rad].
        amplitude: Shape (n, terms) [rad].
        frequency: Likewise [rad/s].
        phase: Likewise [rad].
    """

    offset: np.ndarray
    amplitude: np.ndarray
    frequency: np.ndarray
    phase: np.ndarray


@jit
def _fill_point(rows: np.ndarray, t: float, sinusoids: Handle) -> None:
    """Fill y_d with two derivatives, shape (3, n): an array that is returned takes longer."""
    write_sinusoids(ReferencePoint(rows[0], rows[1], rows[2]), t, sinusoids.value)


@jit
def _fill_points(rows: np.ndarray, times: np.ndarray, sinusoids: Handle) -> None:
    """Fill y_d with two derivatives at N times, shape (3, N, n)."""
    for k in range(times.size):
        write_sinusoids(ReferencePoint(rows[0, k], rows[1, k], rows[2, k]), times[k],
                        sinusoids.value)


@jit
def write_sinusoids(point: ReferencePoint, t: float, sinusoids: Sinusoids) -> None:
    """Write y_d at ``t`` [s] with two derivatives into the arrays of ``point``, shape (n,)."""
    point, sinusoids = borrowed(point), borrowed(sinusoids)
    position, velocity, acceleration = point.position, point.velocity, point.acceleration
    offset, amplitude = sinusoids.offset, sinusoids.amplitude
    frequency, phase = sinusoids.frequency, sinusoids.phase
    for i in range(offset.size):
        y, yd, ydd = 0.0, 0.0, 0.0
        for j in range(amplitude.shape[1]):
            w = frequency[i, j]
            cosine, sine = cos_sin(w * t + phase[i, j])
            s = amplitude[i, j] * sine
            y += s
            yd += amplitude[i, j] * cosine * w
            ydd -= s * w * w
        position[i], velocity[i], acceleration[i] = offset[i] + y, yd, ydd


@jit
def quintic(t: float, duration: float) -> tuple[float, float, float]:
    """Return s(x) = 10x³ − 15x⁴ + 6x⁵ at x = t/T in [0, 1], and ds/dt [1/s], d²s/dt² [1/s²].

    It rises from 0 to 1 with two derivatives zero at both ends.
    """
    x = t / duration
    return (x * x * x * (10.0 + x * (6.0 * x - 15.0)),
            30.0 * x * x * (x * (x - 2.0) + 1.0) / duration,
            60.0 * x * (x * (2.0 * x - 3.0) + 1.0) / (duration * duration))


@jit
def _blend(t: float, duration: float, a: np.ndarray, ad: np.ndarray, add: np.ndarray,
           b: np.ndarray, bd: np.ndarray, bdd: np.ndarray,
           ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    s, sd, sdd = quintic(t, duration)
    z, zd = b - a, bd - ad
    return (a + s * z, ad + (sd * z + s * zd),
            add + (sdd * z + 2.0 * sd * zd + s * (bdd - add)))


class _Trajectory(Guided, instead={
        **dict.fromkeys(('position', 'velocity', 'acceleration', 'y_d', 'q', 'value', 'evaluate'),
                        'at(t) has position, velocity and acceleration at t [s], along(times) '
                        'those at many'),
        **dict.fromkeys(('lower', 'upper', 'bounds', 'limits'), 'range() returns both bounds')}):
    """Base of the references of this package, which may be called: that is `at` or `along`."""

    def at(self, t: float) -> ReferencePoint:
        """Evaluate at ``t`` [s]."""
        raise NotImplementedError

    def along(self, times: np.ndarray) -> ReferencePoint:
        """See `along`."""
        raise NotImplementedError

    def range(self) -> Range:
        """Return the range that is never left, see `Reference`."""
        raise NotImplementedError

    def full_range(self) -> Range:
        """See `full_range`."""
        return self.range()

    def from_time(self, t: float) -> Reference:
        """See `from_time`."""
        return self

    @checked_call
    def __call__(self, t: Any) -> ReferencePoint:
        """Evaluate at one time or at ascending ones, shape (N,) [s]."""
        if dimensions(t) == 0:
            return self.at(checked_number('t', t))
        return self.along(checked_array('t', t, (-1,)))


class SumOfSinusoids(_Trajectory):
    """y_d,i(t) = offset_i + Σ_k amplitude_ik sin(frequency_ik t + phase_ik)."""

    @checked_call
    def __init__(self, offset: Any = None, amplitude: Any = None, frequency: Any = None,
                 phase: Any = 0.0) -> None:
        """Take the sinusoids of n joints, ``terms`` of them for each.

        Args:
            offset: Centres, shape (n,) [rad]; zeros where None.
            amplitude: Shape (n, terms) [rad]; (n,) for one sinusoid each. Of one joint also a
                number, and with its offset (terms,).
            frequency: Shape of the amplitude [rad/s]; one number for all.
            phase: Shape of the amplitude [rad]; one number for all.

        Raises:
            ParameterError: the shapes differ, or amplitude or frequency is missing.
        """
        for name, value in (('amplitude', amplitude), ('frequency', frequency)):
            if value is None:
                raise without_argument(SumOfSinusoids.__init__, name)
        if offset is not None:
            offset = checked_array('reference.offset', offset, (-1,) if dimensions(offset) else
                                   (1,))
        joints, axes = -1 if offset is None else len(offset), dimensions(amplitude)
        if axes < 2 and (joints == 1 or axes == 0):  # of one joint
            amplitude = [amplitude] if axes else [[amplitude]]
        self._amplitude = checked_array('reference.amplitude', amplitude,
                                        (joints, 1 if dimensions(amplitude) == 1 else -1)).copy()
        shape = self._amplitude.shape
        self._offset = np.zeros(shape[0]) if offset is None else offset.copy()
        self._frequency, self._phase = (
            np.full(shape, checked_number(name, value)) if dimensions(value) == 0 else
            checked_array(name, [value] if shape[0] == 1 and dimensions(value) == 1 else value,
                          shape).copy()
            for name, value in (('reference.frequency', frequency), ('reference.phase', phase)))
        self._handle = handle(self.arrays)

    @property
    def arrays(self) -> Sinusoids:
        """The sinusoids as compiled functions take them."""
        return Sinusoids(self._offset, self._amplitude, self._frequency, self._phase)

    def __getstate__(self) -> dict[str, Any]:
        """Return what a copy or a pickle takes: all but the handle, which it makes again."""
        return {name: value for name, value in vars(self).items() if name != '_handle'}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Take what `__getstate__` returned."""
        vars(self).update(state)
        vars(self)['_handle'] = handle(self.arrays)

    def __repr__(self) -> str:
        """Show the number of joints and sinusoids, and the range."""
        lower, upper = self.range()
        joints, terms = self._amplitude.shape
        return (f'<SumOfSinusoids: {joints} joints, {terms} terms, '
                f'{lower.round(4).tolist()} to {upper.round(4).tolist()} rad>')

    def at(self, t: float) -> ReferencePoint:
        """Evaluate at ``t`` [s]."""
        if not isinstance(t, (float, int)):
            t = checked_number('t', t)
        rows = np.empty((3, self._offset.size))
        _fill_point(rows, t, self._handle)
        return ReferencePoint(rows[0], rows[1], rows[2])

    def along(self, times: np.ndarray) -> ReferencePoint:
        """See `along`."""
        rows = np.empty((3, times.size, self._offset.size))
        _fill_points(rows, times, self._handle)
        return ReferencePoint(*rows)

    def range(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the range that is never left: offset ∓ Σ |amplitude|, or less (`extremes`)."""
        ends = np.array([extremes(*terms) for terms in zip(
            self._amplitude, self._frequency, self._phase)]).reshape(-1, 2)
        return self._offset + ends[:, 0], self._offset + ends[:, 1]


class Posture(_Trajectory):
    """A posture that is held."""

    def __init__(self, position: np.ndarray) -> None:
        """Take the positions, shape (n,) [rad]."""
        held = checked_array('position', position, (-1,)).copy()
        self._point = ReferencePoint(held, np.zeros_like(held), np.zeros_like(held))

    def __repr__(self) -> str:
        """Show the posture."""
        return f'<Posture {self._point.position.round(4).tolist()} rad>'

    def at(self, t: float) -> ReferencePoint:
        """Return the posture at rest."""
        return self._point

    def along(self, times: np.ndarray) -> ReferencePoint:
        """See `along`."""
        return ReferencePoint(*(np.tile(each, (times.size, 1)) for each in self._point))

    def range(self) -> Range:
        """Return the posture twice."""
        return self._point.position, self._point.position


class Crossfade(_Trajectory):
    """Lead from one reference to another over ``duration`` with a quintic blend, C².

    y = a + s((t − t0)/T) (b − a): until t0 it is a, from t0 + T on b.

    Attributes:
        before: a.
        after: b.
        begin: t0 [s].
        duration: T [s].
    """

    def __init__(self, before: Reference, after: Reference, begin: float, duration: float) -> None:
        """Take both references, t0 [s] and the blend time T [s], 1 ns or more.

        Raises:
            ParameterError: T is no time of 1 ns or more, or too many blends are under way at once.
        """
        if not SHORTEST <= duration < np.inf:
            raise ParameterError('reference.blend_time', duration, 'a time of 1 ns or more')
        self.before, self.after = before, after
        self.begin, self.duration = float(begin), float(duration)
        self._depth = 1 + max(getattr(part, '_depth', 0) for part in (before, after))
        if self._depth > DEEPEST:
            raise ParameterError('reference', f'{self._depth} changes within their blend time',
                                 f'at most {DEEPEST}: wait until the last ones are over')

    def __repr__(self) -> str:
        """Show both references and the blend time."""
        return (f'<{type(self).__name__} from {self.before!r} to {self.after!r} over '
                f'{self.duration:g} s>')

    def at(self, t: float) -> ReferencePoint:
        """Evaluate at ``t`` [s]."""
        since = t - self.begin
        if since >= self.duration:
            return self.after.at(t)
        if since <= 0.0:
            return self.before.at(t)
        return ReferencePoint(
            *_blend(since, self.duration, *self.before.at(t), *self.after.at(t)))

    def along(self, times: np.ndarray) -> ReferencePoint:
        """See `along`."""
        since = times - self.begin
        first, last = since <= 0.0, since >= self.duration
        rows = ReferencePoint(*np.where(
            last[:, None], along(self.after, times), along(self.before, times)))
        between = ~(first | last)
        if between.any():
            blend = uncompiled(_blend)(
                since[between, None], self.duration,  # type: ignore[arg-type]
                *along(self.before, times[between]), *along(self.after, times[between]))
            for row, part in zip(rows, blend):
                row[between] = part
        return rows

    def range(self) -> Range:
        """Return the hull of both ranges."""
        return hull(self.before.range(), self.after.range())

    def full_range(self) -> Range:
        """See `full_range`."""
        return hull(full_range(self.before), full_range(self.after))

    def from_time(self, t: float) -> Reference:
        """See `from_time`."""
        if t - self.begin >= self.duration:
            return from_time(self.after, t)
        return Crossfade(from_time(self.before, t), from_time(self.after, t), self.begin,
                         self.duration)


class SmoothStart(Crossfade):
    """Join a start posture to a reference: the crossfade from rest, begun at t = 0."""

    def __init__(self, reference: Reference, duration: float, start: np.ndarray) -> None:
        """Take the reference, the blend time T of 1 ns or more [s], and the start (n,) [rad]."""
        if not SHORTEST <= duration < np.inf:
            raise ParameterError('reference.smooth_start', duration, 'a time of 1 ns or more')
        super().__init__(Posture(start), reference, 0.0, duration)

    @property
    def start(self) -> np.ndarray:
        """The start posture, shape (n,) [rad]."""
        return self.before.at(0.0).position

    def full_range(self) -> Range:
        """See `full_range`: near the start the performance set has yet to grow."""
        return full_range(self.after)

    def from_time(self, t: float) -> Reference:
        """See `from_time`."""
        return from_time(self.after, t) if t >= self.duration else self


def along(reference: Reference, times: np.ndarray) -> ReferencePoint:
    """Evaluate a reference at N ascending times, (N,) [s]; its arrays have shape (N, n)."""
    own = getattr(reference, 'along', None)
    if own is not None:
        return own(times)  # type: ignore[no-any-return]
    points = [reference.at(float(t)) for t in times]
    return ReferencePoint(*(np.array(rows, dtype=float) for rows in zip(*points)))


def hull(first: Range, second: Range) -> Range:
    """Return the smallest range that holds both."""
    return np.minimum(first[0], second[0]), np.maximum(first[1], second[1])


def from_time(reference: Reference, t: float) -> Reference:
    """Return what equals ``reference`` from ``t`` [s] on, without the parts that are over."""
    own = getattr(reference, 'from_time', None)
    return reference if own is None else own(t)  # type: ignore[no-any-return]


def full_range(reference: Reference) -> Range:
    """Return the range round which the whole performance set has to lie inside the safety set.

    It is that of the reference, without the posture of a smooth start: there the performance set
    is only as wide as it fits.
    """
    own = getattr(reference, 'full_range', reference.range)
    return own()  # type: ignore[no-any-return]
