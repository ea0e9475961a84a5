# SPDX-License-Identifier: Apache-2.0
"""Least squares over pseudo-inertias that stay positive definite, by a damped Newton method.

    min ½ xᵀ H x − gᵀ x + Σ_i [tr(P_i P0_i⁻¹) − log det P_i] + Σ_k μ_k [x_k / c_k − log x_k]

with x = (inertial parameters of all links, further parameters). The sum over the links is the
entropic divergence of P_i from P0_i (Lee, Wensing, Park, Geometric Robot Dynamic Identification:
A Convex Programming Approach, T-RO 2020, (17)): prior and barrier at once, the same in whatever
frame and unit a link is described. Minus log det is self-concordant: Newton's method with
backtracking converges from any feasible start (Boyd, Vandenberghe, Convex Optimization, 9.6).
Where the data pull far out of what is possible that takes long: the prior begins strong, with the
data hardly felt, and is weakened in stages (11.3).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arms.base_parameters import PER_BODY
from adaptive_blf_control.arms.pseudo_inertia import BASIS, pseudo_inertias

__all__ = ['LogDetFit', 'Positive', 'log_det_fit']

_STEPS = 200
_DECREMENT = 1e-8  # half the squared Newton decrement at the end: distance to the minimum of F
_NEAR = 0.1  # the same at the end of a stage
_STAGE = 0.1  # how much weaker the prior becomes from stage to stage
_STRONGEST = 1e15
_ARMIJO = 1e-4
_SHORTEST = 1e-10
_JITTER = 1e-13


class Positive(NamedTuple):
    """Parameters that have to be positive, K of them.

    Attributes:
        place: Their indices in x, shape (K,).
        centre: c_k, where the prior is least, shape (K,), > 0.
        weight: μ_k, strength of the prior, shape (K,), > 0.
    """

    place: np.ndarray
    centre: np.ndarray
    weight: np.ndarray


class LogDetFit(NamedTuple):
    """The minimum.

    Attributes:
        x: Shape (p,).
        hessian: Of the whole objective, shape (p, p).
        prior: Of the prior alone at the start, shape (p, p).
        steps: Number of Newton steps.
    """

    x: np.ndarray
    hessian: np.ndarray
    prior: np.ndarray
    steps: int


class _Objective:
    """The objective of the module's docstring with its derivatives."""

    def __init__(self, hessian: np.ndarray, moment: np.ndarray, prior: np.ndarray,
                 positive: Positive) -> None:
        self._hessian, self._moment, self._positive = hessian, moment, positive
        self._links = PER_BODY * len(prior)
        self._pull = np.linalg.inv(prior)
        self.set_strength(1.0)

    def set_strength(self, strength: float) -> None:
        """Multiply the prior: of the links by what is above 1, of the others where above μ."""
        self._strength = max(strength, 1.0)
        self._weight = np.maximum(strength, self._positive.weight)

    def value(self, x: np.ndarray) -> float:
        """Return F(x), infinity outside its domain."""
        pseudo, small = self._parts(x)
        if small.size and small.min() <= 0.0:
            return np.inf
        try:
            roots = np.linalg.cholesky(pseudo)
        except np.linalg.LinAlgError:
            return np.inf
        log_det = 2.0 * np.log(np.diagonal(roots, axis1=1, axis2=2)).sum()
        divergence = np.einsum('nij,nji->', pseudo, self._pull) - log_det
        return float(0.5 * x @ self._hessian @ x - self._moment @ x + self._strength * divergence
                     + self._weight @ (small / self._positive.centre - np.log(small)))

    def derivatives(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return gradient (p,) and the prior's part of the Hessian (p, p)."""
        pseudo, small = self._parts(x)
        turned = np.einsum('nij,kjl->nkil', np.linalg.inv(pseudo), BASIS)
        gradient = self._hessian @ x - self._moment
        pull = np.einsum('kij,nji->nk', BASIS, self._pull) - np.einsum('nkii->nk', turned)
        gradient[:self._links] += self._strength * pull.ravel()
        curvature = np.zeros_like(self._hessian)
        blocks = np.einsum('nkil,nmli->nkm', turned, turned)
        for i, block in enumerate(blocks):
            own = slice(PER_BODY * i, PER_BODY * (i + 1))
            curvature[own, own] = self._strength * block
        place, centre, _ = self._positive
        gradient[place] += self._weight * (1.0 / centre - 1.0 / small)
        curvature[place, place] = self._weight / small ** 2
        return gradient, curvature

    def _parts(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return (pseudo_inertias(x[:self._links].reshape(-1, PER_BODY)),
                x[self._positive.place])


def log_det_fit(hessian: np.ndarray, moment: np.ndarray, prior: np.ndarray, positive: Positive,
                start: np.ndarray) -> LogDetFit:
    """Minimise the objective of the module's docstring.

    Args:
        hessian: H, positive semi-definite, shape (p, p); positive definite in what is neither an
            inertial parameter nor positive.
        moment: g, shape (p,).
        prior: P0 of each link, positive definite, shape (n, 4, 4); its parameters come first in x.
        positive: Which others have to be positive.
        start: x to start from, inside the domain, shape (p,).
    """
    objective = _Objective(hessian, moment, prior, positive)
    described = objective.derivatives(start)[1]
    weakest = min([1.0, *positive.weight.tolist()])
    x, steps, strength = start, 0, _first_strength(objective, start, hessian)
    while True:
        objective.set_strength(strength)
        last = strength <= weakest
        x, curvature, taken = _newton(objective, x, hessian, _DECREMENT if last else _NEAR,
                                      _STEPS - steps)
        steps += taken
        if last or steps >= _STEPS:
            return LogDetFit(x, hessian + curvature, described, steps)
        strength *= _STAGE


def _first_strength(objective: _Objective, x: np.ndarray, hessian: np.ndarray) -> float:
    """Return how strong the prior has to be for one Newton step to come near the minimum."""
    strength = 1.0
    while strength < _STRONGEST:
        objective.set_strength(strength)
        gradient, curvature = objective.derivatives(x)
        if gradient @ _solve(hessian + curvature, gradient) < strength:
            break
        strength /= _STAGE
    return strength


def _newton(objective: _Objective, x: np.ndarray, hessian: np.ndarray, decrement: float,
            most: int) -> tuple[np.ndarray, np.ndarray, int]:
    """Take Newton steps until half the squared decrement is small; return x, curvature, steps."""
    value = objective.value(x)
    for step in range(most + 1):
        gradient, curvature = objective.derivatives(x)
        direction = -_solve(hessian + curvature, gradient)
        slope = float(gradient @ direction)
        if -slope < 2.0 * decrement or step == most:
            break
        length, trial = 1.0, objective.value(x + direction)
        while trial > value + _ARMIJO * length * slope and length > _SHORTEST:
            length *= 0.5
            trial = objective.value(x + length * direction)
        if length <= _SHORTEST:  # rounding: no better point in sight
            break
        x, value = x + length * direction, trial
    return x, curvature, step


def _solve(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve with a positive definite matrix of badly scaled units."""
    scale = 1.0 / np.sqrt(np.diag(matrix))
    scaled = matrix * np.outer(scale, scale) + _JITTER * np.eye(scale.size)
    solution: np.ndarray = scale * np.linalg.solve(scaled, scale * right)
    return solution
