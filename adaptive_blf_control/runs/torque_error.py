# SPDX-License-Identifier: Apache-2.0
"""The predicted torque error: how well an estimate predicts the torque of the task.

Along the reference, Y_d = Y(y_d, ẏ_d, ÿ_d), joint by joint

    RMS[Y_d (θ̂ − θ*)] / RMS[Y_d θ*],

or with the plant's own inverse dynamics in place of Y_d θ* where it has one: that counts what no
θ expresses, too. Unlike in ‖θ̃‖, directions of θ that the task hardly excites have little weight.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
import math

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.control.reference import along, Reference, ReferencePoint
from adaptive_blf_control.simulation.abilities import HasInverseDynamics
from adaptive_blf_control.simulation.closed_loop import ClosedLoop, Trace
from adaptive_blf_control.simulation.plant import known_truth, truth_of

__all__ = ['PredictedTorque', 'errors_of_trace', 'torque_error_of_trace', 'torque_line']

STEP = 0.05
"""Step of the grid along the reference [s]; widened so that no more than LARGEST points result."""
LARGEST = 4000


class PredictedTorque:
    """The regressor along a reference, kept as one m × m matrix per joint.

    Attributes:
        motions: The grid, (y_d, ẏ_d, ÿ_d) each.
        grams: Mean over the grid of yᵀy for each row y of Y_d, shape (n, m, m).
    """

    def __init__(self, arm: Arm, reference: Reference, duration: float) -> None:
        """Lay a grid over the reference from 0 to ``duration`` [s]."""
        points = min(max(math.ceil(duration / STEP), 1), LARGEST) + 1
        self._arm = arm
        grid = along(reference, np.linspace(0.0, duration, points))
        self.motions = [ReferencePoint(*motion) for motion in zip(*grid)]
        rows = np.array([self._regressor(motion) for motion in self.motions]).transpose(1, 0, 2)
        self.grams = rows.transpose(0, 2, 1) @ rows / points

    def _regressor(self, motion: ReferencePoint) -> np.ndarray:
        y, yd, ydd = motion
        return self._arm.X(y, yd, yd, ydd)  # with α = ẏ_d and e2 = 0 X is Y

    def rms(self, theta: np.ndarray) -> np.ndarray:
        """Return RMS[Y_d θ] for each θ of shape (..., m), shape (..., n) [N·m]."""
        square = np.einsum('...m,nmk,...k->...n', theta, self.grams, theta)
        return np.asarray(np.sqrt(np.maximum(square, 0.0)))

    def error(self, theta: np.ndarray, true: np.ndarray) -> np.ndarray:
        """Return the ratio of the module's docstring, shape (..., n).

        NaN for a joint whose true torque is zero.

        Args:
            theta: θ̂, shape (..., m).
            true: θ*, shape (m,) or that of ``theta``.
        """
        return _ratio(self.rms(theta - true), self.rms(true))

    def error_against(self, theta: np.ndarray, inverse_dynamics: Callable[..., np.ndarray],
                      ) -> np.ndarray:
        """Return the ratio against the torque of a plant, shape (n,).

        Args:
            theta: θ̂, shape (m,).
            inverse_dynamics: τ of (q, q̇, q̈), shape (n,) [N·m].
        """
        return _ratio(*self.rms_against(theta, inverse_dynamics))

    def rms_against(self, theta: np.ndarray, inverse_dynamics: Callable[..., np.ndarray],
                    ) -> tuple[np.ndarray, np.ndarray]:
        """Return RMS error and RMS torque of `error_against`, shape (n,) each [N·m]."""
        torques = self._torques(inverse_dynamics)
        predicted = np.array([self._regressor(motion) @ theta for motion in self.motions])
        return _root_mean_square(predicted - torques), _root_mean_square(torques)

    def least_against(self, inverse_dynamics: Callable[..., np.ndarray],
                      ) -> tuple[np.ndarray, np.ndarray]:
        """Return `rms_against` of the θ that fits the plant best: what no θ expresses."""
        torques = self._torques(inverse_dynamics)
        rows = np.array([self._regressor(motion) for motion in self.motions])
        best = np.linalg.lstsq(np.concatenate(rows), torques.ravel(), rcond=None)[0]
        return _root_mean_square(rows @ best - torques), _root_mean_square(torques)

    def _torques(self, inverse_dynamics: Callable[..., np.ndarray]) -> np.ndarray:
        return np.array([inverse_dynamics(*motion) for motion in self.motions])


def _root_mean_square(values: np.ndarray) -> np.ndarray:
    return np.asarray(np.sqrt(np.mean(values ** 2, axis=0)))


def _ratio(error: np.ndarray, scale: np.ndarray) -> np.ndarray:
    with np.errstate(divide='ignore', invalid='ignore'):
        return np.where(scale > 0.0, error / scale, np.nan)


def errors_of_trace(loop: ClosedLoop, trace: Trace, times: np.ndarray) -> np.ndarray:
    """Return the error of the estimates of a run, each against θ* at its time.

    Args:
        loop: The loop that ran.
        trace: Its run.
        times: Times at which the error is computed, shape (K,) [s].

    Returns:
        Ratios, shape (K, n).
    """
    measure = PredictedTorque(loop.arm, loop.controller.reference, float(trace.t[-1]))
    index = np.minimum(np.searchsorted(trace.t, times - 1e-9), trace.t.size - 1)
    plant = loop.plant
    if isinstance(plant, HasInverseDynamics):
        return np.array([
            measure.error_against(trace.theta_hat[k],
                                  partial(plant.inverse_dynamics, t=float(trace.t[k])))
            for k in index])
    truth = known_truth(loop.plant, loop.arm.parameters)
    epoch = np.searchsorted([t for t, _ in truth], trace.t[index] + 1e-9, side='right') - 1
    true = np.array([theta for _, theta in truth])[np.maximum(epoch, 0)]
    return measure.error(trace.theta_hat[index], true)


def torque_error_of_trace(loop: ClosedLoop, trace: Trace) -> list[float | None]:
    """Return the error at the end of a run per joint, None where the ratio has no meaning.

    It has none where the true torque is zero, or where the plant tells neither its inverse
    dynamics nor its θ*.
    """
    if not isinstance(loop.plant, HasInverseDynamics) and truth_of(
            loop.plant, loop.arm.parameters) is None:
        return [None] * loop.arm.n
    last, = errors_of_trace(loop, trace, trace.t[-1:])
    return [float(value) if math.isfinite(value) else None for value in last]


def torque_line(errors: list[float | None]) -> str:
    """Return the error as a line of the summary."""
    return 'predicted torque     off by ' + ', '.join(
        '–' if value is None else f'{100.0 * value:.2g} %' for value in errors) + ' RMS'
