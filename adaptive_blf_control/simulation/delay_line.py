# SPDX-License-Identifier: Apache-2.0
"""Commands that act a whole number of samples later."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptive_blf_control.compiled import borrowed, jit

__all__ = ['DelayLine', 'delayed', 'new_delay_line']


class DelayLine(NamedTuple):
    """Commands under way for D ≥ 1 samples.

    Attributes:
        commands: In the order in which they were given, a ring, shape (D, n) [N·m].
        place: Where the next one goes, shape (1,).
    """

    commands: np.ndarray
    place: np.ndarray


def new_delay_line(samples: int, commanded: np.ndarray) -> DelayLine:
    """Return a line of ``samples`` D ≥ 1 in which ``commanded``, (n,) [N·m], is under way."""
    return DelayLine(np.tile(commanded, (samples, 1)), np.zeros(1, dtype=np.intp))


@jit
def delayed(line: DelayLine, commanded: np.ndarray, torque: np.ndarray) -> None:
    """Send a command into the line, and write what comes out of it now.

    Args:
        line: Takes the command.
        commanded: Command that is held, shape (n,) [N·m].
        torque: Is written: the command of D − 1 samples ago, shape (n,) [N·m].
    """
    line = borrowed(line)
    place = line.place[0]
    line.commands[place] = commanded
    place = (place + 1) % line.commands.shape[0]
    line.place[0] = place
    torque[:] = line.commands[place]
