# SPDX-License-Identifier: Apache-2.0
"""State filters: what is between a measured state and the torque filter.

Ours is a state-variable filter: position, velocity and torque behind the same low-pass. The
cascade 1/(T s + 1)^N is applied to the measured position and to the torque. Its last two stages
give the velocity of the filtered position without differencing: q̇_f = (x_{N−1} − x_N)/T.
Filtering commutes with the arm's equation but for terms of second order in the filter's spread
√N T times the speed, so (q_f, q̇_f, τ_f) obey the same equation, with encoder steps and torque
noise above 1/T removed from both sides alike. The measured velocity, whose lag nobody states, is
not used.

The cascade is stepped exactly for a torque held over the interval and for a position that moves
linearly in it.
"""

from __future__ import annotations

from abc import abstractmethod
import math
from typing import Protocol

import numpy as np

from adaptive_blf_control.compiled import jit
from adaptive_blf_control.errors import ParameterError

__all__ = ['LowPass', 'STATE_FILTERS', 'StateFilter', 'cascade_step']

STATE_FILTERS = ('low_pass',)
"""The names of our state filters."""


@jit
def cascade_step(x: np.ndarray, u0: np.ndarray, u1: np.ndarray, ratio: float) -> np.ndarray:
    """Advance the stages of 1/(T s + 1)^N over one interval.

    Args:
        x: Stage outputs, shape (N, n), first stage first.
        u0: Input at the start of the interval, shape (n,).
        u1: Input at its end, shape (n,); the input moves linearly between them.
        ratio: dt / T.

    Returns:
        New stage outputs, shape (N, n).
    """
    stages = x.shape[0]
    decay = math.exp(-ratio)
    new = np.empty_like(x)
    # With u = u0 + s t/T the forced answer of stage k is u0 + s (t/T − k); what differs from it at
    # the start dies out through the stages as the Poisson weights e^{−r} r^j / j!.
    slope = (u1 - u0) / ratio
    for k in range(1, stages + 1):
        value = u1 - k * slope
        weight = decay
        for j in range(k):
            stage = k - j
            value = value + weight * (x[stage - 1] - (u0 - stage * slope))
            weight = weight * ratio / (j + 1)
        new[k - 1] = value
    return new


class StateFilter(Protocol):
    """What filters the measured state, made as ``state_filter(arm, settings)``.

    It is made again when a parameter of ``filter`` that begins with ``state_`` changes.

    Attributes:
        memory: How long it remembers a sample [s]; the pairs settle accordingly later.
    """

    memory: float = 0.0

    @abstractmethod
    def update(self, dt: float, q: np.ndarray, qd: np.ndarray, tau: np.ndarray,
               ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Filter one sample.

        Args:
            dt: Time since the last sample [s]; without a meaning for the first one.
            q: Measured positions, shape (n,) [rad].
            qd: Measured velocities, shape (n,) [rad/s].
            tau: Mean torque over the interval that ends here, shape (n,) [N·m].

        Returns:
            Filtered q, q̇ and τ, each of shape (n,). They have to satisfy the equation of the
            arm together: what delays one has to delay the others.
        """
        ...

    @abstractmethod
    def reset(self) -> None:
        """Forget everything; the next sample is the first one."""
        ...


class LowPass(StateFilter):
    """The cascade of the module's docstring; starts as if the arm had come from where it is."""

    def __init__(self, order: int, time_constant: float) -> None:
        """Set up 1/(T s + 1)^N.

        Args:
            order: N, at least 2; 0 passes the measured state on.
            time_constant: T [s], > 0.
        """
        if order < 0 or order == 1:
            raise ParameterError('identifier.filter.state_order', order, '0 (off) or at least 2')
        if not (math.isfinite(time_constant) and time_constant > 0.0):
            raise ParameterError('identifier.filter.state_time_constant', time_constant,
                                 'a finite time > 0 s')
        self.order = order
        self.time_constant = time_constant
        self.memory = order * time_constant
        self._q: np.ndarray | None = None
        self._tau = self._last = np.zeros(0)

    def reset(self) -> None:
        """See `StateFilter`."""
        self._q = None

    def update(self, dt: float, q: np.ndarray, qd: np.ndarray, tau: np.ndarray,
               ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """See `StateFilter`; ``qd`` is used where the order is 0 only."""
        if self.order == 0:
            return q, qd, tau
        if self._q is None:
            self._q = np.tile(q, (self.order, 1))
            self._tau = np.tile(tau, (self.order, 1))
        else:
            ratio = dt / self.time_constant
            self._q = cascade_step(self._q, self._last, q, ratio)
            self._tau = cascade_step(self._tau, tau, tau, ratio)
        self._last = q.copy()  # the caller may fill the same array again
        velocity = (self._q[-2] - self._q[-1]) / self.time_constant
        return self._q[-1], velocity, self._tau[-1]
