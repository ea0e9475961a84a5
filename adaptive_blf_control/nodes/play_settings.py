# SPDX-License-Identifier: Apache-2.0
"""How a bag is played: the arguments of ``play``, checked."""

from __future__ import annotations

from dataclasses import dataclass

from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.messages.topics import THETA_HAT

__all__ = ['PlaySettings']


@dataclass(frozen=True)
class PlaySettings:
    """How to play.

    Attributes:
        rate: Bag seconds per second.
        topics: Which topics, with or without leading slash; all where empty.
        loop: Begin again at the end, until stopped.
        wait: How long to wait for a subscriber of each topic [s].
        clock: Ticks of /clock per bag second; 0 for none. A bag that has /clock plays its own.
        lockstep: Wait for the answers to each state instead of for its time.
        answers: In lockstep, topics that answer, relative to the namespace of the states.
        timeout: In lockstep, how long an answer may take [s].
    """

    rate: float = 1.0
    topics: tuple[str, ...] = ()
    loop: bool = False
    wait: float = 5.0
    clock: float = 100.0
    lockstep: bool = False
    answers: tuple[str, ...] = (THETA_HAT,)
    timeout: float = 10.0

    def __post_init__(self) -> None:
        """Refuse what cannot be played."""
        if not 0.0 < self.rate < 1e6:
            raise ParameterError('--rate', self.rate, 'a number above 0 and below 1e6')
        if not 0.0 <= self.clock <= 1e5:
            raise ParameterError('--clock', self.clock, '0 to 100000 Hz')
        if not 0.0 <= self.wait < 1e6:
            raise ParameterError('--wait', self.wait, 'seconds, 0 or more')
        if not 0.0 < self.timeout < 1e6:
            raise ParameterError('--timeout', self.timeout, 'seconds, above 0')
        if self.lockstep and not self.answers:
            raise ParameterError('--answers', [], 'at least one topic')
