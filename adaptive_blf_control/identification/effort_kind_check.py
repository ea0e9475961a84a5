# SPDX-License-Identifier: Apache-2.0
"""Is the effort of a measured log the mean since the row before, as it is taken, or momentary?

The two are half a period apart. Logs of real robots are noisier than that and do not tell; those
of a simulation, or of slow sampling, do.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.identification.dynamic_checks import filtered_pairs, left_over, Pairs
from adaptive_blf_control.identification.finding import Excerpt, Finding, WARNING
from adaptive_blf_control.identification.settings import IdentifierSettings
from adaptive_blf_control.spelling import setting

__all__ = ['EFFORT_KIND', 'effort_kind_findings']

EFFORT_KIND = 'effort kind'
LESS = 0.5  # of the error, which the other kind leaves
LEAST = 1e-4  # of the torque: a smaller error disturbs nobody
_OTHER = {'mean': 'instant', 'instant': 'mean'}
_WORDS = {'mean': 'the mean since the row before', 'instant': 'the torque at its row'}


def effort_kind_findings(pairs: Pairs, part: Excerpt, arm: Arm,
                         settings: IdentifierSettings) -> Iterator[Finding]:
    """Efforts that fit the motion far better if they are taken for the other kind.

    Args:
        pairs: Filtered pairs of the rows, with the kind that the settings have.
        part: The rows.
        arm: The arm.
        settings: Those of the identifier.
    """
    taken = settings.filter.effort
    other = _OTHER[taken]
    others = filtered_pairs(part, arm, settings.replace(filter={'effort': other}), shifted=False)
    if others is None:
        return
    error, size = _errors(pairs)
    left = _errors(others)[0]
    if error > LEAST * size and left < LESS * error:
        yield Finding(EFFORT_KIND, None, WARNING, left / error,
                      f'the effort fits the motion better as {_WORDS[other]} (the error is '
                      f'{1.0 - left / error:.0%} less) than as {_WORDS[taken]}, which it is taken '
                      'for', setting('filter.effort', repr(other)))


def _errors(pairs: Pairs) -> tuple[float, float]:
    """Return the RMS that least squares leave of the torque of all joints, and its own [N·m]."""
    torques = pairs.measured[None]
    left = [left_over(pairs.regressors[:, joint], torques[:, :, joint])[0]
            for joint in range(torques.shape[2])]
    return float(np.linalg.norm(left)), float(np.linalg.norm(torques) / np.sqrt(len(torques[0])))
