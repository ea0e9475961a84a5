# SPDX-License-Identifier: Apache-2.0
"""The filtered pairs of measured logs, without learning from them."""

from __future__ import annotations

from collections.abc import Iterator
import itertools

import numpy as np

from adaptive_blf_control.bags.logs import Log
from adaptive_blf_control.bags.measured_log import MeasuredLog
from adaptive_blf_control.bags.row_store import row_blocks
from adaptive_blf_control.configuration.build_arm import build_arm
from adaptive_blf_control.configuration.build_identifier import build_identifier
from adaptive_blf_control.configuration.node_settings import IdentifierNodeSettings
from adaptive_blf_control.errors import LogError
from adaptive_blf_control.identification.identifier import BLOCK
from adaptive_blf_control.runs.log_options import LogOptions, name_of
from adaptive_blf_control.runs.log_pass import NO_TEST
from adaptive_blf_control.runs.log_reader import LogReader
from adaptive_blf_control.runs.subject import with_masses

__all__ = ['LogPairs']


class LogPairs:
    """Reads logs for one arm, checked as `identify` does, and filters them.

    Attributes:
        settings: Those that were given.
        arm: The arm.
        identifier: The identifier whose filters are used; it learns nothing.
        reader: With what was found and noted of the logs.
    """

    def __init__(self, settings: IdentifierNodeSettings, options: LogOptions) -> None:
        """Build the arm.

        Args:
            settings: Those of an identifier, its arm included.
            options: How logs are read.

        Raises:
            ArmError: no arm can be made of the URDF and the joints.
            ParameterError: a setting cannot be used.
        """
        settings, filled = with_masses(settings, False)
        self.settings = settings
        self.arm = build_arm(settings)
        self.identifier = build_identifier(settings, self.arm)
        self.reader = LogReader(self.arm, settings, options, filled, self.identifier.memory)

    def read(self, log: Log) -> MeasuredLog:
        """Read and check a log; LogError where it cannot be read or cannot be right."""
        return self.reader.sections([log], [], ':', NO_TEST)[0].log

    def of(self, source: Log) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Yield times, shape (B,) [s], and [Y_f τ_f], shape (B, n, m + 1), of settled filters.

        Raises:
            LogError: the log cannot be read, cannot be right, or leaves no pair.
        """
        count = 0
        for times, rows in self.of_read(self.read(source)):
            count += len(times)
            yield times, rows
        if not count:
            raise LogError(f'{name_of(source)}: no sample can be used: the filters never settle')

    def of_read(self, log: MeasuredLog) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Yield the same of a log that `read` has returned; nothing where no filter settles."""
        ends = [0, *log.breaks, len(log.t)]
        for begin, end in itertools.pairwise(ends):
            self.identifier.restart()
            stretch = log.t[begin:end], log.q[begin:end], log.qd[begin:end], log.tau[begin:end]
            for some in row_blocks(*stretch[1:]):
                t, q, qd, tau = (part[some] for part in stretch)
                for block in self.identifier.learn_in_blocks(t, q, qd, tau, False, BLOCK):
                    usable = block.usable
                    yield t[block.samples][usable], block.rows[usable]
