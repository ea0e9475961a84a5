# SPDX-License-Identifier: Apache-2.0
"""Is this log what it claims to be? Checks with a verdict per joint, before learning."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.errors import LogError
from adaptive_blf_control.identification.clipping_check import clipping_findings
from adaptive_blf_control.identification.delay_check import delay_findings
from adaptive_blf_control.identification.dynamic_checks import (
    closed_form_findings,
    filtered_pairs,
    gravity_findings,
    Observer,
    order_findings,
    Pairs,
    turned_gravity,
    unit_findings,
)
from adaptive_blf_control.identification.effort_kind_check import effort_kind_findings
from adaptive_blf_control.identification.exchange_check import exchange_finding
from adaptive_blf_control.identification.finding import (
    even,
    Excerpt,
    excerpt,
    Finding,
    LogRows,
    REFUSED,
)
from adaptive_blf_control.identification.kinematic_checks import (
    effort_findings,
    motion_findings,
    position_findings,
    rate_findings,
    velocity_findings,
)
from adaptive_blf_control.identification.repetition_checks import (
    column_findings,
    row_findings,
    section_findings,
)
from adaptive_blf_control.identification.settings import IdentifierSettings
from adaptive_blf_control.identification.spike_checks import spike_findings
from adaptive_blf_control.spelling import option

__all__ = ['LearnedLog', 'check_log', 'checks_of', 'refuse', 'weightless_of']

_LEAST_ROWS = 20  # of a log that is looked at
_BLOCKS, _BLOCK_ROWS = 3, 3000  # of the checks that need the regressor


def check_log(log: LogRows, arm: Arm, settings: IdentifierSettings,
              weightless: Callable[[], Arm] | None = None,
              described_masses: bool = True) -> list[Finding]:
    """Return what is odd about a log; an empty list where all is sound.

    Args:
        log: The log.
        arm: The arm that is to be learned.
        settings: Those of the filters tell what can be used.
        weightless: Makes the same arm without gravity, where there is one.
        described_masses: Whether the masses of the URDF mean anything.
    """
    looked_at = excerpt(log)
    found = _without_model(log, looked_at, arm, settings)
    if any(finding.level == REFUSED for finding in found):
        return found  # what a model says about such a log is of no use
    part = _part_for_model(log, looked_at.period, arm, settings)
    return found + list(_against_model(part, arm, settings, weightless, described_masses))


def weightless_of(arm: Arm) -> Callable[[], Arm] | None:
    """Return what makes the same arm without gravity; None where it has none, or cannot tell."""
    made: Callable[[], Arm] | None = getattr(arm, 'without_gravity', None)
    model: Any = getattr(arm, 'model', None)
    return made if made is not None and model.gravity.linear.any() else None


def _without_model(log: LogRows, looked_at: Excerpt, arm: Arm,
                   settings: IdentifierSettings) -> list[Finding]:
    found = [*motion_findings(looked_at, arm), *position_findings(looked_at, arm),
             *effort_findings(looked_at, arm),
             *column_findings(looked_at, arm, log.measured_velocity),
             *rate_findings(looked_at, settings.filter), *row_findings(looked_at, arm),
             *section_findings(looked_at), *spike_findings(looked_at, arm),
             *clipping_findings(looked_at, arm)]
    slow = any(finding.check == 'rate' and finding.level == REFUSED for finding in found)
    if log.measured_velocity and not slow:  # the windows of these checks would hold no row
        found += velocity_findings(looked_at, arm)
    return found


def _part_for_model(log: LogRows, period: float, arm: Arm,
                    settings: IdentifierSettings) -> Excerpt:
    settle = settings.filter.settle * Observer(arm, settings).memory
    block = max(_BLOCK_ROWS, round(3.0 * settle / period))
    return even(excerpt(log, _BLOCKS * block, _BLOCKS))


def _against_model(part: Excerpt, arm: Arm, settings: IdentifierSettings,
                   weightless: Callable[[], Arm] | None,
                   described_masses: bool) -> Iterator[Finding]:
    pairs = filtered_pairs(part, arm, settings)
    if pairs is None:
        return
    yield from delay_findings(pairs, arm, np.ptp(part.q, axis=0))
    yield from effort_kind_findings(pairs, part, arm, settings)
    if not described_masses:
        return
    if not hasattr(arm, 'base_count'):
        yield from closed_form_findings(pairs, arm)
        return
    whole = _described(pairs, arm)
    exchanged = list(order_findings(pairs, arm, whole))
    yield from exchanged
    if not exchanged and (
            moved := exchange_finding(part, arm, settings, _described)) is not None:
        yield moved
    lighter = None if weightless is None else weightless()
    others = None if lighter is None else filtered_pairs(part, lighter, settings)
    units = unit_findings(pairs, arm, whole)
    if others is None:
        yield from units
        return
    weight = whole - _described(others, lighter)
    turned = turned_gravity(pairs, whole, weight, _gravity_of(arm))
    if turned is not None:
        yield turned
        return
    yield from units
    yield from gravity_findings(pairs, others, arm, weight)


def _gravity_of(arm: Any) -> np.ndarray:
    return np.array(arm.model.gravity.linear, dtype=float)


def _described(pairs: Pairs, arm: Any) -> np.ndarray:
    """Return the filtered torque of the URDF's masses, without friction, (K, n) [N·m]."""
    base = arm.base_count
    result: np.ndarray = pairs.regressors[:, :, :base] @ arm.nominal[:base]
    return result


