# SPDX-License-Identifier: Apache-2.0
"""Measured logs as one call of `identify` reads them: how they are read, converted, named."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
import os
from typing import Any

from adaptive_blf_control.bags.log_conversion import conversion
from adaptive_blf_control.bags.logs import Log, read_log
from adaptive_blf_control.bags.measured_log import MeasuredLog
from adaptive_blf_control.errors import ParameterError, UnknownParameter

__all__ = ['LogOptions', 'name_of', 'read_converted', 'several']


@dataclass(frozen=True)
class LogOptions:
    """How logs are read, to be used for several calls; `identify` takes the same by keyword.

    Attributes:
        topic: Topic of joint values in a bag.
        columns: Columns of a CSV file, or names of arrays, by kind, see `read_log`.
        degrees: Whether positions and velocities are in degrees.
        gain: What the effort of a joint is multiplied by, by joint [N·m per unit].
        effort_delay: How far the effort is behind the motion [s].
        force: Whether to learn even from logs that the checks refuse.
    """

    topic: str | None = None
    columns: Mapping[str, str] | None = None
    degrees: bool = False
    gain: Mapping[str, float] = field(default_factory=dict)
    effort_delay: float = 0.0
    force: bool = False

    def __new__(cls, *_: Any, **given: Any) -> LogOptions:
        """Refuse names that are no option, as every other name is refused."""
        names = [each.name for each in fields(cls)]
        for name, value in given.items():
            if name not in names:
                raise UnknownParameter(name, value, names)
        return super().__new__(cls)

    def __post_init__(self) -> None:
        """Refuse what cannot be applied."""
        conversion(self.degrees, self.gain, self.effort_delay)

    @classmethod
    def taken(cls, options: Any, given: Mapping[str, Any]) -> LogOptions:
        """Return options with those of ``given`` that are not None in their place.

        Raises:
            ParameterError: an option cannot be used.
        """
        if options is not None and not isinstance(options, cls):
            raise ParameterError('options', options, 'LogOptions')
        return replace(options or cls(), **{name: value for name, value in given.items()
                                            if value is not None})


def several(log: Any) -> list[Log]:
    """Return a list of logs; one log is a list of one."""
    if isinstance(log, (list, tuple)):
        if not log:
            raise ParameterError('log', log, 'at least one log')
        return list(log)
    return [log]


def name_of(log: Log) -> str:
    """Return how messages call a log."""
    return os.fspath(log) if isinstance(log, (str, os.PathLike)) else 'log'


def read_converted(log: Log, joints: Sequence[str], options: LogOptions, *,
                   velocity: bool) -> MeasuredLog:
    """Read a log as the options say; see `read_log`.

    Args:
        log: A log.
        joints: Joints of the arm.
        options: How to read it.
        velocity: Whether velocities are used.
    """
    return read_log(log, topic=options.topic, joints=joints, velocity=velocity,
                    columns=options.columns, degrees=options.degrees, gain=options.gain,
                    effort_delay=options.effort_delay)
