# SPDX-License-Identifier: Apache-2.0
"""How sure θ̂ and the torques that it predicts are.

With recorded pairs (Y_a, τ_a), Q = Σ Y_aᵀ Y_a and residuals e of variance s_j² in joint j that are
alike for a time T_j, E[e_aj e_bj] = s_j² exp(−|t_a − t_b| / T_j), least squares has the covariance

    C = Q⁻¹ [Σ_j s_j² Y_jᵀ K_j Y_j] Q⁻¹,     (K_j)_ab = exp(−|t_a − t_b| / T_j)

(generalised least squares' sandwich; Gautier and Khalil's σ² Q⁻¹ is the case T = 0). A predicted
torque Y θ̂ differs from the measured one by Y (θ̂ − θ) and by what the model does not explain. The
latter is larger than the residuals of pairs that θ̂ was fitted to: it is taken from blocks of time
that were left out in turn.

Coulomb friction f_c c(q̇), −1 ≤ c ≤ 1, is known where a joint slides, |c| = 1. Where it sticks,
friction takes whatever value up to f_c holds it, so what the model says is off by an error that is
taken to be uniform within ±f_c (1 − |c|). An interval of a torque is that of the sum of this error
and of a normal one.
"""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arms.joint_friction import coulomb_columns
from adaptive_blf_control.arrays import record
from adaptive_blf_control.identification.determination import WEAKEST
from adaptive_blf_control.identification.identifier import Identifier
from adaptive_blf_control.identification.pair_times import PairTimes

__all__ = ['LEVEL', 'NORMAL', 'Uncertainty', 'distance_to_go', 'estimate_uncertainty',
           'integral_correlation_time', 'uncertainty']

LEVEL = 0.95
"""Probability with which an interval is to hold."""
NORMAL = 1.959963984540054
"""Half width of the interval of probability `LEVEL` in standard deviations."""
_BLOCKS = 5
_BIN, _LONGEST = 0.25, 20.0  # times the filters' memory: resolution and longest time looked at
_ALIKE = 0.05  # an autocorrelation that counts
_MOST = 2000  # pairs that are looked at for it: the work grows with their square
_ROUNDING = 1e-6
_FREEDOM = 0.1  # least part of the equations that is taken not to have been fitted


@record
class Uncertainty(NamedTuple):
    """How sure an estimate from recorded pairs is.

    Attributes:
        covariance: C along the directions that the pairs determine, shape (m, m).
        open: Directions that they do not, as columns, shape (m, k).
        residual: s_j, shape (n,) [N·m].
        unexplained: RMS residual on blocks that were left out, at least s_j, shape (n,) [N·m].
        alike: How many pairs count as one: by how much the correlation of the residuals raises
            the variance that each joint's equations leave, averaged over what they determine
            (Kish's design effect), shape (n,).
        correlation_time: T_j, shape (n,) [s].
        condition: Ratio of the largest to the smallest singular value of the stacked regressors
            with columns of length one; infinity where directions are open.
        coulomb: |f_c| of a joint in its row, at the place of its parameter; zero elsewhere, and
            where no Coulomb friction is learned, shape (n, m) [N·m].
    """

    covariance: np.ndarray
    open: np.ndarray
    residual: np.ndarray
    unexplained: np.ndarray
    alike: np.ndarray
    correlation_time: np.ndarray
    condition: float
    coulomb: np.ndarray

    @property
    def std(self) -> np.ndarray:
        """Standard deviation of each parameter, infinity where it is open, shape (m,)."""
        result = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        result[np.linalg.norm(self.open, axis=1) > 0.0] = np.inf
        return result

    def half_width(self, regressor: np.ndarray, *, measured: bool = True) -> np.ndarray:
        """Return the half width of the 95 % interval of a predicted torque.

        Args:
            regressor: Y or Y_f, shape (..., n, m).
            measured: Whether it is to cover the measured torque; else that of the best model,
                Y θ* alone.

        Returns:
            Shape (..., n) [N·m]; infinity where the regressor has a part that is open.
        """
        variance = np.sum((regressor @ self.covariance) * regressor, axis=-1)
        if measured:
            result = _half_width(variance + self.unexplained ** 2, self._sticking(regressor))
        else:
            result = NORMAL * np.sqrt(np.maximum(variance, 0.0))
        along, most = np.abs(regressor @ self.open), np.abs(regressor) @ np.abs(self.open)
        return np.where((along > _ROUNDING * most).any(axis=-1), np.inf, result)

    def _sticking(self, regressor: np.ndarray) -> np.ndarray:
        """Return the largest friction that the model does not know, (..., n, m) → (..., n)."""
        known = np.abs(np.sum(regressor * self.coulomb, axis=-1))
        return np.asarray(np.maximum(self.coulomb.sum(axis=1) - known, 0.0))


def _half_width(variance: np.ndarray, most: np.ndarray) -> np.ndarray:
    """Return the half width of the interval of a normal error plus one within ``±most``."""
    both = np.sqrt(np.maximum(variance + most ** 2 / 3.0, 0.0))
    uniform = np.divide(most, math.sqrt(3.0) * both, out=np.zeros_like(both), where=both > 0.0)
    result: np.ndarray = both * np.interp(uniform, _UNIFORM, _QUANTILES)
    return result


