# SPDX-License-Identifier: Apache-2.0
"""What controller and identifier of one process hand each other in memory.

A joint state is taken from the middleware and decoded once. The controller answers the newest;
then the identifier learns from every one. Estimates and adaptation terms go from one to the other
as arrays, through the same gates as the messages that the nodes exchange in two processes.

Each node takes what is for it under its own lock, so that a request to one of them, e.g. a change
of the history's size, does not hold up the other.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from typing import TypeVar

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.configuration.node_settings import (
    ControllerNodeSettings,
    IdentifierNodeSettings,
)
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.limits.cause_intervals import CauseBounds
from adaptive_blf_control.limits.set_estimator import SetEstimator
from adaptive_blf_control.nodes.state_input import JointSample
from adaptive_blf_control.runtime.data_node import DataNode
from adaptive_blf_control.runtime.data_topics import QUEUE_DEPTH

__all__ = ['Handover', 'emptied', 'handed_over_decimation']

Item = TypeVar('Item')


class Handover:
    """Boxes, each filled by one node and emptied by the other.

    Attributes:
        states: For the identifier: what the controller has seen, in the order of arrival.
        terms: For the identifier: stamps [ns] and adaptation terms, shape (m,).
        estimates: For the controller: stamps [ns] and θ̂, shape (m,).
        bounds: For the controller: what is known of the arm for sure; the last one counts.
        learn: Lets the identifier take its states; set by it.
        arm: That of the identifier; set by it.
        set_estimator: Likewise, what makes the bounds; None where nothing does.
    """

    arm: Arm
    set_estimator: SetEstimator | None = None

    def __init__(self) -> None:
        """Start empty; as many samples may wait as would in the middleware."""
        self.states: deque[JointSample] = deque(maxlen=QUEUE_DEPTH)
        self.terms: deque[tuple[int, np.ndarray]] = deque(maxlen=QUEUE_DEPTH)
        self.estimates: deque[tuple[int, np.ndarray]] = deque(maxlen=QUEUE_DEPTH)
        self.bounds: deque[CauseBounds] = deque(maxlen=1)
        self.learn: Callable[[], None] = _nobody_learns

    def begin_for(self, arm: Arm) -> None:
        """Begin to exchange what belongs to ``arm``, that of the controller.

        Raises:
            ParameterError: the identifier has another one.
        """
        for name in ('joints', 'parameters'):
            own, other = getattr(arm, name), getattr(self.arm, name)
            if own != other:
                raise ParameterError(f'controller: {name} of the arm', list(own), (
                    f'those of the identifier in the same process, {list(other)}'))
        self.estimates.clear()
        self.bounds.clear()


def handed_over_decimation(node: DataNode[ControllerNodeSettings]
                           | DataNode[IdentifierNodeSettings]) -> int:
    """Return the interval, in samples, at which a node publishes what it also hands over.

    In lockstep it is 1, because the driver waits for each.
    """
    return 1 if node.lockstep else node.settings.composed_decimation


def emptied(box: deque[Item]) -> Iterator[Item]:
    """Yield what is in a box, which another thread may be filling, and take it out."""
    while box:
        yield box.popleft()


def _nobody_learns() -> None:
    """Stand in for an identifier that does not run yet."""
