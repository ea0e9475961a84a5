# SPDX-License-Identifier: Apache-2.0
"""The load that a robot carries, found while it moves, beside the model of the robot without it.

The model of before stays as it is; what the torque is more than it says belongs to a body at a
frame (`load_fit`). It is judged after every block of time: is the load still the same
(`load_segment`), which one is it, and does it explain enough to be one at all?
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arms.base_parameters import PER_BODY
from adaptive_blf_control.arms.pseudo_inertia import BASIS
from adaptive_blf_control.arrays import checked_number
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.identifier import Identifier
from adaptive_blf_control.identification.load_fit import (
    described,
    fit_load,
    Load,
    squares,
    sums_of,
)
from adaptive_blf_control.identification.load_segment import LoadSegment

__all__ = ['NO_LOAD', 'PayloadEstimate', 'PayloadEstimator']

NO_LOAD = Load(0.0, np.zeros(3), np.zeros(6))
_GYRATION = 0.1  # m: of the ball around the frame's origin that a load is before any data
_ALIKE = 2.0  # memories of the filters for which errors are alike
_PRIOR_SECONDS = 1.0  # of data that the residual scale counts as before any data
_KNOWN_SECONDS = 8.0  # at most, that the one of before a change counts as
_DESCRIBED = 0.05  # residual scale before any data, of the RMS torque
_LEAST_RELATIVE = 0.02  # of the RMS torque: no model of a robot is better
_LEAST_FREEDOM = 0.1  # least part of the equations that is taken not to have been fitted
_REWEIGHTINGS = 2
_MOVING = 0.4  # 1/s: relative change of L from which all of the time counts
_AT_REST = 0.05  # part of the time that counts at rest
_LAG = 3  # blocks that a change may take until it is seen
_CHANGE = 60.0  # twice the log likelihood ratio from which a load has changed, of ten parameters
_PART = 0.3  # of the squared residual that a load has to explain
_LATER = 6.0  # the same, 20 to 1: from which a new load was attached after the segment began
_SURE = 3.0  # standard deviations that a mass has to differ from zero
_UNNOTICED = 0.5  # of the mass that a load may well have: above it, it has to have shown
_WITHIN = 1.96  # standard deviations: the 95 % interval


class PayloadEstimate(NamedTuple):
    """What is known of the load at one moment.

    Attributes:
        attached: Whether there is one.
        since: Since when it is as it is, attached or not [s].
        load: The load; zero where there is none.
        std: Standard deviations of all of it; infinite where that has no meaning.
        inertial: Its ten inertial parameters at the frame, zero where there is none, shape (10,).
        most: Upper end of the 95 % interval of a load's mass, reported or not [kg].
        undecided: None is reported, but one that the arm may well carry need not have shown yet.
    """

    attached: bool
    since: float
    load: Load
    std: Load
    inertial: np.ndarray
    most: float
    undecided: bool


class _Scale(NamedTuple):
    """How large residuals are.

    Attributes:
        weights: 1 / (2 T_j s_j²) per joint, shape (n,).
        variance: s_j² of what the load that is reported leaves, shape (n,) [N²·m²].
        seconds: Of data that it is from.
    """

    weights: np.ndarray
    variance: np.ndarray
    seconds: float


class PayloadEstimator:
    """Finds the load from the pairs of the torque filter.

    Attributes:
        estimate: What is known now; None before the first block.
        changes: How often a load was attached, removed or exchanged; one that was there from the
            beginning was attached once.
    """

    def __init__(self, columns: np.ndarray, baseline: np.ndarray, memory: float, *,
                 scale: float = 1.0, least_mass: float = 0.1, period: float = 0.25,
                 gap: float = 0.05) -> None:
        """Begin without knowing whether there is a load.

        Args:
            columns: What a load adds to θ, see `load_map`, shape (m, 10).
            baseline: θ of the robot without the load, shape (m,).
            memory: How long the filters remember [s].
            scale: A mass that a load may well have [kg].
            least_mass: Mass below which a load is none [kg].
            period: Length of a block [s].
            gap: Longest interval between two samples that belong together [s].

        Raises:
            ParameterError: a number is not positive and finite, or shapes do not fit.
        """
        for name, value in (('memory', memory), ('scale', scale), ('period', period)):
            if not 0.0 < checked_number(name, value) < np.inf:
                raise ParameterError(f'payload {name}', value, 'a finite number > 0')
        if columns.shape != (len(baseline), PER_BODY):
            raise ParameterError('columns', columns.shape,
                                 f'the shape {(len(baseline), PER_BODY)}')
        self._columns, self._baseline = columns, baseline
        self._alike = _ALIKE * memory
        self._least_mass, self._period, self._gap = least_mass, period, gap
        self._scale = scale
        self._prior = scale * np.diag([_GYRATION ** 2] * 3 + [1.0])
        inverse = np.linalg.inv(self._prior)
        turned = np.einsum('ij,kjl->kil', inverse, BASIS)
        self._ridge = 0.01 * np.einsum('kil,mli->km', turned, turned)
        self.estimate: PayloadEstimate | None = None
        self.changes = 0
        self._updates = 0
        self._mixed_block = False  # whether the segment begins with both loads
        self._segment: LoadSegment | None = None
        self._variance: np.ndarray | None = None  # of residuals, known from before the segment
        self._known = _PRIOR_SECONDS  # of data that it counts as
        self._torque, self._seconds = np.zeros(1), 0.0  # ∫ τ_f² dt
        self._last = self._block_begin = -np.inf
        self._earlier: deque[_Scale] = deque(maxlen=_LAG)
        self._rows: list[tuple[np.ndarray, np.ndarray, float]] = []

    def take(self, t: float, regressor: np.ndarray, torque: np.ndarray) -> bool:
        """Take a pair of settled filters; return whether it was judged, after a whole block.

        Args:
            t: Time of the sample [s].
            regressor: Y_f, shape (n, m).
            torque: τ_f, shape (n,) [N·m].
        """
        interval, self._last = t - self._last, t
        if not 0.0 < interval <= self._gap:
            self._rows.clear()
            return False
        if not self._rows:
            self._block_begin = t - interval
        self._rows.append((regressor @ self._columns, torque - regressor @ self._baseline,
                           interval))
        self._torque = self._torque + interval * torque ** 2
        self._seconds += interval
        if t - self._block_begin < self._period * (1.0 - 1e-9):
            return False
        self._judge_block()
        return True

    def follow(self, t: float, identifier: Identifier) -> bool:
        """Take the pair of an identifier after its update; return whether it was judged.

        A sample that the identifier has dropped, or at which its filters are not settled, is none.

        Args:
            t: Time of the sample [s].
            identifier: Of the arm that the columns belong to.
        """
        updates = identifier.updates
        if updates == self._updates or not identifier.settled:
            return False
        self._updates = updates
        return self.take(t, *identifier.pair)

    @property
    def baseline(self) -> np.ndarray:
        """θ of the robot without the load, shape (m,)."""
        return self._baseline

    @property
    def theta(self) -> np.ndarray:
        """θ of the robot with the load that is known now, shape (m,)."""
        inertial = np.zeros(PER_BODY) if self.estimate is None else self.estimate.inertial
        return np.asarray(self._baseline + self._columns @ inertial)

    def added_torque(self, regressor: np.ndarray) -> np.ndarray:
        """Return what the load adds to the torque, Y or Y_f of shape (..., n, m) → (..., n)."""
        return np.asarray(regressor @ (self.theta - self._baseline))

    def _judge_block(self) -> None:
        columns, residuals, intervals = (np.array(part) for part in zip(*self._rows))
        self._rows.clear()
        if self._segment is None:
            self._segment = LoadSegment(residuals.shape[1], self._block_begin)
        intervals = intervals * self._news(columns, float(intervals.sum()))
        if self._mixed_block:
            self._segment, self._mixed_block = self._segment.without_first(), False
        self._segment.add(sums_of(columns, residuals, intervals), self._block_begin,
                          float(intervals.sum()))
        self._look_for_change(self._segment)
        weights = self._weights(self._segment)
        before, found = self.estimate, self._judged(self._segment, weights)
        if found.attached and (before is None or not before.attached) and (
                self._left_out_before(self._segment, weights)):
            weights = self._weights(self._segment)
            found = self._judged(self._segment, weights)
        was_attached = before is not None and before.attached
        if found.attached != was_attached or (
                before is not None and found.attached and self._segment.begin > before.since):
            self.changes += 1
        self.estimate = found
        self._earlier.append(_Scale(weights, self._residual_scale(self._segment),
                                    self._known + self._segment.seconds))

    def _news(self, columns: np.ndarray, seconds: float) -> float:
        """Return which part of a block counts: what the arm tells at rest it has told before.

        The errors of a model are those of a posture, and as long as that is the same, so are they.
        """
        scaled = columns / np.sqrt(np.diag(self._ridge))
        travel = np.linalg.norm(np.ptp(scaled, axis=0)) / max(
            np.sqrt(np.mean(np.sum(scaled ** 2, axis=(1, 2)))), 1e-300)
        return float(np.clip(travel / (_MOVING * seconds), _AT_REST, 1.0))

    def _look_for_change(self, segment: LoadSegment) -> None:
        """Begin another segment where the load has changed."""
        if not self._earlier:
            return
        before = self._earlier[0]  # of a time before what is tested
        block, ratio, part = segment.change(before.weights, self._ridge)
        if ratio > _CHANGE and part > _PART:
            # The block of the change itself has both loads in the memory of the filters.
            self._segment = segment.after(min(block + 1, len(segment) - 1))
            if block > _LAG:
                self._segment.begin = segment.begin_of(block)
                self._variance = before.variance
                self._known = min(before.seconds, _KNOWN_SECONDS)
            else:  # within a few blocks it is the same change, of which more is seen now
                self._segment.begin = segment.begin
            self._mixed_block = block + 2 == len(segment)  # it may be the last one that is
            self._earlier.clear()

    def _floor(self, part: float) -> np.ndarray:
        return np.asarray(part ** 2 * self._torque / self._seconds + 1e-12)

    def _weights(self, segment: LoadSegment) -> np.ndarray:
        """Return 1 / (2 T_j s_j²) from the residuals of a segment, shape (n,).

        Errors of a model are alike for seconds, and for as long a load can explain those of joints
        that feel little of it. So the residuals of a new segment are too small a measure of these
        joints, and what was known before it counts for seconds, too.
        """
        joints = len(segment.total)
        equations = joints * segment.seconds / (2.0 * self._alike)
        freedom = max(1.0 - PER_BODY / max(equations, 1e-9), _LEAST_FREEDOM)
        variance = self._described()
        for _ in range(_REWEIGHTINGS):
            weighted = np.tensordot(0.5 / (self._alike * variance), segment.total, axes=1)
            best = np.linalg.solve(weighted[:-1, :-1] + self._ridge, weighted[:-1, -1])
            variance = self._mixed(squares(segment.total, best) / freedom, segment.seconds)
        return np.asarray(0.5 / (self._alike * variance))

    def _described(self) -> np.ndarray:
        return self._floor(_DESCRIBED) if self._variance is None else self._variance

    def _mixed(self, squared: np.ndarray, seconds: float) -> np.ndarray:
        """Return the variance from squared residuals of some seconds and from before, (n,)."""
        mixed = (self._known * self._described() + squared) / (self._known + seconds)
        return np.asarray(np.maximum(mixed, self._floor(_LEAST_RELATIVE)))

    def _residual_scale(self, segment: LoadSegment) -> np.ndarray:
        """Return the variance of what the load that is reported, maybe none, leaves, (n,)."""
        assert self.estimate is not None
        return self._mixed(squares(segment.total, self.estimate.inertial), segment.seconds)

    def _left_out_before(self, segment: LoadSegment, weights: np.ndarray) -> bool:
        """Leave out what was before a new load was attached; return whether there was something.

        A load is reported once it is certain. That another one began when it was attached may not
        be: what was before, without it, then stands in the same segment and pulls at the estimate.
        """
        block, ratio = segment.attachment(weights, self._ridge)
        if ratio < _LATER:
            return False
        rest = segment.after(block)
        squared = (segment.total - rest.total)[:, -1, -1]
        seconds = segment.seconds - rest.seconds
        self._variance = self._mixed(squared, seconds)
        self._known = min(self._known + seconds, _KNOWN_SECONDS)
        # The block of the attachment itself is partly without the load.
        self._segment = segment.after(min(block + 1, len(segment) - 1))
        self._segment.begin = rest.begin
        self._earlier.clear()
        return True

    def _judged(self, segment: LoadSegment, weights: np.ndarray) -> PayloadEstimate:
        weighted = np.tensordot(weights, segment.total, axes=1)
        before = self.estimate
        near = before.inertial if before is not None and before.attached else None
        inertial = fit_load(weighted, self._prior, near)
        # Without the curvature of the barrier, which would make a small mass look certain.
        hessian = weighted[:-1, :-1] + self._ridge
        load, std = described(inertial, _covariance(segment, weights, inertial, hessian))
        most = load.mass + _WITHIN * std.mass
        without, along = weighted[-1, -1], float(squares(weighted, inertial))
        if (without - along > max(_CHANGE, _PART * without)
                and load.mass > max(self._least_mass, _SURE * std.mass)):
            return PayloadEstimate(True, segment.begin, load, std, inertial, most, False)
        since = segment.begin if before is None or before.attached else before.since
        return PayloadEstimate(False, since, NO_LOAD, _unknown(std.mass), np.zeros(PER_BODY), most,
                               most > max(_UNNOTICED * self._scale, self._least_mass))


def _unknown(mass: float) -> Load:
    return Load(mass, np.full(3, np.inf), np.full(6, np.inf))


def _covariance(segment: LoadSegment, weights: np.ndarray, inertial: np.ndarray,
                hessian: np.ndarray) -> np.ndarray:
    """Return the covariance of π: the larger one of what weights and residuals say, (10, 10).

    The scores of the blocks show how alike errors are, also across joints and for longer than a
    block: their sum has the variance of Newey and West (Econometrica 1987) over two neighbours.
    """
    inverse = np.linalg.inv(hessian)
    sums = np.einsum('j,kjab->kab', weights, segment.blocks)
    scores = sums[:, :-1, -1] - sums[:, :-1, :-1] @ inertial
    spread = scores.T @ scores
    for lag in (1, 2):
        shared = scores[lag:].T @ scores[:-lag]
        spread += (1.0 - lag / 3.0) * (shared + shared.T)
    seen = inverse @ spread @ inverse
    scale = np.sqrt(np.maximum(np.diag(seen) / np.diag(inverse), 1.0))
    return np.asarray(inverse * np.outer(scale, scale))
