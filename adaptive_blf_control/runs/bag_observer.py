# SPDX-License-Identifier: Apache-2.0
"""Writes an offline run as a bag in the recorder's form, with the topics of the nodes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

import yaml

from adaptive_blf_control.bags.writer import BagWriter
from adaptive_blf_control.configuration.node_settings import (
    ControllerNodeSettings,
    IdentifierNodeSettings,
    TABLES,
)
from adaptive_blf_control.configuration.parameter_file import (
    node_settings,
    node_values,
    PARAMETERS_KEY,
)
from adaptive_blf_control.messages.cdr import Float64MultiArrayCodec
from adaptive_blf_control.messages.controller_codecs import ControllerCodecs, MonitorStream
from adaptive_blf_control.messages.identifier_codecs import EstimateStream, HistoryFigures
from adaptive_blf_control.messages.joint_state import JointStateCodec
from adaptive_blf_control.messages.topics import (
    ADAPTATION_TERM,
    COMMANDS,
    JOINT_STATES,
    RECORDED,
)
from adaptive_blf_control.simulation.closed_loop import ClosedLoop
from adaptive_blf_control.simulation.sample import Sample

__all__ = ['BagObserver']


class BagObserver:
    """Context manager and observer of :meth:`ClosedLoop.run`; stamps start at ``epoch``."""

    def __init__(self, path: Path, loop: ClosedLoop, data: Mapping[str, Any],
                 epoch_ns: int = 1_000_000_000) -> None:
        """Open the bag; BagError where the folder exists.

        Args:
            path: Folder of the bag.
            loop: The loop that will run.
            data: The scenario's parameter file, stored in the bag.
            epoch_ns: Stamp of the first sample; fixed, so that equal runs give equal bags.
        """
        self._loop = loop
        self._epoch_ns = epoch_ns
        arm = loop.arm
        parameters = {f'/{node}': {'ros__parameters': node_values(data, node)}
                      for node in TABLES if node != 'recorder'}
        self._bag = BagWriter(path, custom_data={
            PARAMETERS_KEY: yaml.safe_dump(parameters, sort_keys=False)})
        for topic, type_name in RECORDED.items():
            if not topic.startswith('/'):  # those belong to nodes
                self._bag.add_topic(f'/{topic}', type_name)
        self._state = JointStateCodec(arm.joints, 'base_link')
        self._torque = Float64MultiArrayCodec(arm.n)
        self._controller = ControllerCodecs(arm.joints, arm.parameters,
                                            loop.controller.constraints.names)
        self._decimation = node_settings(data, ControllerNodeSettings).monitor_decimation
        self._monitors = MonitorStream(self._controller)
        self._estimates = EstimateStream(
            arm.parameters, arm.joints,
            node_settings(data, IdentifierNodeSettings).external_torque_decimation)

    def __enter__(self) -> BagObserver:
        """Return the observer."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        """Close the bag."""
        self._bag.close()

    def __call__(self, sample: Sample) -> None:
        """Write one sample in the order in which the nodes would have published it."""
        stamp = self._epoch_ns + int(round(sample.t * 1e9))
        controller, output = self._loop.controller, sample.output
        messages = {
            JOINT_STATES: self._state.encode(stamp, *sample.measured),
            COMMANDS: self._torque.encode(output.torque),
            ADAPTATION_TERM: self._controller.adaptation_term(stamp, output),
            **self._monitors.messages(stamp, output, controller.margins(output), self._decimation,
                                      lambda: controller.lyapunov(output, sample.theta_used)),
            **self._estimates.messages(
                stamp, sample.theta_hat, sample.insertions,
                lambda: HistoryFigures(sample.rank, sample.sigma_min, sample.excitation),
                lambda: sample.external_torque),
        }
        for topic, message in messages.items():
            self._bag.write(f'/{topic}', message, stamp)
