# SPDX-License-Identifier: Apache-2.0
"""Change monitors: find that recorded pairs contradict present data, so the arm has changed.

With rank full the stack alone determines an estimate, θ_s = Q⁻¹ g, whatever θ̂ is doing. If the
arm is still the one that was recorded, the present residual r = Y_f θ_s − τ_f is as small as those
of the recorded pairs. Our monitor compares both joint by joint:

    d_i² = r_i² / (s_i² + (ρ t_i)² + (f_i (1 − |c_i|))²),

s_i² the mean square residual of joint i in the stack widened by the uncertainty of θ_s along Y_f,
t_i the RMS of its recorded filtered torque, ρ the part of the torque below which a change does not
matter, f_i the Coulomb torque in θ_s and c_i its column in Y_f, the filtered tanh(q̇_i/v_s): ±1
while the joint moves; of a joint that sticks friction holds whatever there is, up to f_i. With
D_i the mean of d_i² over a window, 1 where nothing has changed, the arm has changed when

    1 + Σ max(D_i − 1, 0)

exceeds a threshold: a load shows in several joints at once, in each of them perhaps too little.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
import math
from typing import NamedTuple, Protocol

import numpy as np

from adaptive_blf_control.compiled import (
    borrowed,
    by_type,
    combine_rows,
    dot,
    jit,
    jit_apart,
    local_zeros,
    uncompiled,
)
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.history import facts, History, pairs, sums
from adaptive_blf_control.linear_algebra import inverse, product

__all__ = ['ChangeMonitor', 'ExternalTorque', 'MONITORS', 'ResidualArrays', 'ResidualMonitor',
           'contradicted', 'external_torque', 'forget_residuals', 'nothing_compared',
           'residual_with_scale']

MONITORS = ('residual',)
"""The names of our change monitors."""

CAP = 20.0  # thresholds: no d² counts more, so that one wild sample is no change
EQUATIONS = 2.0  # for each parameter, below which a history that is not full says too little
GROWTH = 1.05  # of a history that is not full, after which its residuals are computed again


@jit
def residual_with_scale(regressor: np.ndarray, torque: float, theta: np.ndarray,
                        inverse: np.ndarray, variance: float,
                        floor: float) -> tuple[float, float]:
    """Return r [N·m] and what its square is divided by in d² [N²·m²], both of one joint.

    Args:
        regressor: Its row of the present Y_f, shape (m,).
        torque: Its present τ_f [N·m].
        theta: θ_s, shape (m,).
        inverse: Q⁻¹, widened where noise is correlated, shape (m, m).
        variance: Its mean square residual in the stack [N²·m²].
        floor: What is added, (ρ t_i)² + (f_i (1 − |c_i|))² [N²·m²].
    """
    m = theta.size
    image = local_zeros(m)
    combine_rows(image, inverse, regressor, m)
    spread = dot(regressor, image, m)
    return torque - dot(regressor, theta, m), variance * (1.0 + spread) + floor


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
        """Take new values of the parameters of ``change`` with these names, already checked."""
        ...


class ExternalTorque(NamedTuple):
    """Torque that the model does not explain: what acts from outside, with the sign turned.

    Attributes:
        torque: Measured minus predicted torque behind the filters, τ_f − Y_f θ_s, shape (n,)
            [N·m]; NaN while the recorded pairs determine no θ_s.
        bound: Size up to which it means nothing, shape (n,) [N·m]; infinite likewise.
    """

    torque: np.ndarray
    bound: np.ndarray


def external_torque(residual: np.ndarray, scale: np.ndarray, threshold: float) -> ExternalTorque:
    """Return a residual with its bound, the square root of ``threshold`` times its scale."""
    return ExternalTorque(residual.copy(), np.sqrt(np.maximum(threshold * scale, 0.0)))


@by_type
def contradicted(monitor: ChangeMonitor, dt: float, regressor: np.ndarray, torque: np.ndarray,
                 history: History) -> bool:
    """Compare a pair with the recorded ones, see `ChangeMonitor.watch`."""
    return bool(monitor.watch(dt, regressor, torque, history))


@by_type
def forget_residuals(monitor: ChangeMonitor) -> None:
    """Forget what was seen, see `ChangeMonitor.reset`."""
    monitor.reset()


class ResidualArrays(NamedTuple):
    """The residual monitor as compiled functions take it; arrays are changed in place.

    Attributes:
        statistic: Windowed mean of d² per joint, shape (n,).
        theta: θ_s, shape (m,).
        inverse: Q⁻¹, widened, shape (m, m).
        variance: Mean square residual of the stack per joint, shape (n,) [N²·m²].
        square: Mean square torque of the stack per joint, t_i², shape (n,) [N²·m²].
        revision: That of the history these belong to, −1 for none, and how many pairs it had,
            shape (2,).
        residual: τ_f − Y_f θ_s of the last pair, NaN where there was nothing to compare it with,
            shape (n,) [N·m].
        scale: What its square is compared with, shape (n,) [N²·m²]; infinite likewise.
        coulomb: Column of each joint's Coulomb torque, −1 where there is none, shape (n,).
        ordinary: Mean of d² that pairs have which are not recorded, ≥ 1, by which d² is divided:
            what the model lacks, as dry friction at standstill, shows in others than the recorded
            ones; 1 where nobody follows it, shape (n,).
        window: Time constant of the mean [s]; 0 is off.
        threshold: Mean of d², of all joints together, that counts as a change.
        resolution: ρ.
    """

    statistic: np.ndarray
    theta: np.ndarray
    inverse: np.ndarray
    variance: np.ndarray
    square: np.ndarray
    revision: np.ndarray
    residual: np.ndarray
    scale: np.ndarray
    coulomb: np.ndarray
    ordinary: np.ndarray
    window: float
    threshold: float
    resolution: float


@jit_apart
def take_over(monitor: ResidualArrays, regressors: np.ndarray, torques: np.ndarray,
              gram: np.ndarray, moment: np.ndarray) -> None:
    """Take θ_s and the residuals of the recorded pairs, (P, n, m) and (P, n), from their sums."""
    monitor = borrowed(monitor)
    slots, n, m = regressors.shape
    inverted = inverse(gram)
    monitor.theta[:] = product(inverted, moment)
    # Noise of neighbouring pairs is alike, as the filters remember both: P n equations say no
    # more about θ_s than the m it takes, in the worst case.
    monitor.inverse[:, :] = (slots * n / m) * inverted
    predicted = product(regressors.reshape(slots * n, m), monitor.theta).reshape(slots, n)
    residuals = predicted - torques
    # P n equations fix m unknowns: the fit absorbs that part of the noise.
    freedom = max(1.0 - m / (slots * n), 0.1)
    monitor.variance[:] = np.sum(residuals * residuals, axis=0) / (slots * freedom)
    monitor.square[:] = np.sum(torques * torques, axis=0) / slots


@jit
def residuals_contradicted(monitor: ResidualArrays, dt: float, regressor: np.ndarray,
                           torque: np.ndarray, history: History) -> bool:
    """Compare a pair with the recorded ones, see `ChangeMonitor.watch`."""
    monitor = borrowed(monitor)
    count, size, rank, revision = facts(history)
    n, m = regressor.shape
    if monitor.window <= 0.0 or rank != m or (count != size and n * count < EQUATIONS * m):
        nothing_compared(monitor)
        return False
    if revision != monitor.revision[0] and (
            count >= size or count >= GROWTH * monitor.revision[1]):
        regressors, torques = pairs(history)
        gram, moment = sums(history)
        take_over(monitor, regressors[:count], torques[:count], gram, moment)
        monitor.revision[0], monitor.revision[1] = revision, count
    gain, cap = -math.expm1(-dt / monitor.window), CAP * monitor.threshold
    together, mean = 1.0, monitor.statistic
    for k in range(torque.size):
        floor = monitor.resolution ** 2 * monitor.square[k] + 1e-300
        if monitor.coulomb[k] >= 0:
            moving = min(abs(regressor[k, monitor.coulomb[k]]), 1.0)
            floor += (monitor.theta[monitor.coulomb[k]] * (1.0 - moving)) ** 2
        residual, scale = residual_with_scale(regressor[k], torque[k], monitor.theta,
                                              monitor.inverse, monitor.variance[k], floor)
        scale *= monitor.ordinary[k]
        monitor.residual[k], monitor.scale[k] = residual, scale
        mean[k] += gain * (min(residual * residual / scale, cap) - mean[k])
        together += max(mean[k] - 1.0, 0.0)
    return bool(together >= monitor.threshold)


@jit
def nothing_compared(monitor: ResidualArrays) -> None:
    """Leave neither residual nor scale of a pair that is not compared."""
    monitor = borrowed(monitor)
    monitor.residual[:] = np.nan
    monitor.scale[:] = np.inf


@jit
def forget_statistic(monitor: ResidualArrays) -> None:
    """Begin with an empty mean and without residuals."""
    monitor = borrowed(monitor)
    monitor.statistic[:] = 0.0
    monitor.ordinary[:] = 1.0
    monitor.revision[0], monitor.revision[1] = -1, 0


contradicted.register(ResidualArrays, residuals_contradicted)
forget_residuals.register(ResidualArrays, forget_statistic)


class ResidualMonitor(ChangeMonitor):
    """Sequential test on the normalised residual; silent until the rank of the stack is full.

    Attributes:
        arrays: Its state.
    """

    def __init__(self, n: int, m: int, window: float, threshold: float,
                 resolution: float, coulomb: Sequence[int] | None = None) -> None:
        """Set up the monitor.

        Args:
            n: Number of joints.
            m: Number of parameters.
            window: Time constant of the mean [s]; 0 switches the monitor off.
            threshold: Mean of d², of all joints together, that counts as a change, > 1.
            resolution: ρ, part of the torque that does not matter.
            coulomb: Column of each joint's Coulomb torque in the regressor, −1 for none, shape
                (n,); None: no joint has one.
        """
        self._check(window, threshold, resolution)
        self.arrays = ResidualArrays(
            np.zeros(n), np.zeros(m), np.zeros((m, m)), np.zeros(n), np.zeros(n),
            np.array([-1, 0]), np.full(n, np.nan), np.full(n, np.inf),
            np.array([-1] * n if coulomb is None else coulomb, dtype=np.int64), np.ones(n),
            float(window), float(threshold), float(resolution))

    @staticmethod
    def _check(window: float, threshold: float, resolution: float) -> None:
        if not (math.isfinite(window) and window >= 0.0):
            raise ParameterError('identifier.change.window', window, 'a time >= 0 s')
        if not (math.isfinite(threshold) and threshold > 1.0):
            raise ParameterError('identifier.change.threshold', threshold, 'a finite value > 1')
        if not (math.isfinite(resolution) and resolution >= 0.0):
            raise ParameterError('identifier.change.resolution', resolution, 'a finite value >= 0')

    @property
    def external_torque(self) -> ExternalTorque:
        """What the last pair shows beyond what the recorded ones predict."""
        return external_torque(self.arrays.residual, self.arrays.scale, self.arrays.threshold)

    @property
    def statistic(self) -> np.ndarray:
        """Windowed mean of d² per joint, shape (n,)."""
        return self.arrays.statistic.copy()

    def retune(self, window: float, threshold: float, resolution: float) -> None:
        """Change the settings, all or none; another window begins with an empty mean."""
        self._check(window, threshold, resolution)
        if window != self.arrays.window:
            self.reset()
        self.arrays = self.arrays._replace(
            window=float(window), threshold=float(threshold), resolution=float(resolution))

    def reset(self) -> None:
        """See `ChangeMonitor`."""
        forget_statistic(self.arrays)

    def watch(self, dt: float, regressor: np.ndarray, torque: np.ndarray,
              history: History) -> bool:
        """See `ChangeMonitor`."""
        return uncompiled(residuals_contradicted)(self.arrays, dt, regressor, torque, history)
