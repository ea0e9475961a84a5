# SPDX-License-Identifier: Apache-2.0
"""The physically consistent model of an identifier: published beside the loop, written on request.

It is computed by the executor's thread, from a copy of the recorded pairs that is made between two
samples, so that no sample waits for it.
"""

from __future__ import annotations

from datetime import datetime, timezone
import os
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.publisher import Publisher
from rclpy.timer import Timer

from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.arms.urdf_export import export_urdf
from adaptive_blf_control.configuration.node_settings import IdentifierNodeSettings
from adaptive_blf_control.errors import ArmError
from adaptive_blf_control.identification.consistent_model import (
    consistent_model,
    ConsistentModel,
    has_links,
)
from adaptive_blf_control.identification.estimate_file import (
    estimate_path,
    write_estimate,
    write_text,
)
from adaptive_blf_control.identification.identifier import Identifier
from adaptive_blf_control.identification.knowledge import Snapshot
from adaptive_blf_control.identification.pair_times import PairTimes, RecordedHistory
from adaptive_blf_control.identification.uncertainty import uncertainty
from adaptive_blf_control.messages.joint_state import JointStateCodec
from adaptive_blf_control.messages.topics import CONSISTENT_MODEL, THETA_STD
from adaptive_blf_control.runtime.data_node import DataNode

__all__ = ['ModelOutput']

FILE = 'model.yaml'
SHORTEST_PERIOD = 0.5  # s; computing takes a part of it


class _Learned(NamedTuple):
    """What follows from the pairs of one revision; no model for an arm without links."""

    revision: int
    snapshot: Snapshot
    std: np.ndarray
    model: ConsistentModel | None


class ModelOutput:
    """Publishes the model and the standard deviations of θ̂ every ``model_period``."""

    def __init__(self, node: DataNode[IdentifierNodeSettings], identifier: Identifier,
                 publishers: dict[str, Publisher]) -> None:
        """Start the timer; ``publishers`` are those of the node, by topic."""
        self._node = node
        self._identifier = identifier
        self._publishers = publishers
        self._codec = JointStateCodec(identifier.arm.parameters, fields=('position',))
        self._seen = PairTimes()
        self._stamp = 0
        self._learned: _Learned | None = None
        self._timer: Timer | None = None
        self.retune(node.settings.model_period)

    @property
    def period(self) -> float:
        """Interval between two publications [s]; 0 if there are none."""
        return 0.0 if self._timer is None else self._timer.timer_period_ns * 1e-9

    def observe(self, stamp: int, t: float) -> None:
        """Look at the identifier after a sample of stamp ``stamp`` [ns] and time ``t`` [s]."""
        self._stamp = stamp
        self._seen.observe(t, self._identifier)

    def retune(self, period: float) -> None:
        """Publish every ``period`` [s] from now on; 0: not at all.

        In lockstep nothing is published: when it is computed depends on the machine.
        """
        if self._timer is not None:
            self._node.destroy_timer(self._timer)
        self._timer = self._node.create_timer(
            max(period, SHORTEST_PERIOD), self.publish,
            clock=Clock(clock_type=ClockType.STEADY_TIME)) if (
                period > 0.0 and not self._node.lockstep) else None

    def publish(self) -> None:
        """Publish what the pairs recorded so far say; nothing before the first."""
        try:
            learned = self._learn()
        except np.linalg.LinAlgError as error:
            self._node.faults.report('model not found', f'model not found: {error}')
            return
        if learned is None:
            return
        vectors = {THETA_STD: learned.std}
        if learned.model is not None:
            vectors[CONSISTENT_MODEL] = learned.model.theta
        with self._node.between_samples:
            for topic, vector in vectors.items():
                self._publishers[topic].publish(self._codec.encode(self._stamp, vector))

    def save(self) -> tuple[Path, Path]:
        """Write the model and the URDF with its values; return both files.

        Raises:
            OSError: a file cannot be written; names it and the reason.
            ArmError: there is no model of this arm, or no pair yet.
        """
        arm, learned = self._identifier.arm, self._learn()
        if not isinstance(arm, UrdfArm):
            raise ArmError(f'{type(arm).__name__} has no inertial parameters per link: there is '
                           'no consistent model of it')
        if learned is None or learned.model is None:
            raise ArmError('no pair was recorded yet')
        settings, model = self._node.settings, learned.model
        path = estimate_path(settings.model_file, self._node.get_namespace(), os.environ,
                             'identifier.model_file', FILE)
        urdf, new = path.with_suffix('.urdf'), not settings.model_file
        try:
            write_estimate(path, learned.snapshot._replace(theta=model.theta),
                           datetime.now(timezone.utc).isoformat(), std=model.std,
                           make_folder=new)
            write_text(urdf, export_urdf(arm, model.theta, model.inertial).xml)
        except OSError as error:
            raise OSError(f'{path}: {error.strerror or error}') from None
        return path, urdf

    def _learn(self) -> _Learned | None:
        """Return what the present pairs say; computed again only where they have changed."""
        with self._node.between_samples:
            revision = self._identifier.stack.revision
            if self._learned is not None and self._learned.revision == revision:
                return self._learned
            recorded = self._seen.recorded(self._identifier)
            snapshot = self._identifier.snapshot()
        self._learned = _learned(self._identifier, revision, snapshot, recorded)
        return self._learned


def _learned(identifier: Identifier, revision: int, snapshot: Snapshot,
             recorded: RecordedHistory) -> _Learned | None:
    if not len(recorded.times):
        return None
    judged, arm = uncertainty(*recorded), identifier.arm
    model = (consistent_model(arm, recorded.regressors, recorded.torques, judged.alike)
             if has_links(arm) else None)
    return _Learned(revision, snapshot, judged.std, model)
