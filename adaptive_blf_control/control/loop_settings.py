# SPDX-License-Identifier: Apache-2.0
"""What is known of the loop that the controller is in."""

from __future__ import annotations

from dataclasses import dataclass

from adaptive_blf_control.parameters.declaration import parameter
from adaptive_blf_control.parameters.settings import Settings

__all__ = ['LoopSettings']


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class LoopSettings(Settings, where='controller.loop'):
    """What is known of the loop; the gains are checked against it."""

    rate: float = parameter(
        1000.0, 'Rate of the joint states.', 'Hz', 0.0, exclusive=True)
    delay: float = parameter(
        0.0, 'From the sample of a state until the command that answers it acts. The safety '
        'filter looks as far ahead.', 's', 0.0, 1.0)
    velocity_lag: float = parameter(
        0.0, 'By which the measured velocity is late: the time constant of its filter, and half a '
        'period where it is a difference of positions.', 's', 0.0, 1.0)
    unstable: str = parameter(
        'refuse', 'What follows from gains that are unstable in this loop: refuse: the controller '
        'is not configured, live changes to such gains are refused; warn: a warning.',
        choices=('refuse', 'warn'))
