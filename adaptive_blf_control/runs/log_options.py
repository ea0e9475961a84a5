# SPDX-License-Identifier: Apache-2.0
"""Measured logs as one call of `identify` reads them: converted, checked, and cut into spans."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
import os
from typing import Any

import numpy as np

from adaptive_blf_control.arrays import checked_number
from adaptive_blf_control.bags.logs import Log, MeasuredLog, read_log
from adaptive_blf_control.errors import LogError, ParameterError

__all__ = ['LogOptions', 'name_of', 'read_converted', 'several']


@dataclass(frozen=True)
class LogOptions:
    """How logs are read.

    Attributes:
        topic: Topic of joint values in a bag.
        columns: Columns of a CSV file by kind, see `read_log`.
        degrees: Whether positions and velocities are in degrees.
        gain: What the effort of a joint is multiplied by, by joint [N·m per unit].
        effort_delay: How far the effort is behind the motion [s].
        force: Whether logs are learned from that cannot be right.
    """

    topic: str | None = None
    columns: Mapping[str, str] | None = None
    degrees: bool = False
    gain: Mapping[str, float] = field(default_factory=dict)
    effort_delay: float = 0.0
    force: bool = False

    def __post_init__(self) -> None:
        """Refuse what cannot be applied."""
        if not isinstance(self.gain, Mapping):
            raise ParameterError('gain', self.gain, 'a mapping of joints to numbers')
        for joint, value in self.gain.items():
            if not np.isfinite(checked_number('gain', value)) or value == 0.0:
                raise ParameterError(f'gain of {joint}', value, 'a finite number that is not 0')
        if not np.isfinite(checked_number('effort_delay', self.effort_delay)):
            raise ParameterError('effort_delay', self.effort_delay, 'a finite time [s]')


def several(log: Any) -> list[Log]:
    """Return a list of logs; one log is a list of one. A log itself may be a tuple."""
    if isinstance(log, (list, tuple)) and not isinstance(log, MeasuredLog):
        if not log:
            raise ParameterError('log', log, 'at least one log')
        return list(log)
    return [log]


def name_of(log: Log) -> str:
    """Return how messages call a log."""
    return os.fspath(log) if isinstance(log, (str, os.PathLike)) else 'log'


def read_converted(log: Log, joints: Sequence[str], options: LogOptions, *,
                   velocity: bool) -> MeasuredLog:
    """Read a log and convert it as the options say.

    Args:
        log: A log, see `read_log`.
        joints: Joints of the arm.
        options: How to read it.
        velocity: Whether velocities are used.

    Raises:
        LogError: the log cannot be read.
        ParameterError: a gain is of no joint of the arm.
    """
    measured = read_log(log, topic=options.topic, joints=joints, velocity=velocity,
                        columns=options.columns)
    if unknown := [joint for joint in options.gain if joint not in joints]:
        raise ParameterError('gain', unknown[0], f'one of the joints {", ".join(joints)}')
    q, qd, tau = measured.q, measured.qd, measured.tau
    if options.degrees:
        q, qd = np.deg2rad(q), np.deg2rad(qd)
    if options.gain:
        tau = tau * np.array([options.gain.get(joint, 1.0) for joint in joints])
    measured = measured._replace(q=q, qd=qd, tau=tau)
    return _shifted(measured, options.effort_delay, name_of(log)) if options.effort_delay else (
        measured)


def _shifted(log: MeasuredLog, delay: float, source: str) -> MeasuredLog:
    """Return a log whose effort at t is the one that was recorded at t + delay."""
    later = log.t + delay
    there = (later >= log.t[0]) & (later <= log.t[-1])
    if there.sum() < 3:
        raise LogError(f'{source}: --effort-delay {delay:g} s leaves nothing of '
                       f'{log.t[-1] - log.t[0]:.3g} s')
    tau = np.column_stack([np.interp(later[there], log.t, column) for column in log.tau.T])
    first = int(there.argmax())
    t = log.t[there]
    return log._replace(t=t - t[0], q=log.q[there], qd=log.qd[there], tau=tau,
                        dropped=log.dropped + int((~there).sum()),
                        breaks=tuple(row - first for row in log.breaks
                                     if 0 < row - first < len(t)))
