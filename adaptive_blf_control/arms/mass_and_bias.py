# SPDX-License-Identifier: Apache-2.0
"""M(q) and h(q, q̇) of an arm with given parameters, M q̈ + h = τ, as compiled functions call them.

A model is a NamedTuple of its own type: `ChainInertias` for a URDF arm, `RegressorModel` for any
other arm that has arrays. `model_of` makes it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.arms.chain_dynamics import (
    chain_mass,
    chain_mass_and_bias,
    ChainInertias,
)
from adaptive_blf_control.arms.regressors import arrays_of, law_regressor, regressors
from adaptive_blf_control.compiled import borrowed, by_type, jit
from adaptive_blf_control.errors import ArmError
from adaptive_blf_control.linear_algebra import product

__all__ = ['mass', 'mass_and_bias', 'model_of', 'RegressorModel']


@by_type
def mass_and_bias(model: Any, q: np.ndarray, qd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """M(q) [kg·m²] and h = C q̇ + G + friction [N·m], shapes (n, n) and (n,)."""
    raise TypeError(f'no mass_and_bias is registered for {type(model).__name__}')


@by_type
def mass(model: Any, q: np.ndarray) -> np.ndarray:
    """M(q), shape (n, n) [kg·m²]."""
    raise TypeError(f'no mass is registered for {type(model).__name__}')


class RegressorModel(NamedTuple):
    """An arm and its parameters.

    Attributes:
        arm: As `regressors` knows it.
        theta: Shape (m,).
    """

    arm: Any
    theta: np.ndarray


@jit
def _regressor_mass(model: RegressorModel, q: np.ndarray) -> np.ndarray:
    model = borrowed(model)
    n = q.size
    result, axis = np.empty((n, n)), np.zeros(n)
    for j in range(n):
        axis[j] = 1.0
        result[:, j] = product(regressors(model.arm, q, axis)[0], model.theta)
        axis[j] = 0.0
    return result


@jit
def _regressor_mass_and_bias(model: RegressorModel, q: np.ndarray,
                             qd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    model = borrowed(model)
    bias = product(law_regressor(model.arm, q, qd, qd, np.zeros_like(q)), model.theta)
    return _regressor_mass(model, q), bias


mass_and_bias.register(RegressorModel, _regressor_mass_and_bias)
mass.register(RegressorModel, _regressor_mass)
mass_and_bias.register(ChainInertias, chain_mass_and_bias)
mass.register(ChainInertias, chain_mass)


def model_of(arm: Arm, theta: np.ndarray) -> Any:
    """Return the model of an arm with the parameters θ, shape (m,).

    Raises:
        ArmError: M is not positive definite with θ, or only the arm's methods know it.
    """
    arrays = arrays_of(arm)
    if arrays is None:
        raise ArmError(f'{type(arm).__name__} has no arrays: expected an arm that compiled '
                       'functions know')
    dynamics = getattr(arm.dynamics(theta), 'arm', None)
    return dynamics if isinstance(dynamics, ChainInertias) else RegressorModel(
        arrays, np.array(theta, dtype=float))
