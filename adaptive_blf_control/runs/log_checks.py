# SPDX-License-Identifier: Apache-2.0
"""Is this log what it claims to be? Checks with a verdict per joint, before learning."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.bags.measured_log import MeasuredLog
from adaptive_blf_control.errors import LogError
from adaptive_blf_control.identification.settings import IdentifierSettings
from adaptive_blf_control.runs.delay_check import delay_findings
from adaptive_blf_control.runs.dynamic_checks import (
    filtered_pairs,
    gravity_findings,
    observer,
    Pairs,
    unit_findings,
)
from adaptive_blf_control.runs.effort_kind_check import effort_kind_findings
from adaptive_blf_control.runs.finding import even, excerpt, Finding, REFUSED
from adaptive_blf_control.runs.kinematic_checks import (
    effort_findings,
    motion_findings,
    position_findings,
    rate_findings,
    velocity_findings,
)
from adaptive_blf_control.spelling import option

__all__ = ['check_log', 'checks_of', 'refuse']

_BLOCKS, _BLOCK_ROWS = 3, 3000  # of the checks that need the regressor


def check_log(log: MeasuredLog, arm: Arm, settings: IdentifierSettings,
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
    found = [*motion_findings(looked_at, arm), *position_findings(looked_at, arm),
             *effort_findings(looked_at, arm), *rate_findings(looked_at, settings.filter)]
    slow = any(finding.check == 'rate' and finding.level == REFUSED for finding in found)
    if log.measured_velocity and not slow:  # the windows of these checks would hold no row
        found += velocity_findings(looked_at, arm)
    if any(finding.level == REFUSED for finding in found):
        return found  # what a model says about such a log is of no use
    return found + list(_against_model(log, looked_at.period, arm, settings, weightless,
                                      described_masses))


def _against_model(log: MeasuredLog, period: float, arm: Arm, settings: IdentifierSettings,
                   weightless: Callable[[], Arm] | None,
                   described_masses: bool) -> Iterator[Finding]:
    settle = settings.filter.settle * observer(arm, settings).memory
    block = max(_BLOCK_ROWS, round(3.0 * settle / period))
    part = even(excerpt(log, _BLOCKS * block, _BLOCKS))
    pairs = filtered_pairs(part, arm, settings)
    if pairs is None:
        return
    yield from delay_findings(pairs, arm, np.ptp(part.q, axis=0))
    yield from effort_kind_findings(pairs, part, arm, settings)
    if not described_masses or not hasattr(arm, 'base_count'):
        return
    whole = _described(pairs, arm)
    yield from unit_findings(pairs, arm, whole)
    if weightless is not None:
        lighter = weightless()
        others = filtered_pairs(part, lighter, settings)
        if others is not None:
            yield from gravity_findings(pairs, others, arm, whole - _described(others, lighter))


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

