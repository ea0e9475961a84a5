# SPDX-License-Identifier: Apache-2.0
"""A measured log in SI units and with its effort in time: degrees, gains of drives, delay."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.arrays import checked_number
from adaptive_blf_control.errors import ParameterError

__all__ = ['Conversion', 'conversion']


class Conversion(NamedTuple):
    """What a log is converted by.

    Attributes:
        degrees: Whether positions and velocities are in degrees.
        gain: What the effort of a joint is multiplied by, by joint [N·m per unit].
        effort_delay: How far the effort is behind the motion [s].
    """

    degrees: bool
    gain: Mapping[str, float]
    effort_delay: float

    def gains(self, joints: tuple[str, ...]) -> np.ndarray:
        """Return what efforts are multiplied by, (n,); ParameterError for a gain of no joint."""
        if unknown := [joint for joint in self.gain if joint not in joints]:
            raise ParameterError('gain', unknown[0], f'one of the joints {", ".join(joints)}')
        return np.array([self.gain.get(joint, 1.0) for joint in joints])


def conversion(degrees: Any, gain: Any, effort_delay: Any) -> Conversion:
    """Return a conversion of what a caller gave.

    Raises:
        ParameterError: a value cannot be used.
    """
    if not isinstance(degrees, (bool, np.bool_)):
        raise ParameterError('degrees', degrees, 'True or False')
    if not isinstance(gain, Mapping):
        raise ParameterError('gain', gain, 'a mapping of joints to numbers')
    for joint, value in gain.items():
        if not np.isfinite(checked_number('gain', value)) or value == 0.0:
            raise ParameterError(f'gain of {joint}', value, 'a finite number that is not 0')
    delay = checked_number('effort_delay', effort_delay)
    if not np.isfinite(delay):
        raise ParameterError('effort_delay', effort_delay, 'a finite time [s]')
    return Conversion(bool(degrees), gain, delay)
