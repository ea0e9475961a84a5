# SPDX-License-Identifier: Apache-2.0
"""Changes of the true arm while it runs: a payload picked up, friction that rises."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import math
from typing import Any, NamedTuple

import numpy as np
import yaml

from adaptive_blf_control.bounded_yaml import load_yaml_text
from adaptive_blf_control.errors import ParameterError, UnknownParameter
from adaptive_blf_control.simulation.settings import ScheduleSettings

__all__ = ['PAYLOAD', 'Change', 'Schedule', 'changes_of', 'schedule_columns']

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


def schedule_columns(given: Any) -> dict[str, list[Any]]:
    """Return the columns of a schedule as a Python program gives it, in the order of the times.

    Args:
        given: Changes ``(t, parameter, value)``, one or a list of them; or ``time``, ``parameter``
            and ``value`` by name, as numbers or as lists of the same length; either also as a
            text in YAML, and a list may have both.

    Raises:
        ParameterError: it is none of these.
    """
    changes = sorted(_changes_in(given, given), key=lambda change: change.t)
    changes = changes or [Change(0.0, '', 0.0)]  # which is nothing
    return {'time': [change.t for change in changes],
            'parameter': [change.name for change in changes],
            'value': [change.value for change in changes]}


def _changes_in(part: Any, given: Any) -> list[Change]:
    """Return the changes of a part of what was given."""
    if isinstance(part, str):
        try:
            part = load_yaml_text(part)
        except yaml.YAMLError:
            raise _no_schedule(given) from None
    if isinstance(part, ScheduleSettings):
        part = part.values()
    if isinstance(part, Mapping):
        return _by_columns(part, given)
    if not isinstance(part, (list, tuple)):
        raise _no_schedule(given)
    if len(part) == 3 and isinstance(part[1], str) and not isinstance(part[0], (str, list, tuple)):
        t, name, value = part
        return [_change(t, name, value, given)]
    return [change for each in part for change in _changes_in(each, given)]


def _by_columns(columns: Mapping[str, Any], given: Any) -> list[Change]:
    names = ('time', 'parameter', 'value')
    for name, value in columns.items():
        if name not in names:
            raise UnknownParameter(f'schedule.{name}', value, [f'schedule.{each}'
                                                               for each in names])
    rows = [list(value) if isinstance(value, (list, tuple, np.ndarray)) else [value]
            for value in (columns.get(name, []) for name in names)]
    if len({len(row) for row in rows}) != 1:
        raise _no_schedule(given)
    return [_change(t, name, value, given) for t, name, value in zip(*rows)]


def _change(t: Any, name: Any, value: Any, given: Any) -> Change:
    if not isinstance(name, str):
        raise _no_schedule(given)
    try:
        return Change(float(t), name, float(value))
    except (TypeError, ValueError):
        raise _no_schedule(given) from None


def _no_schedule(given: Any) -> ParameterError:
    return ParameterError('schedule', given, "changes such as [(5.0, 'payload', 2.0)], each a "
                          'time in s, what changes, and its new value; or all three as columns of '
                          "the same length, {'time': [5.0], 'parameter': ['payload'], 'value': "
                          '[2.0]}; either may be a text in YAML')


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