def _quantile(uniform: float) -> float:
    """Return the half width for a sum of variance 1.

    Args:
        uniform: Standard deviation of its uniform part, 0 ≤ ``uniform`` < 1.
    """
    normal, most = math.sqrt(1.0 - uniform ** 2), math.sqrt(3.0) * uniform
    low, high = 0.0, 2.0 * NORMAL
    for _ in range(50):
        middle = 0.5 * (low + high)
        if _probability(middle, normal, most) < LEVEL:
            low = middle
        else:
            high = middle
    return high


def _probability(half: float, normal: float, most: float) -> float:
    """Return the probability of |x + u| < ``half``, x normal and u uniform within ``±most``."""
    if most == 0.0:
        return math.erf(half / (math.sqrt(2.0) * normal))
    ends = np.array([half + most, half - most]) / normal
    # The integral of the normal distribution function up to each of them.
    areas = [end * 0.5 * (1.0 + math.erf(end / math.sqrt(2.0)))
             + math.exp(-0.5 * end ** 2) / math.sqrt(2.0 * math.pi) for end in ends]
    return normal / most * (areas[0] - areas[1]) - 1.0


_UNIFORM = np.append(np.linspace(0.0, 0.98, 50), [0.99, 0.999])
_QUANTILES = np.array([_quantile(float(each)) for each in _UNIFORM])


def estimate_uncertainty(identifier: Identifier, seen: PairTimes) -> Uncertainty | None:
    """Judge what an identifier's history determines; None while it is empty."""
    recorded = seen.recorded(identifier)
    return (uncertainty(*recorded, coulomb_columns(identifier.arm)) if len(recorded.times)
            else None)


def uncertainty(regressors: np.ndarray, torques: np.ndarray, times: np.ndarray,
                memory: float, coulomb: Sequence[int] = ()) -> Uncertainty:
    """Judge the least-squares estimate of recorded pairs.

    Args:
        regressors: Y_f, shape (P, n, m), P ≥ 1.
        torques: τ_f, shape (P, n) [N·m].
        times: When each pair was taken, shape (P,) [s]; NaN where that is not known.
        memory: How long the filters remember [s]: the least correlation time.
        coulomb: The column of each joint's Coulomb friction, −1 for none, see `coulomb_columns`.
    """
    order = np.argsort(times, kind='stable')  # NaN last
    regressors, torques, times = regressors[order], torques[order], times[order]
    inverse, open_, condition = _inverse(_gram(regressors))
    theta = inverse @ np.tensordot(torques, regressors, axes=2)
    residuals = torques - regressors @ theta
    freedom = max(1.0 - regressors.shape[2] / torques.size, _FREEDOM)
    variance = np.mean(residuals ** 2, axis=0) / freedom
    correlation_time = integral_correlation_time(residuals, times, memory)
    decay = _decay(times, correlation_time)
    spread = _correlated_sum(regressors, decay)
    meat = np.einsum('pjm,j,pjk->mk', regressors, variance, spread, optimize=True)
    leverage = regressors @ inverse
    alike = np.sum(leverage * spread, axis=(0, 2)) / np.maximum(
        np.sum(leverage * regressors, axis=(0, 2)), 1e-300)
    weights = 1.0 / np.sqrt(np.maximum(variance * alike, 1e-300))
    left_out = _left_out(regressors, residuals, times, weights, float(correlation_time.max()))
    friction = np.zeros(regressors.shape[1:])
    for joint, column in enumerate(coulomb):
        if column >= 0:
            friction[joint, column] = abs(theta[column])
    return Uncertainty(inverse @ meat @ inverse, open_, np.sqrt(variance),
                       np.maximum(left_out, np.sqrt(variance)), alike, correlation_time,
                       condition, friction)


def distance_to_go(regressors: np.ndarray, torques: np.ndarray,
                   theta: np.ndarray) -> tuple[float, float]:
    """Return how far an estimate is from the least squares of recorded pairs, in torque.

    Args:
        regressors: Y_f, shape (P, n, m).
        torques: τ_f, shape (P, n) [N·m].
        theta: θ̂, shape (m,).

    Returns:
        RMS over pairs and joints of Y_f (θ̂ − θ), θ that of the least squares, and of the
        residuals τ_f − Y_f θ [N·m].
    """
    rows, values = regressors.reshape(-1, theta.size), torques.reshape(-1)
    best = np.linalg.lstsq(rows, values, rcond=None)[0]
    return (float(np.sqrt(np.mean((rows @ (theta - best)) ** 2))),
            float(np.sqrt(np.mean((values - rows @ best) ** 2))))


def _gram(regressors: np.ndarray) -> np.ndarray:
    stacked = regressors.reshape(-1, regressors.shape[2])
    return stacked.T @ stacked


