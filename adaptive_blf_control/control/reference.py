# SPDX-License-Identifier: Apache-2.0
"""Reference trajectories y_d(t) with two exact derivatives (Assumption 1: bounded)."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from adaptive_blf_control.compiled import jit
from adaptive_blf_control.errors import ParameterError

__all__ = ['Reference', 'ReferencePoint', 'SmoothStart', 'SumOfSinusoids']


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
        """Return bounds (−y̲_d, ȳ_d) of Assumption 1, each of shape (n,) [rad]."""
        ...


@jit
def _sinusoids(t: float, offset: np.ndarray, amplitude: np.ndarray, frequency: np.ndarray,
               phase: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    angle = frequency * t + phase
    s = amplitude * np.sin(angle)
    c = amplitude * np.cos(angle) * frequency
    return (offset + np.sum(s, axis=1), np.sum(c, axis=1),
            -np.sum(s * frequency * frequency, axis=1))


@jit
def _blend(t: float, duration: float, start: np.ndarray, y: np.ndarray, yd: np.ndarray,
           ydd: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    x = t / duration
    s = x * x * x * (10.0 + x * (6.0 * x - 15.0))
    sd = 30.0 * x * x * (x * (x - 2.0) + 1.0) / duration
    sdd = 60.0 * x * (x * (2.0 * x - 3.0) + 1.0) / (duration * duration)
    z = y - start
    return start + s * z, sd * z + s * yd, sdd * z + 2.0 * sd * yd + s * ydd


class SumOfSinusoids:
    """y_d,i(t) = offset_i + Σ_k amplitude_ik sin(frequency_ik t + phase_ik)."""

    def __init__(self, offset: np.ndarray, amplitude: np.ndarray, frequency: np.ndarray,
                 phase: np.ndarray) -> None:
        """Take offset of shape (n,) [rad] and three arrays of shape (n, terms).

        Amplitude is in rad, frequency in rad/s, phase in rad. Raises ParameterError where the
        shapes differ.
        """
        self._offset = np.ascontiguousarray(offset, dtype=float)
        shape = (len(self._offset), np.shape(amplitude)[1])
        arrays = []
        for name, value in (('amplitude', amplitude), ('frequency', frequency), ('phase', phase)):
            if np.shape(value) != shape:
                raise ParameterError(f'reference.{name}', np.shape(value), f'shape {shape}')
            arrays.append(np.ascontiguousarray(value, dtype=float))
        self._amplitude, self._frequency, self._phase = arrays

    def at(self, t: float) -> ReferencePoint:
        """Evaluate at ``t`` [s]."""
        return ReferencePoint(
            *_sinusoids(t, self._offset, self._amplitude, self._frequency, self._phase))

    def range(self) -> tuple[np.ndarray, np.ndarray]:
        """Return offset ∓ Σ |amplitude|: never left, and approached with several frequencies."""
        # A term of zero frequency is a constant; it is counted like the others.
        reach = np.sum(np.abs(self._amplitude), axis=1)
        return self._offset - reach, self._offset + reach


class SmoothStart:
    """Join a start posture to a reference over ``duration`` with a quintic blend, C².

    y = y_0 + s(t/T) (r − y_0): at t = 0 the arm is at rest in y_0, from T on y = r.
    """

    def __init__(self, reference: Reference, duration: float, start: np.ndarray) -> None:
        """Take the reference, the blend time T > 0 [s] and the start posture (n,) [rad]."""
        if not duration > 0.0:
            raise ParameterError('reference.smooth_start', duration, 'a time > 0 s')
        self._reference = reference
        self._duration = float(duration)
        self._start = np.array(start, dtype=float)

    def at(self, t: float) -> ReferencePoint:
        """Evaluate at ``t`` [s]; before 0 the start posture is held."""
        point = self._reference.at(t)
        if t >= self._duration:
            return point
        return ReferencePoint(*_blend(max(t, 0.0), self._duration, self._start, *point))

    def range(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the range of the reference widened to the start posture."""
        lower, upper = self._reference.range()
        return np.minimum(lower, self._start), np.maximum(upper, self._start)
