# SPDX-License-Identifier: Apache-2.0
"""The settings of the identifier: one frozen object that is replaced as a whole."""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np

from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.update_law import UPDATE_LAWS

__all__ = ['IdentifierSettings']


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
