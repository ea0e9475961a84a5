# SPDX-License-Identifier: Apache-2.0
"""The identifier: joint states in, parameter estimate and history stack out."""

from __future__ import annotations

from dataclasses import dataclass, replace
import math

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.compiled import all_finite, jit
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.change_monitor import ChangeMonitor
from adaptive_blf_control.identification.excitation import Excitation
from adaptive_blf_control.identification.history_stack import HistoryStack
from adaptive_blf_control.identification.recorded_noise import NoisyHistory
from adaptive_blf_control.identification.state_filter import StateFilter
from adaptive_blf_control.identification.torque_filter import TorqueFilter
from adaptive_blf_control.identification.update_law import implicit_step, UPDATE_LAWS

__all__ = ['Identifier', 'IdentifierSettings']

# Filtered regressors (rad/s², rad²/s², m/s² and the like) and torques [N·m] of a robot stay far
# below this; the squares of what does not would drown the update law in rounding.
LARGEST = 1e6


@jit
def _finite_sample(q: np.ndarray, qd: np.ndarray, tau: np.ndarray) -> bool:
    return bool(np.isfinite(q).all() and np.isfinite(qd).all() and np.isfinite(tau).all())


@jit
def _usable(regressor: np.ndarray, torque: np.ndarray) -> bool:
    return bool((np.abs(regressor) < LARGEST).all() and (np.abs(torque) < LARGEST).all())


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
        settle: Nothing is learned from data for this many filter time constants, k + N T, after a
            (re)start.
        size: P, number of pairs in the stack.
        epsilon: ε, relative difference of a new pair to the last one taken.
        state_order: N of the state-variable filter on position and torque; 0 uses the measured
            velocity instead.
        state_time_constant: T of that filter [s].
        change_window: Window of the change monitor [s]; 0 switches it off.
        change_threshold: Normalised residual that counts as a change of the arm.
        change_resolution: Part of the torque below which a change does not matter.
        update_law: One of `UPDATE_LAWS`.
        excitation_window: T of (21) [s]; 0 switches the index off.
        noise: Relative standard deviation of Remark 3, see `NoisyHistory`; 0 switches it off.
        noise_seed: Seed of that noise.
        minimum_growth: Part of σ_min by which a replacement in a full stack must raise it.
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
    state_order: int = 0
    state_time_constant: float = 0.03
    change_window: float = 0.0
    change_threshold: float = 25.0
    change_resolution: float = 0.01
    update_law: str = 'ablf_concurrent'
    excitation_window: float = 0.0
    noise: float = 0.0
    noise_seed: int = 0
    minimum_growth: float = 0.0

    def __post_init__(self) -> None:
        """Check signs; ParameterError names the gain."""
        for name in ('kt', 'kh', 'settle'):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ParameterError(f'identifier.{name}', value, 'a finite value >= 0')
        if self.update_law not in UPDATE_LAWS:
            raise ParameterError('identifier.update_law', self.update_law,
                                 f'one of {list(UPDATE_LAWS)}')
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
        monitor: Notices when the recorded pairs contradict present data.
        dropped: Samples not used, by reason: ``not finite``, ``too large`` (the filter then
            starts anew), ``stamp repeated``, ``stamp went back``.
    """

    def __init__(self, arm: Arm, settings: IdentifierSettings) -> None:
        """Start from ``settings.initial_estimate`` with an empty stack."""
        self.arm = arm
        self.settings = settings
        self.theta = settings.initial_estimate.copy()
        self.stack = HistoryStack(arm.n, arm.m, settings.size, settings.epsilon,
                                  settings.minimum_growth)
        self._filter = TorqueFilter(arm.n, arm.m, settings.time_constant, settings.gap)
        self._state_filter = StateFilter(settings.state_order, settings.state_time_constant
                                         ) if settings.state_order else None
        self.monitor = ChangeMonitor(arm.n, settings.change_window, settings.change_threshold,
                                     settings.change_resolution)
        self._excitation = Excitation(arm.m, settings.excitation_window)
        self._noisy = self._new_noisy_history()
        self._no_term = np.zeros(arm.m)
        self._t: float | None = None
        self._age = 0.0
        self.restarts = 0
        self.dropped = {'not finite': 0, 'too large': 0, 'stamp repeated': 0,
                        'stamp went back': 0}

    def warm_up(self) -> None:
        """Compile everything on a throw-away identifier, the search of a full stack included."""
        spare = Identifier(self.arm, replace(self.settings, size=self.arm.m, settle=0.0, gap=1.0,
                                             change_window=max(self.settings.change_window, 1e-3)))
        random = np.random.default_rng(0)
        for k in range(spare.stack.size + 5):
            q, qd, tau = random.normal(size=(3, self.arm.n))
            spare.update(k * 1e-3, q, qd, tau)

    @property
    def pair(self) -> tuple[np.ndarray, np.ndarray]:
        """Present filtered regressor (n, m) and torque (n,) [N·m]."""
        return self._filter.pair

    @property
    def excitation(self) -> float | None:
        """Persistence-of-excitation index γ of (21); None where switched off."""
        return self._excitation.index

    @property
    def fabricating(self) -> bool:
        """Whether θ̂ is learned from pairs with noise on them (Remark 3)."""
        return self._noisy is not None and self._noisy.fabricated > 0

    @property
    def settled(self) -> bool:
        """Whether the filter has forgotten its start (see ``settings.settle``)."""
        settings = self.settings
        memory = settings.time_constant + settings.state_order * settings.state_time_constant
        return self._age >= settings.settle * memory

    def restart(self) -> None:
        """Start the filter anew with the next sample; θ̂ and the stack stay."""
        self._reset_filters()
        self._t = None

    def _reset_filters(self) -> None:
        self._filter.reset()
        if self._state_filter is not None:
            self._state_filter.reset()
        self._age = 0.0

    def reset_history(self) -> None:
        """Empty the history stack; θ̂ stays."""
        self.stack.clear()
        self._noisy = self._new_noisy_history()
        self.monitor.reset()

    def _new_noisy_history(self) -> NoisyHistory | None:
        settings = self.settings
        if settings.noise == 0.0:
            return None
        return NoisyHistory(self.arm.n, self.arm.m, settings.size, settings.epsilon,
                            settings.noise, settings.noise_seed)

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
        if not (math.isfinite(t) and _finite_sample(q, qd, tau)):
            self.dropped['not finite'] += 1
            return 0.0
        dt = 0.0 if self._t is None else t - self._t
        if self._t is not None and dt <= 0.0:
            if dt > -self.settings.gap:
                self.dropped['stamp repeated' if dt == 0.0 else 'stamp went back'] += 1
                return 0.0
            self._reset_filters()  # the clock jumped back: begin again on the new one
        elif dt > self.settings.gap:
            self._reset_filters()
        self._t = t
        if self._state_filter is not None:
            q, qd, tau = self._state_filter.update(dt, q, tau)
        advanced = self._filter.update(dt, *self.arm.Y12(q, qd), tau)
        if not advanced:
            self.restarts += 1
            self._age = 0.0
            return 0.0
        if not _usable(*self._filter.pair):  # the filter would carry it on for ever
            self.dropped['too large'] += 1
            self.restart()
            return 0.0
        self._age += dt
        return dt

    def update(self, t: float, q: np.ndarray, qd: np.ndarray, tau: np.ndarray,
               adaptation_term: np.ndarray | None = None) -> np.ndarray:
        """Filter one sample, offer it to the stack and advance θ̂; arguments as :meth:`observe`.

        Args:
            t: Time of the sample [s].
            q: Positions, shape (n,) [rad].
            qd: Velocities, shape (n,) [rad/s].
            tau: Mean torque over the interval that ends at ``t``, shape (n,) [N·m].
            adaptation_term: Xᵀe2 held over that interval, shape (m,), None for zero; used by the
                law ``ablf_concurrent`` only.

        Returns:
            θ̂, shape (m,).
        """
        dt = self.observe(t, q, qd, tau)
        if dt > 0.0:
            regressor, torque = self._filter.pair
            try:
                if self.settled:
                    self._watch(dt, regressor, torque)
                if self.settled:  # no longer where a change was just found
                    self._record(regressor, torque)
            except np.linalg.LinAlgError:  # a pair that LAPACK cannot judge is not recorded
                self.dropped['not finite'] += 1
            self._excitation.update(dt, regressor)
            self._step(dt, regressor, torque,
                       self._no_term if adaptation_term is None else adaptation_term)
        return self.theta

    def _watch(self, dt: float, regressor: np.ndarray, torque: np.ndarray) -> None:
        """Let go of the recorded pairs when they contradict present data."""
        stack = self.stack
        if self.settings.change_window > 0.0 and stack.full and stack.rank == self.arm.m:
            self.monitor.learn(stack.regressors, stack.torques, stack.gram, stack.moment,
                               stack.insertions)
            if self.monitor.update(dt, regressor, torque):
                stack.clear()
                self._age = 0.0  # the filters still remember the arm of before

    def _record(self, regressor: np.ndarray, torque: np.ndarray) -> None:
        self.stack.offer(regressor, torque)
        if self._noisy is not None:
            self._noisy.offer(regressor, torque)
            if self.stack.rank == self.arm.m:
                self._noisy = None

    def _step(self, dt: float, regressor: np.ndarray, torque: np.ndarray,
              adaptation_term: np.ndarray) -> None:
        settings = self.settings
        stack = self.stack if self._noisy is None else self._noisy.stack
        if settings.update_law != 'ablf_concurrent':
            adaptation_term = self._no_term
        try:
            theta = implicit_step(self.theta, dt, settings.gamma,
                                  settings.kt if self.settled else 0.0,
                                  0.0 if settings.update_law == 'gradient' else settings.kh,
                                  regressor, torque, stack.gram, stack.moment,
                                  adaptation_term)
        except np.linalg.LinAlgError:  # not finite (numba), or singular by overflow
            theta = np.full_like(self.theta, math.nan)
        if all_finite(theta):
            self.theta = theta
        else:  # overflow of absurd data: keep the last good estimate
            self.dropped['not finite'] += 1
