# SPDX-License-Identifier: Apache-2.0
"""The estimate file of an identifier: read at its start, written while it learns."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime, timezone
import os
from pathlib import Path

import numpy as np
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.timer import Timer

from adaptive_blf_control.configuration.node_settings import IdentifierNodeSettings
from adaptive_blf_control.identification.estimate_file import (
    estimate_path,
    recent_estimate,
    write_estimate,
)
from adaptive_blf_control.identification.knowledge import Snapshot
from adaptive_blf_control.runtime.data_node import DataNode

__all__ = ['EstimateSaver', 'file_of', 'resumed_estimate']

SHORTEST_PERIOD = 0.1  # s; each write waits for the disk


def file_of(node: DataNode[IdentifierNodeSettings]) -> Path:
    """Return the estimate file of a node: that of its settings, else one for its namespace."""
    return estimate_path(node.settings.estimate_file, node.get_namespace(), os.environ)


def resumed_estimate(node: DataNode[IdentifierNodeSettings],
                     parameters: tuple[str, ...]) -> np.ndarray | None:
    """Return the estimate of an identifier that ended within ``resume_within``, shape (m,)."""
    within = node.settings.resume_within
    if within <= 0.0:
        return None
    path = file_of(node)
    theta = recent_estimate(path, parameters, _now(), within)
    if theta is not None:
        node.get_logger().info(f'going on from the estimate in {path}')
    return theta


class EstimateSaver:
    """Writes the estimate every ``estimate_period``, at the end, and on request."""

    def __init__(self, node: DataNode[IdentifierNodeSettings],
                 snapshot: Callable[[], Snapshot]) -> None:
        """Start the timer; ``snapshot`` is called between two samples."""
        self._node = node
        self._snapshot = snapshot
        self._saved_samples = 0
        self._timer: Timer | None = None
        self.retune(node.settings.estimate_period)

    @property
    def period(self) -> float:
        """Interval between two writes [s]; 0 if the file is written on request only."""
        return 0.0 if self._timer is None else self._timer.timer_period_ns * 1e-9

    def retune(self, period: float) -> None:
        """Write every ``period`` [s] from now on; 0: on request only."""
        if self._timer is not None:
            self._node.destroy_timer(self._timer)
        self._timer = self._node.create_timer(
            max(period, SHORTEST_PERIOD), self.save_news,
            clock=Clock(clock_type=ClockType.STEADY_TIME)) if period > 0.0 else None

    def save_news(self) -> None:
        """Write the estimate if anything was learned since the last time; report a failure."""
        samples = self._node.statistics.samples
        if samples == self._saved_samples:
            return
        self._saved_samples = samples
        try:
            self.save()
        except (OSError, ValueError) as error:
            self._node.faults.report('estimate not written', f'estimate not written: {error}')

    def save(self) -> Path:
        """Write the present estimate and return the file; OSError names it and the reason."""
        path = file_of(self._node)
        with self._node.between_samples:
            snapshot = self._snapshot()
        try:
            write_estimate(path, snapshot, _now(),
                           make_folder=not self._node.settings.estimate_file)
        except OSError as error:
            raise OSError(f'{path}: {error.strerror or error}') from None
        return path


def _now() -> str:
    return datetime.now(timezone.utc).isoformat()
