# SPDX-License-Identifier: Apache-2.0
"""θ* of a plant that is not linear in our parameters: least squares on its inverse dynamics."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
import math

import numpy as np

from adaptive_blf_control.arms.arm import Arm

__all__ = ['TruthFit', 'fit_truth']

InverseDynamics = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
_STATES_PER_PARAMETER = 10


@dataclass(frozen=True)
class TruthFit:
    """What the parameters of an arm can express of a plant, and what they cannot.

    Attributes:
        theta: argmin over θ of Σ ‖Y θ − τ‖² over random states, shape (m,).
        residual: RMS of Y θ − τ there, shape (n,) [N·m].
        torque: RMS of τ there, shape (n,) [N·m].
    """

    theta: np.ndarray
    residual: np.ndarray
    torque: np.ndarray

    @property
    def unexpressed(self) -> np.ndarray:
        """Part of each joint's torque that no θ expresses, shape (n,)."""
        return np.asarray(self.residual / np.maximum(self.torque, 1e-300))


def fit_truth(arm: Arm, parameters: Sequence[str], inverse_dynamics: InverseDynamics) -> TruthFit:
    """Fit the parameters that are asked for; those that the arm does not have are 0.

    Args:
        arm: Gives the regressor Y.
        parameters: Names of θ, in any order.
        inverse_dynamics: τ of (q, q̇, q̈), each of shape (n,) [rad, rad/s, rad/s², N·m].
    """
    known = [name for name in parameters if name in arm.parameters]
    columns = [arm.parameters.index(name) for name in known]
    random, shape = np.random.default_rng(0), (_STATES_PER_PARAMETER * arm.m, arm.n)
    states = list(zip(random.uniform(-math.pi, math.pi, shape), random.uniform(-2.0, 2.0, shape),
                      random.uniform(-5.0, 5.0, shape)))
    regressors = np.array([arm.X(q, qd, qd, qdd)[:, columns] for q, qd, qdd in states])
    torques = np.array([inverse_dynamics(*state) for state in states])
    rows = regressors.reshape(-1, len(columns))
    scale = np.linalg.norm(rows, axis=0)
    scale[scale == 0.0] = 1.0
    solution = np.linalg.lstsq(rows / scale, torques.reshape(-1), rcond=None)[0] / scale
    theta = np.zeros(len(parameters))
    theta[[list(parameters).index(name) for name in known]] = solution
    return TruthFit(theta, _rms(regressors @ solution - torques), _rms(torques))


def _rms(values: np.ndarray) -> np.ndarray:
    return np.asarray(np.sqrt(np.mean(values ** 2, axis=0)))
