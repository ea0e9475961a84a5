# SPDX-License-Identifier: Apache-2.0
"""Change monitors: find that recorded pairs contradict present data, so the arm has changed.

With rank full the stack alone determines an estimate, θ_s = Q⁻¹ g, whatever θ̂ is doing. If the
arm is still the one that was recorded, the present residual r = Y_f θ_s − τ_f is as small as those
of the recorded pairs. Our monitor compares both joint by joint:

    d_i² = r_i² / (s_i² + (ρ t_i)²),

s_i² the mean square residual of joint i in the stack widened by the uncertainty of θ_s along Y_f,
t_i the RMS of its recorded filtered torque, ρ the part of the torque below which a change does not
matter. When the mean of d_i² over a window exceeds a threshold for any joint, the arm has changed.
"""

from __future__ import annotations

from abc import abstractmethod
import math
from typing import Protocol

import numpy as np

from adaptive_blf_control.compiled import jit
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.history import History

__all__ = ['ChangeMonitor', 'MONITORS', 'ResidualMonitor', 'normalised_residual', 'windowed_step']

MONITORS = ('residual',)
"""The names of our change monitors."""


@jit
def normalised_residual(regressor: np.ndarray, torque: np.ndarray, theta: np.ndarray,
                        inverse: np.ndarray, variance: np.ndarray, floor: np.ndarray,
                        ) -> np.ndarray:
    """Return d² of the module's docstring per joint, shape (n,).

    Args:
        regressor: Present Y_f, shape (n, m).
        torque: Present τ_f, shape (n,) [N·m].
        theta: θ_s, shape (m,).
        inverse: Q⁻¹, widened where noise is correlated, shape (m, m).
        variance: Mean square residual of the stack per joint, shape (n,) [N²·m²].
        floor: (ρ t_i)², shape (n,) [N²·m²].
    """
    residual = np.dot(regressor, theta) - torque
    spread = np.sum(np.dot(regressor, inverse) * regressor, axis=1)
    return residual * residual / (variance * (1.0 + spread) + floor)


@jit
def windowed_step(mean: np.ndarray, gain: float, cap: float, regressor: np.ndarray,
                  torque: np.ndarray, theta: np.ndarray, inverse: np.ndarray,
                  variance: np.ndarray, floor: np.ndarray) -> tuple[np.ndarray, float]:
    """Exponential mean of d² limited to ``cap``, one wild sample being no change; and its top."""
    square = normalised_residual(regressor, torque, theta, inverse, variance, floor)
    mean = mean + gain * (np.minimum(square, cap) - mean)
    return mean, np.max(mean)


class ChangeMonitor(Protocol):
    """What finds a change of the arm, made as ``monitor(arm, settings)``."""

    @abstractmethod
    def watch(self, dt: float, regressor: np.ndarray, torque: np.ndarray,
              history: History) -> bool:
        """Compare a pair with the recorded ones; asked before the pair is offered to them.

        Args:
            dt: Time since the last sample [s].
            regressor: Present Y_f, shape (n, m).
            torque: Present τ_f, shape (n,) [N·m].
            history: The recorded pairs.

        Returns:
            Whether the arm has changed. The recorded pairs are then forgotten, and `reset` is
            called.
        """
        ...

    @abstractmethod
    def reset(self) -> None:
        """Forget what was seen: the history was emptied."""
        ...

    @abstractmethod
    def retune(self, window: float, threshold: float, resolution: float) -> None:
        """Use other values of the parameters of ``change`` that have these names.

        They have been checked.
        """
        ...


class ResidualMonitor(ChangeMonitor):
    """Sequential test on the normalised residual; silent until the stack is full, of full rank.

    Attributes:
        statistic: Windowed mean of d² per joint, shape (n,).
    """

    def __init__(self, n: int, window: float, threshold: float, resolution: float) -> None:
        """Set up the monitor.

        Args:
            n: Number of joints.
            window: Time constant of the mean [s]; 0 switches the monitor off.
            threshold: Mean of d² that counts as a change, > 1.
            resolution: ρ, part of the torque that does not matter.
        """
        self._check(window, threshold, resolution)
        self.window = window
        self.threshold = threshold
        self.resolution = resolution
        self.statistic = np.zeros(n)
        self._revision = -1
        self._theta = self._variance = self._square = self._floor = np.zeros(0)
        self._inverse = np.zeros((0, 0))

    @staticmethod
    def _check(window: float, threshold: float, resolution: float) -> None:
        if not (math.isfinite(window) and window >= 0.0):
            raise ParameterError('identifier.change.window', window, 'a time >= 0 s')
        if not (math.isfinite(threshold) and threshold > 1.0):
            raise ParameterError('identifier.change.threshold', threshold, 'a finite value > 1')
        if not (math.isfinite(resolution) and resolution >= 0.0):
            raise ParameterError('identifier.change.resolution', resolution, 'a finite value >= 0')

    def retune(self, window: float, threshold: float, resolution: float) -> None:
        """Change the settings, all or none; another window begins with an empty mean."""
        self._check(window, threshold, resolution)
        if window != self.window:
            self.reset()
        self.window, self.threshold, self.resolution = window, threshold, resolution
        self._set_floor()

    def _set_floor(self) -> None:
        self._floor = self.resolution ** 2 * self._square + 1e-300

    def reset(self) -> None:
        """See `ChangeMonitor`."""
        self.statistic = np.zeros_like(self.statistic)
        self._revision = -1

    def watch(self, dt: float, regressor: np.ndarray, torque: np.ndarray,
              history: History) -> bool:
        """See `ChangeMonitor`."""
        whole = history.count == history.size and history.rank == regressor.shape[1]
        if self.window <= 0.0 or not whole:
            return False
        if history.revision != self._revision:
            self._learn(history)
        self.statistic, top = windowed_step(
            self.statistic, -math.expm1(-dt / self.window), 20.0 * self.threshold, regressor,
            torque, self._theta, self._inverse, self._variance, self._floor)
        return bool(top >= self.threshold)

    def _learn(self, history: History) -> None:
        """Take θ_s and the residuals of the recorded pairs over from a full history."""
        regressors, torques, gram = history.regressors, history.torques, history.gram
        inverse = np.linalg.inv(gram)
        self._theta = inverse @ history.moment
        # Noise of neighbouring pairs is alike, as the filters remember both: P n equations say no
        # more about θ_s than the m it takes, in the worst case.
        self._inverse = torques.size / gram.shape[0] * inverse
        residuals = np.einsum('pnm,m->pn', regressors, self._theta) - torques
        # P n equations fix m unknowns: the fit absorbs that part of the noise.
        freedom = max(1.0 - gram.shape[0] / torques.size, 0.1)
        self._variance = np.mean(residuals ** 2, axis=0) / freedom
        self._square = np.mean(torques ** 2, axis=0)
        self._set_floor()
        self._revision = history.revision
