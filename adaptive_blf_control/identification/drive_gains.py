# SPDX-License-Identifier: Apache-2.0
"""Gains of the drives, from motor current to joint torque, from a log with a known load.

Without a load all gains may be scaled together, and the masses with them; a load of known mass
fixes the scale. With measured efforts i_j, in whatever unit, and gains K_j = 1 / κ_j

    i_j = κ_j (Y_j θ + L_j π)        (L = 0 where there is no load)

is solved for κ, θ and what is not known of π by Gauss-Newton. The residual is one of what is
measured. Gautier and Briot (Global Identification of Joint Drive Gains and Dynamic Parameters of
Robots, ASME J. Dyn. Sys. 2014) write K_j i_j = Y_j θ + L_j π, which is linear, but has the noise
of the currents among its regressors and makes gains too small.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arms.base_parameters import PER_BODY
from adaptive_blf_control.errors import LogError
from adaptive_blf_control.identification.uncertainty import uncertainty

__all__ = ['DriveGains', 'LoadedPairs', 'drive_gains']

_STEPS = 50
_CLOSE = 1e-6  # relative change of the gains at the end
_LEAST_SHARE = 0.01  # of the largest residual: below it a joint counts no more


class LoadedPairs(NamedTuple):
    """Filtered pairs with and without the known load, in the order of time, P of them.

    Attributes:
        regressors: Y_f, shape (P, n, m).
        efforts: Filtered measured efforts, shape (P, n).
        columns: L_f of the load, zero where there is none, shape (P, n, 10).
        times: Shape (P,) [s].
    """

    regressors: np.ndarray
    efforts: np.ndarray
    columns: np.ndarray
    times: np.ndarray


class DriveGains(NamedTuple):
    """What efforts are to be multiplied with.

    Attributes:
        gain: K_j, shape (n,) [N·m per unit of the effort].
        std: Standard deviation, infinite where the logs do not determine it, shape (n,).
        load: Ten inertial parameters of the load, as known and as found, shape (10,).
    """

    gain: np.ndarray
    std: np.ndarray
    load: np.ndarray


def drive_gains(pairs: LoadedPairs, known: np.ndarray, memory: float) -> DriveGains:
    """Estimate the gains.

    Args:
        pairs: Of a motion without the load and one with it.
        known: The first of the ten inertial parameters of the load at its frame: its mass at
            least, shape (1,) to (10,).
        memory: How long the filters remember [s].

    Raises:
        LogError: no gains > 0 explain the pairs.
    """
    solver = _Solver(pairs, known)
    for _ in range(_STEPS):
        before = solver.factor
        solver.step()
        if np.abs(solver.factor - before).max() < _CLOSE * np.abs(before).max():
            break
    factor = solver.factor
    if not np.isfinite(factor).all() or factor.min() <= 0.0:
        raise LogError('no positive gains explain these logs: does the effort of every joint '
                       'grow with its torque, and is the load known right?')
    rows, values = solver.linearised()
    scale = solver.scale
    judged = uncertainty(rows / scale[:, None], values / scale, pairs.times, memory)
    m = pairs.regressors.shape[2]
    load = np.concatenate([known, solver.unknown])
    return DriveGains(1.0 / factor, judged.std[m:m + factor.size] / factor ** 2, load)


class _Solver:
    """Gauss-Newton over θ, κ and what is not known of the load.

    Attributes:
        factor: κ, shape (n,).
        unknown: Inertial parameters of the load that are not known.
        scale: RMS residual of each joint, shape (n,).
    """

    def __init__(self, pairs: LoadedPairs, known: np.ndarray) -> None:
        self._pairs, self._n = pairs, pairs.efforts.shape[1]
        self._known = pairs.columns[:, :, :known.size] @ known
        self._open = pairs.columns[:, :, known.size:]
        self.factor = np.ones(self._n)
        self.unknown = np.zeros(PER_BODY - known.size)
        self.scale = np.ones(self._n)
        free = np.concatenate([pairs.regressors, self._open], axis=2)
        found = self._least_squares(free, pairs.efforts - self._known)
        self._take(np.insert(found, pairs.regressors.shape[2], self.factor))

    def step(self) -> None:
        """Take one step, with joints weighted by the residuals so far."""
        self._take(self._least_squares(*self.linearised()))

    def linearised(self) -> tuple[np.ndarray, np.ndarray]:
        """Return rows and values, shapes (P, n, p) and (P, n), that are solved by a step."""
        torque = self._torque()
        rows = np.concatenate([
            self.factor[:, None] * self._pairs.regressors,
            torque[:, :, None] * np.eye(self._n),
            self.factor[:, None] * self._open], axis=2)
        # κ (Y θ + L π) is counted twice by its two factors, less what is known of the load.
        return rows, self._pairs.efforts + self.factor * (torque - self._known)

    def _torque(self) -> np.ndarray:
        return np.asarray(self._pairs.regressors @ self._theta + self._known
                          + self._open @ self.unknown)

    def _least_squares(self, rows: np.ndarray, values: np.ndarray) -> np.ndarray:
        matrix = (rows / self.scale[:, None]).reshape(-1, rows.shape[2])
        length = np.linalg.norm(matrix, axis=0)
        length = np.where(length > 0.0, length, 1.0)
        found: np.ndarray = np.linalg.lstsq(matrix / length, (values / self.scale).ravel(),
                                            rcond=1e-9)[0]
        return found / length

    def _take(self, x: np.ndarray) -> None:
        m = self._pairs.regressors.shape[2]
        self._theta, self.factor, self.unknown = np.split(x, [m, m + self._n])
        residual = self._pairs.efforts - self.factor * self._torque()
        scale = np.sqrt(np.mean(residual ** 2, axis=0))
        self.scale = np.maximum(scale, _LEAST_SHARE * scale.max() + 1e-12)
