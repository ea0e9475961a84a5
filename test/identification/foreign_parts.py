# SPDX-License-Identifier: Apache-2.0
"""A state filter, a history and a change monitor that share no code with ours."""

from __future__ import annotations

import numpy as np


class Smoothing:
    """The same first-order lag of 5 ms on position, velocity and torque."""

    memory = 0.005

    def __init__(self, arm, settings) -> None:
        self.samples = 0
        self.reset()

    def reset(self) -> None:
        self._state = None

    def update(self, dt, q, qd, tau):
        self.samples += 1
        given = np.array([q, qd, tau])
        part = 1.0 if self._state is None else 1.0 - np.exp(-dt / self.memory)
        self._state = given if self._state is None else (
            self._state + part * (given - self._state))
        return self._state


class LatestPairs:
    """Every tenth pair; the oldest leaves."""

    def __init__(self, arm, settings) -> None:
        self._shape, self.size, self.revision = (arm.n, arm.m), settings.history.size, 0
        self.retuned = []
        self.clear()

    def clear(self) -> None:
        self._pairs, self._offers, self.insertions = [], 0, 0
        self._sum()

    def retune(self, size, epsilon, minimum_growth) -> None:
        self.retuned.append((size, epsilon, minimum_growth))
        self.size = size
        self._pairs = self._pairs[-size:]
        self._sum()

    def offer(self, regressor, torque) -> int:
        self._offers += 1
        if self._offers % 10:
            return -1
        self._pairs = [*self._pairs, (regressor.copy(), torque.copy())][-self.size:]
        self.insertions += 1
        self._sum()
        return self.count - 1

    def _sum(self) -> None:
        n, m = self._shape
        self.count = len(self._pairs)
        self.regressors = np.array([pair[0] for pair in self._pairs]).reshape(-1, n, m)
        self.torques = np.array([pair[1] for pair in self._pairs]).reshape(-1, n)
        self.gram = np.einsum('pnm,pnk->mk', self.regressors, self.regressors)
        self.moment = np.einsum('pnm,pn->m', self.regressors, self.torques)
        self.rank = int(np.linalg.matrix_rank(self.gram))
        self.sigma_min = float(np.linalg.eigvalsh(self.gram)[0]) * (self.rank == m)
        self.revision += 1


class Alarm:
    """Says once, at the 100th pair, that the arm has changed."""

    def __init__(self, arm, settings) -> None:
        self.watched, self.resets, self.retuned = 0, 0, []

    def watch(self, dt, regressor, torque, history) -> bool:
        self.watched += 1
        self.pairs = history.count
        return self.watched == 100

    def reset(self) -> None:
        self.resets += 1

    def retune(self, window, threshold, resolution) -> None:
        self.retuned.append((window, threshold, resolution))


class Crooked(Smoothing):
    """Returns one joint too few."""

    def update(self, dt, q, qd, tau):
        return [value[:-1] for value in super().update(dt, q, qd, tau)]


class Flat(LatestPairs):
    """Sums up to a row."""

    def _sum(self) -> None:
        super()._sum()
        self.gram = self.gram[:1]


class Nothing:
    """Has none of the abilities that a part needs."""

    def __init__(self, arm, settings) -> None:
        pass