def refuse(findings: list[Finding], source: str) -> None:
    """Raise where a log cannot be right.

    Raises:
        LogError: names joints and figures, and what would help.
    """
    fatal = [str(finding) for finding in findings if finding.level == REFUSED]
    if fatal:
        raise LogError(f'{source}: ' + '; '.join(fatal)
                       + f'; {option("force")} learns from it all the same')


def checks_of(findings: list[Finding]) -> list[dict[str, Any]]:
    """Return findings as figures."""
    return [finding._asdict() for finding in findings]


class _Rows(NamedTuple):
    """The rows of a log that is given as arrays, see `LogRows`."""

    t: np.ndarray
    q: np.ndarray
    qd: np.ndarray
    tau: np.ndarray
    breaks: tuple[int, ...]
    measured_velocity: bool


class LearnedLog:
    """What the checks say of a log that was learned from; those that need a model when asked.

    Attributes:
        found: What was found without a model.
    """

    def __init__(self, arm: Arm, settings: IdentifierSettings, *arrays: np.ndarray,
                 breaks: tuple[int, ...] = ()) -> None:
        """Look at a log; a copy is kept of the rows that are compared with a model.

        Args:
            arm: The arm.
            settings: Those of the identifier.
            arrays: t (N,), q, qd and tau (N, n); rows that are not finite, or not after the row
                before, are left out.
            breaks: Rows at which the clock was set back.
        """
        self._arm, self._settings = arm, settings
        t, *others = (np.asarray(array, dtype=float) for array in arrays)
        keep = np.isfinite(t)
        for array in others:
            keep &= np.isfinite(array).all(axis=1)
        keep[1:] &= t[1:] > t[:-1]
        filters = settings.filter
        q, qd, tau = (array[keep] for array in others)
        rows = _Rows(t[keep], q, qd, tau,
                     tuple(int(np.count_nonzero(keep[:row])) for row in breaks),
                     filters.state_order == 0 or filters.state_filter != 'low_pass')
        self.found: list[Finding] = []
        self._part: Excerpt | None = None
        if len(rows.t) < _LEAST_ROWS:
            return
        looked_at = excerpt(rows)
        self.found = _without_model(rows, looked_at, arm, settings)
        if not self.refused:
            self._part = _part_for_model(rows, looked_at.period, arm, settings)

    @property
    def refused(self) -> list[str]:
        """What cannot be right, in sentences."""
        return [str(finding) for finding in self.found if finding.level == REFUSED]

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """All that was found."""
        if self._part is None:
            return tuple(self.found)
        return (*self.found, *_against_model(self._part, self._arm, self._settings,
                                             weightless_of(self._arm), True))
