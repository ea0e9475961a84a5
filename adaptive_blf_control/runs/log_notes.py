# SPDX-License-Identifier: Apache-2.0
"""What is to be heeded in θ̂ and in how sure it is said to be, in sentences."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from adaptive_blf_control.identification.confidence import DETERMINED
from adaptive_blf_control.identification.effort_kind_check import EFFORT_KIND
from adaptive_blf_control.identification.finding import Finding
from adaptive_blf_control.identification.identifier import Identifier
from adaptive_blf_control.identification.uncertainty import distance_to_go, Uncertainty
from adaptive_blf_control.runs.log_pass import Section
from adaptive_blf_control.spelling import option

__all__ = ['notes_on']

_ARRIVED = 1e-3  # of the torque, which is nothing to speak of
_EQUATIONS = 2.0  # independent equations per parameter; logs of real robots have 4 and more
_COVERED = 0.8  # of the tested torques of a joint; intervals that hold cover 95 %


def notes_on(identifier: Identifier, sections: Sequence[Section], judged: Uncertainty | None,
             figures: Mapping[str, Any], findings: Sequence[Finding] = ()) -> tuple[str, ...]:
    """Return why standard deviations and "determined" are not to be trusted; none where they are.

    Args:
        identifier: After the pass.
        sections: What was learned from and predicted.
        judged: How sure θ̂ is said to be; None where no pair was recorded.
        figures: Those of the pass and of the model, see `figures_of` and `model_figures`.
        findings: What the checks have found in the logs.
    """
    if judged is None:
        return ()
    on_its_way = tuple(_on_its_way(identifier))
    return (*on_its_way, *_no_robot(figures), *_too_short(identifier, sections, judged),
            *(() if on_its_way else _too_narrow(figures, findings)))


def _on_its_way(identifier: Identifier) -> Iterator[str]:
    """Yield a note where θ̂ is far from what the recorded pairs say: intervals hold for that."""
    stack = identifier.stack
    if not stack.count:
        return
    away, residual = distance_to_go(stack.regressors[:stack.count], stack.torques[:stack.count],
                                    identifier.theta)
    if away > max(residual, _ARRIVED * float(np.abs(stack.torques[:stack.count]).max())):
        yield (f'θ̂ has not converged: on the recorded pairs its torques differ by {away:.3g} N·m '
               f'(RMS) from those of their least squares, which leaves {residual:.3g} N·m. '
               'Standard deviations and intervals hold for that fit. A larger gamma, kt or kh '
               'moves θ̂ faster')


def _no_robot(figures: Mapping[str, Any]) -> Iterator[str]:
    """Yield a note where θ̂ is no robot's although nothing of it is left open."""
    positive = figures['positive_mass']
    if positive['theta_hat'] == 0 and set(figures['confidence'].values()) == {DETERMINED}:
        yield (f'θ̂ is that of no robot: M(q) > 0 at none of {positive["postures"]} postures, and '
               'the data determine every parameter. Has the effort the opposite sign, or is the '
               'arm another one? ' + option('gain', '{JOINT: -1}', 'JOINT:-1') + ' turns the sign')


def _too_short(identifier: Identifier, sections: Sequence[Section],
               judged: Uncertainty) -> Iterator[str]:
    """Yield a note where residuals are alike for so long that few samples are independent.

    A stretch S of residuals with the correlation time T counts as S / 2T independent ones.
    """
    learned = sum(section.train.end - section.train.start for section in sections)
    count, m = float(np.sum(0.5 * learned / judged.correlation_time)), identifier.arm.m
    if count < _EQUATIONS * m:
        yield (f'the {learned:.3g} s that were learned from are short: with residuals that are '
               f'alike for {judged.correlation_time.max():.2g} s they count as {count:.0f} '
               f'independent equations for {m} parameters. Standard deviations of so few are too '
               'small, and parameters that are said to be determined may be far off: a longer '
               'motion, or ' + option('train', '(T0, T1)', 'T0:T1') + ' with more of it, tells')


def _too_narrow(figures: Mapping[str, Any], findings: Sequence[Finding]) -> Iterator[str]:
    """Yield a note where torques that were not learned from lie outside their intervals."""
    rows = [(part, joint) for joint, part, error, torque in zip(
        figures['joints'], figures['test_coverage'], figures['test_rmse'],
        figures['test_torque_rms'], strict=True)
        if part is not None and error > _ARRIVED * torque]
    covered, joint = min(rows, default=(1.0, ''))
    kinds = [finding for finding in findings if finding.check == EFFORT_KIND]
    if covered < _COVERED:
        yield (f'only {covered:.0%} of the tested torques of {joint} are inside their 95 % '
               'intervals: standard deviations are too small, and parameters that are said to be '
               'determined may be far off. '
               + (f'Above all {kinds[0]}' if kinds else 'The test span moves otherwise than the '
                  'training, which may be too short'))
