# SPDX-License-Identifier: Apache-2.0
"""Changes of the true arm while it runs: a payload picked up, friction that rises."""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.simulation.settings import ScheduleSettings

__all__ = ['PAYLOAD', 'Change', 'Schedule', 'changes_of']

PAYLOAD = 'payload'


class Change(NamedTuple):
    """At ``t`` [s] the true parameter ``name`` becomes ``value``; ``payload`` is in kg."""

    t: float
    name: str
    value: float


def changes_of(settings: ScheduleSettings) -> list[Change]:
    """Return the changes of a schedule's columns; ParameterError where one is shorter."""
    columns = (settings.time, settings.parameter, settings.value)
    if len({len(column) for column in columns}) != 1:
        raise ParameterError('arm_driver.schedule', [len(column) for column in columns],
                             'time, parameter and value of the same length')
    return [Change(float(t), name, float(value)) for t, name, value in zip(*columns) if name]


class Schedule:
    """True parameters over time.

    Attributes:
        epochs: (t, θ*) pairs, t ascending from 0; θ* of shape (m,) holds from t on.
    """

    def __init__(self, theta: np.ndarray, parameters: Sequence[str],
                 changes: Sequence[Change] = (), payload_direction: np.ndarray | None = None,
                 payload: float = 0.0) -> None:
        """Lay out the epochs.

        Args:
            theta: θ* at the start with ``payload`` included, shape (m,).
            parameters: Names of θ.
            changes: In the order of their times.
            payload_direction: dθ*/d(payload), shape (m,) [per kg]; None where the arm has none.
            payload: Payload at the start [kg].

        Raises:
            ParameterError: times out of order, an unknown name, a negative payload.
        """
        self.epochs: list[tuple[float, np.ndarray]] = [(0.0, np.array(theta, dtype=float))]
        last = 0.0
        for change in changes:
            if not (math.isfinite(change.t) and change.t >= last):
                raise ParameterError('arm_driver.schedule.time', change.t,
                                     f'a time not before the one before it, {last:g} s')
            last = change.t
            current = self.epochs[-1][1].copy()
            if change.name == PAYLOAD and payload_direction is not None:
                if not (math.isfinite(change.value) and change.value >= 0.0):
                    raise ParameterError('arm_driver.schedule.value', change.value,
                                         'a payload >= 0 kg')
                current += (change.value - payload) * payload_direction
                payload = change.value
            elif change.name in parameters and math.isfinite(change.value):
                current[list(parameters).index(change.name)] = change.value
            else:
                names = [*parameters, *([PAYLOAD] if payload_direction is not None else [])]
                raise ParameterError('arm_driver.schedule.parameter', change.name,
                                     f'one of {", ".join(names)} with a finite value')
            if change.t == self.epochs[-1][0]:
                self.epochs[-1] = (change.t, current)
            else:
                self.epochs.append((change.t, current))
