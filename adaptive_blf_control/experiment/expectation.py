# SPDX-License-Identifier: Apache-2.0
"""What to expect of a motion: standard deviations after a time, and the time that it takes.

With noise of the standard deviation σ_j that is alike for a time T (exp(−|t| / T)), a sample
counts as Δt / max(Δt, 2T) independent ones, and least squares over a motion of the duration D has
the covariance C = (G D / max(Δt, 2T))⁻¹, with G the information of one sample.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptive_blf_control.experiment.design import Design, Task
from adaptive_blf_control.experiment.objective import PER_HARMONIC, times_of
from adaptive_blf_control.experiment.torque_rows import torque_rows
from adaptive_blf_control.identification.uncertainty import NORMAL

__all__ = ['Expectation', 'expectation']


class Expectation(NamedTuple):
    """Standard deviations, and times.

    Attributes:
        std: Of each parameter after one period, shape (m,).
        time: Until all of a parameter's 95 % interval makes less torque than the noise, in every
            joint (RMS over the motion), shape (m,) [s].
        interval: Half of the width of the 95 % interval of the predicted torque after one period,
            as RMS over the motion, shape (n,) [N·m].
    """

    std: np.ndarray
    time: np.ndarray
    interval: np.ndarray

    @property
    def needed(self) -> float:
        """Time after which that holds for every parameter [s]."""
        return float(self.time.max())


def expectation(task: Task, design: Design, rate: float, correlation: float) -> Expectation:
    """Return what to expect of a motion.

    Args:
        task: What the motion is for.
        design: The motion.
        rate: Samples per second [Hz].
        correlation: T, how long the noise of the torque is alike [s].
    """
    alike = max(1.0 / rate, 2.0 * correlation)
    inverse = np.linalg.inv(design.information)
    covariance = inverse * alike / task.period
    std = np.sqrt(np.diag(covariance))
    states = design.motion.at(times_of(task.period, task.harmonics, PER_HARMONIC))
    rows = torque_rows(task.arm.arrays, *states)
    torque = np.sqrt(np.mean(rows ** 2, axis=0)) / task.noise[:, None]
    time = task.period * (NORMAL * std * torque.max(axis=0)) ** 2
    variance = np.mean(np.einsum('kij,jl,kil->ki', rows, covariance, rows, optimize=True), axis=0)
    return Expectation(std, time, NORMAL * np.sqrt(variance))
