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
from typing import NamedTuple, Protocol

import numpy as np

from adaptive_blf_control.arrays import checked_array
from adaptive_blf_control.compiled import borrowed, by_type, jit
from adaptive_blf_control.errors import ParameterError

__all__ = ['LowPass', 'LowPassArrays', 'STATE_FILTERS', 'StateFilter', 'cascade_step',
           'filtered', 'forget_states']

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
        memory: How long it remembers a sample [s]; the filters settle that much later.
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


@by_type
def filtered(state_filter: StateFilter, dt: float, q: np.ndarray, qd: np.ndarray,
             tau: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Filter one sample, see `StateFilter.update`; ParameterError where a shape is another."""
    name = f'{type(state_filter).__name__}.update'
    filtered_q, filtered_qd, filtered_tau = (
        checked_array(name, value, q.shape) for value in state_filter.update(dt, q, qd, tau))
    return filtered_q, filtered_qd, filtered_tau


@by_type
def forget_states(state_filter: StateFilter) -> None:
    """Begin with the next sample, see `StateFilter.reset`."""
    state_filter.reset()


class LowPassArrays(NamedTuple):
    """The cascade as compiled functions take it; arrays are changed in place.

    Attributes:
        position: Stage outputs, shape (N, n) [rad]; N = 0 passes the measured state on.
        torque: Stage outputs, shape (N, n) [N·m].
        last: Position of the last sample, shape (n,) [rad].
        begun: Whether there was one, shape (1,).
        time_constant: T [s].
    """

    position: np.ndarray
    torque: np.ndarray
    last: np.ndarray
    begun: np.ndarray
    time_constant: float


@jit
def low_pass_filtered(low_pass: LowPassArrays, dt: float, q: np.ndarray, qd: np.ndarray,
                      tau: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Filter one sample, see `StateFilter.update`."""
    position, torque = low_pass.position, low_pass.torque
    order = position.shape[0]
    if order == 0:
        return q, qd, tau
    if low_pass.begun[0]:
        ratio = dt / low_pass.time_constant
        position[:, :] = cascade_step(position, low_pass.last, q, ratio)
        torque[:, :] = cascade_step(torque, tau, tau, ratio)
    else:
        position[:, :] = q
        torque[:, :] = tau
        low_pass.begun[0] = True
    low_pass.last[:] = q
    velocity = (position[order - 2] - position[order - 1]) / low_pass.time_constant
    return position[order - 1].copy(), velocity, torque[order - 1].copy()


@jit
def forget_low_passed(low_pass: LowPassArrays) -> None:
    """Begin with the next sample as if the arm had come from where it is."""
    low_pass = borrowed(low_pass)
    low_pass.begun[0] = False


filtered.register(LowPassArrays, low_pass_filtered)
forget_states.register(LowPassArrays, forget_low_passed)


class LowPass(StateFilter):
    """The cascade of the module's docstring; starts as if the arm had come from where it is.

    Attributes:
        arrays: Its state.
    """

    def __init__(self, n: int, order: int, time_constant: float) -> None:
        """Set up 1/(T s + 1)^N.

        Args:
            n: Number of joints.
            order: N, at least 2; 0 passes the measured state on.
            time_constant: T [s], > 0.
        """
        if order < 0 or order == 1:
            raise ParameterError('identifier.filter.state_order', order, '0 (off) or at least 2')
        if not (math.isfinite(time_constant) and time_constant > 0.0):
            raise ParameterError('identifier.filter.state_time_constant', time_constant,
                                 'a finite time > 0 s')
        self.memory = order * time_constant
        self.arrays = LowPassArrays(np.zeros((order, n)), np.zeros((order, n)), np.zeros(n),
                                    np.zeros(1, dtype=bool), float(time_constant))

    def reset(self) -> None:
        """See `StateFilter`."""
        forget_low_passed(self.arrays)

    def update(self, dt: float, q: np.ndarray, qd: np.ndarray, tau: np.ndarray,
               ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """See `StateFilter`; ``qd`` is used where the order is 0 only."""
        result: tuple[np.ndarray, np.ndarray, np.ndarray] = low_pass_filtered(
            self.arrays, dt, q, qd, tau)
        return result
