# SPDX-License-Identifier: Apache-2.0
"""From joint states to filtered pairs: gaps, clock jumps, unusable samples and both filters."""

from __future__ import annotations

import math

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.arrays import checked_array
from adaptive_blf_control.compiled import jit
from adaptive_blf_control.identification.settings import FilterSettings
from adaptive_blf_control.identification.state_filter import LowPass, StateFilter
from adaptive_blf_control.identification.torque_filter import FilteredPair, TorqueFilter

__all__ = ['PairFilter']

# Filtered regressors (rad/s², rad²/s², m/s² and the like) and torques [N·m] of a robot stay far
# below this; the squares of what does not would drown the update law in rounding.
LARGEST = 1e6


@jit
def _finite_sample(q: np.ndarray, qd: np.ndarray, tau: np.ndarray) -> bool:
    return bool(np.isfinite(q).all() and np.isfinite(qd).all() and np.isfinite(tau).all())


@jit
def _usable(regressor: np.ndarray, torque: np.ndarray) -> bool:
    return bool((np.abs(regressor) < LARGEST).all() and (np.abs(torque) < LARGEST).all())


class PairFilter:
    """State filter and torque filter behind a clock that may have gaps and jump.

    Attributes:
        restarts: How often the filters restarted after a gap or a clock jump.
        dropped: Samples not used, by reason.
    """

    def __init__(self, arm: Arm, settings: FilterSettings, state_filter: StateFilter) -> None:
        """Take the arm, the parameters of ``filter`` and what filters the measured state."""
        self._arm = arm
        self._settings = settings
        self._state_filter = state_filter
        self._filter = TorqueFilter(arm.n, arm.m, settings.time_constant, settings.gap)
        self._t: float | None = None
        self._age = 0.0
        self.restarts = 0
        self.dropped = {'not finite': 0, 'too large': 0, 'stamp repeated': 0, 'stamp went back': 0}

    def retune(self, settings: FilterSettings, state_filter: StateFilter | None) -> None:
        """Use other settings; with another state filter both filters restart."""
        self._filter.retune(settings.time_constant, settings.gap)
        self._settings = settings
        if state_filter is not None:
            self._state_filter = state_filter
            self._reset()

    @property
    def pair(self) -> FilteredPair:
        """Present Y_f, shape (n, m), and τ_f, shape (n,) [N·m]."""
        return self._filter.pair

    @property
    def memory(self) -> float:
        """How long both filters remember a sample [s]."""
        return self._settings.time_constant + self._state_filter.memory

    @property
    def settled(self) -> bool:
        """Whether the filters have forgotten their start."""
        return self._age >= self._settings.settle * self.memory

    def unsettle(self) -> None:
        """Settle again, because the filters remember the arm of before a change."""
        self._age = 0.0

    def restart(self) -> None:
        """Restart both filters with the next sample, whatever its time is."""
        self._reset()
        self._t = None

    def _reset(self) -> None:
        self._filter.reset()
        self._state_filter.reset()
        self._age = 0.0

    def update(self, t: float, q: np.ndarray, qd: np.ndarray, tau: np.ndarray) -> float:
        """Filter one sample.

        Args:
            t: Time of the sample [s].
            q: Positions, shape (n,) [rad].
            qd: Velocities, shape (n,) [rad/s].
            tau: Mean torque over the interval that ends at ``t``, shape (n,) [N·m].

        Returns:
            The interval [s] the filters advanced by; 0 where they (re)started or the sample was
            dropped.
        """
        if not (math.isfinite(t) and _finite_sample(q, qd, tau)):
            self.dropped['not finite'] += 1
            return 0.0
        dt = 0.0 if self._t is None else t - self._t
        if self._t is not None and dt <= 0.0:
            if dt > -self._settings.gap:
                self.dropped['stamp repeated' if dt == 0.0 else 'stamp went back'] += 1
                return 0.0
            self._reset()  # the clock jumped back: begin again on the new one
        elif dt > self._settings.gap:
            self._reset()
        self._t = t
        q, qd, tau = self._filtered_state(dt, q, qd, tau)
        if not self._filter.update(dt, *self._arm.Y12(q, qd), tau):
            self.restarts += 1
            self._age = 0.0
            return 0.0
        if not _usable(*self._filter.pair):  # the filter would carry it on for ever
            self.dropped['too large'] += 1
            self.restart()
            return 0.0
        self._age += dt
        return dt

    def _filtered_state(self, dt: float, q: np.ndarray, qd: np.ndarray, tau: np.ndarray,
                        ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        state = self._state_filter.update(dt, q, qd, tau)
        if isinstance(self._state_filter, LowPass):
            return state
        name, shape = f'{type(self._state_filter).__name__}.update', q.shape
        filtered_q, filtered_qd, filtered_tau = (
            checked_array(name, value, shape, self._arm.joints) for value in state)
        return filtered_q, filtered_qd, filtered_tau