def _inverse(gram: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Return the inverse of Q where it has one, the directions where not, and the condition.

    Q is scaled to a unit diagonal first, as in `undetermined`.
    """
    scale = np.sqrt(np.diag(gram))
    shown = scale > 0.0
    scale = np.where(shown, scale, 1.0)
    values, vectors = np.linalg.eigh(gram / np.outer(scale, scale))
    known = values > WEAKEST * max(float(values[-1]), 1e-300)
    vectors = vectors / scale[:, None]
    open_ = vectors[:, ~known]
    largest = np.abs(open_).max(axis=0, initial=0.0)
    open_[np.abs(open_) < 1e-3 * largest] = 0.0  # rounding
    inverse = (vectors[:, known] / values[known]) @ vectors[:, known].T
    condition = float(np.sqrt(values[-1] / values[0])) if known.all() else np.inf
    return inverse, open_, condition


def integral_correlation_time(residuals: np.ndarray, times: np.ndarray,
                              least: float) -> np.ndarray:
    """Return the integral of the autocorrelation of residuals, shape (n,) [s].

    Products of residuals are averaged by the time between them, and summed up to the first time
    at which they are no longer alike (Geyer, Practical Markov Chain Monte Carlo, 1992, 3.3). For
    ρ = exp(−t/T) it is T.

    Args:
        residuals: In the order of time, shape (P, n).
        times: Shape (P,) [s]; NaN, at the end, where not known.
        least: Shortest T [s].
    """
    known = np.flatnonzero(np.isfinite(times))[:_MOST]
    errors, times = residuals[known], times[known]
    width = _BIN * least
    bins = int(_LONGEST / _BIN)
    sums, counts = np.zeros((bins, errors.shape[1])), np.zeros(bins)
    for offset in range(1, len(times)):
        place = ((times[offset:] - times[:-offset]) / width).astype(int)
        near = place < bins
        if not near.any():
            break
        place, products = place[near], (errors[offset:] * errors[:-offset])[near]
        counts += np.bincount(place, minlength=bins)
        for joint, column in enumerate(products.T):
            sums[:, joint] += np.bincount(place, column, bins)
    square = np.maximum(np.mean(errors ** 2, axis=0), 1e-300) if len(errors) else 1.0
    alike = sums / np.maximum(counts, 1.0)[:, None] / square
    # Where no pairs are that far apart: as at the next shorter time, else as the filters leave it.
    last = np.maximum.accumulate(np.where(counts > 0.0, np.arange(bins), -1))
    unknown = np.exp(-_BIN * (np.arange(bins) + 0.5))[:, None]
    alike = np.where(last[:, None] >= 0, alike[last], unknown)
    lasting = np.logical_and.accumulate(alike > _ALIKE, axis=0)
    result: np.ndarray = np.maximum(width * np.sum(alike * lasting, axis=0), least)
    return result


def _decay(times: np.ndarray, correlation_time: np.ndarray) -> np.ndarray:
    """Return exp(−Δt / T_j) between neighbours in time, shape (P − 1, n); 0 where unknown."""
    steps = np.diff(times)[:, None] / correlation_time
    return np.exp(-np.where(np.isnan(steps), np.inf, steps))


def _correlated_sum(rows: np.ndarray, decay: np.ndarray) -> np.ndarray:
    """Return K_j times the rows of each joint, (P, n, k) → (P, n, k), without forming K_j.

    An exponential kernel is a recursion from neighbour to neighbour, once in each direction.
    """
    result = rows.copy()
    carried = np.zeros_like(rows[0])
    for a in range(1, len(rows)):
        carried = decay[a - 1][:, None] * (carried + rows[a - 1])
        result[a] += carried
    carried = np.zeros_like(rows[0])
    for a in reversed(range(len(rows) - 1)):
        carried = decay[a][:, None] * (carried + rows[a + 1])
        result[a] += carried
    return result


def _left_out(regressors: np.ndarray, residuals: np.ndarray, times: np.ndarray,
              weights: np.ndarray, gap: float) -> np.ndarray:
    """Return the RMS residual on blocks of time that are left out in turn, shape (n,) [N·m].

    Pairs within ``gap`` [s] of a block are left out with it. What the rest does not determine
    stays as all pairs together say.

    Args:
        regressors: In the order of time, shape (P, n, m).
        residuals: τ_f − Y_f θ of the estimate from all of them, shape (P, n) [N·m].
        times: Shape (P,) [s].
        weights: Of the joints' equations, shape (n,) [1/(N·m)].
        gap: See above.
    """
    count = len(times)
    if count < 2 * _BLOCKS or np.isnan(times).any():
        return np.zeros(residuals.shape[1])
    square = np.zeros(residuals.shape[1])
    rows, errors = regressors * weights[:, None], residuals * weights
    for block in np.array_split(np.arange(count), _BLOCKS):
        rest = (times < times[block[0]] - gap) | (times > times[block[-1]] + gap)
        inverse, _, _ = _inverse(_gram(rows[rest]))
        change = inverse @ np.tensordot(errors[rest], rows[rest], axes=2)
        square += np.sum((residuals[block] - regressors[block] @ change) ** 2, axis=0)
    result: np.ndarray = np.sqrt(square / count)
    return result
