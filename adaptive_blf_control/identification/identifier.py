# SPDX-License-Identifier: Apache-2.0
"""The identifier: joint states in, parameter estimate and history stack out."""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.compiled import all_finite
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.history_stack import HistoryStack
from adaptive_blf_control.identification.torque_filter import TorqueFilter
from adaptive_blf_control.identification.update_law import implicit_step

__all__ = ['Identifier', 'IdentifierSettings']

# No filtered regressor or torque of a measurement is larger; the squares of such would overflow.
LARGEST = 1e50


@dataclass(frozen=True)
class IdentifierSettings:
    """Gains of the update law (37) and of Algorithm 1.

    Attributes:
        initial_estimate: θ̂(0), shape (m,).
        gamma: Diagonal of Γ, shape (m,), > 0.
        kt: Gain on the present pair, k_t ≥ 0.
        kh: Gain on the history stack, k_h ≥ 0.
        time_constant: k of the torque filter (14) [s].
        gap: Longest interval between samples [s]; after a longer one the filter restarts.
        settle: Pairs are offered to the stack this many time constants after a (re)start.
        size: P, number of pairs in the stack.
        epsilon: ε, relative difference of a new pair to the last one taken.
    """

    initial_estimate: np.ndarray
    gamma: np.ndarray
    kt: float
    kh: float
    time_constant: float
    gap: float
    size: int
    epsilon: float
    settle: float = 0.0

    def __post_init__(self) -> None:
        """Check signs; ParameterError names the gain."""
        for name in ('kt', 'kh', 'settle'):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ParameterError(f'identifier.{name}', value, 'a finite value >= 0')
        gamma = np.array(self.gamma, dtype=float)
        if not (np.all(np.isfinite(gamma)) and np.all(gamma > 0.0)):
            raise ParameterError('identifier.gamma', gamma.tolist(),
                                 'a positive definite Γ: values > 0')
        object.__setattr__(self, 'gamma', gamma)
        estimate = np.array(self.initial_estimate, dtype=float)
        if not np.all(np.isfinite(estimate)):
            raise ParameterError('identifier.initial_estimate', estimate.tolist(), 'finite values')
        object.__setattr__(self, 'initial_estimate', estimate)


class Identifier:
    """Torque filter, history stack and update law joined: (12)-(18), Algorithm 1, (37).

    Attributes:
        theta: θ̂, shape (m,); replaced, never changed in place.
        stack: The history stack with ``rank`` and ``sigma_min``.
        restarts: How often the filter started anew after a gap or a clock jump.
        dropped: Samples not used, by reason: ``not finite``, ``stamp repeated``, ``stamp went
            back``.
    """

    def __init__(self, arm: Arm, settings: IdentifierSettings) -> None:
        """Start from ``settings.initial_estimate`` with an empty stack."""
        self.arm = arm
        self.settings = settings
        self.theta = settings.initial_estimate.copy()
        self.stack = HistoryStack(arm.n, arm.m, settings.size, settings.epsilon)
        self._filter = TorqueFilter(arm.n, arm.m, settings.time_constant, settings.gap)
        self._no_term = np.zeros(arm.m)
        self._t: float | None = None
        self._age = 0.0
        self.restarts = 0
        self.dropped = {'not finite': 0, 'stamp repeated': 0, 'stamp went back': 0}

    @property
    def pair(self) -> tuple[np.ndarray, np.ndarray]:
        """Present filtered regressor (n, m) and torque (n,) [N·m]."""
        return self._filter.pair

    @property
    def settled(self) -> bool:
        """Whether the filter has forgotten its start (see ``settings.settle``)."""
        return self._age >= self.settings.settle * self.settings.time_constant

    def restart(self) -> None:
        """Start the filter anew with the next sample; θ̂ and the stack stay."""
        self._filter.reset()
        self._t = None
        self._age = 0.0

    def reset_history(self) -> None:
        """Empty the history stack; θ̂ stays."""
        self.stack.clear()

    def observe(self, t: float, q: np.ndarray, qd: np.ndarray, tau: np.ndarray) -> float:
        """Filter one sample without learning from it.

        Args:
            t: Time of the sample [s].
            q: Positions, shape (n,) [rad].
            qd: Velocities, shape (n,) [rad/s].
            tau: Mean torque over the interval that ends at ``t``, shape (n,) [N·m].

        Returns:
            The interval [s] the filter advanced by; 0 where it (re)started or dropped the sample.
        """
        if not (math.isfinite(t) and all_finite(q) and all_finite(qd) and all_finite(tau)):
            self.dropped['not finite'] += 1
            return 0.0
        dt = 0.0 if self._t is None else t - self._t
        if self._t is not None and dt <= 0.0:
            if dt > -self.settings.gap:
                self.dropped['stamp repeated' if dt == 0.0 else 'stamp went back'] += 1
                return 0.0
            self._filter.reset()  # the clock jumped back: begin again on the new one
        self._t = t
        advanced = self._filter.update(dt, *self.arm.Y12(q, qd), tau)
        if not advanced:
            self.restarts += 1
            self._age = 0.0
            return 0.0
        if not self._usable():  # the filter would carry it on for ever
            self.dropped['not finite'] += 1
            self.restart()
            return 0.0
        self._age += dt
        return dt

    def _usable(self) -> bool:
        regressor, torque = self._filter.pair
        return bool((np.abs(regressor) < LARGEST).all() and (np.abs(torque) < LARGEST).all())

    def update(self, t: float, q: np.ndarray, qd: np.ndarray, tau: np.ndarray,
               adaptation_term: np.ndarray | None = None) -> np.ndarray:
        """Filter one sample, offer it to the stack and advance θ̂; arguments as :meth:`observe`.

        Args:
            t: Time of the sample [s].
            q: Positions, shape (n,) [rad].
            qd: Velocities, shape (n,) [rad/s].
            tau: Mean torque over the interval that ends at ``t``, shape (n,) [N·m].
            adaptation_term: Xᵀe2 held over that interval, shape (m,); None gives (22).

        Returns:
            θ̂, shape (m,).
        """
        dt = self.observe(t, q, qd, tau)
        if dt > 0.0:
            regressor, torque = self._filter.pair
            if self.settled:
                self.stack.offer(regressor, torque)
            self._step(dt, regressor, torque,
                       self._no_term if adaptation_term is None else adaptation_term)
        return self.theta

    def _step(self, dt: float, regressor: np.ndarray, torque: np.ndarray,
              adaptation_term: np.ndarray) -> None:
        settings = self.settings
        try:
            theta = implicit_step(self.theta, dt, settings.gamma, settings.kt, settings.kh,
                                  regressor, torque, self.stack.gram, self.stack.moment,
                                  adaptation_term)
        except np.linalg.LinAlgError:  # not finite (numba), or singular by overflow
            theta = np.full_like(self.theta, math.nan)
        if all_finite(theta):
            self.theta = theta
        else:  # overflow of absurd data: keep the last good estimate
            self.dropped['not finite'] += 1
