# SPDX-License-Identifier: Apache-2.0
"""Writes an offline run as a bag in the recorder's form, with the topics of the nodes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

import yaml

from adaptive_blf_control.arms.robot_description import robot_description
from adaptive_blf_control.bags.metadata import default_qos
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
from adaptive_blf_control.configuration.payload import build_payload
from adaptive_blf_control.messages.cdr import encode_text, Float64MultiArrayCodec
from adaptive_blf_control.messages.controller_codecs import ControllerCodecs, MonitorStream
from adaptive_blf_control.messages.identifier_codecs import (
    EstimateStream,
    HistoryFigures,
    PayloadStream,
)
from adaptive_blf_control.messages.joint_state import JointStateCodec
from adaptive_blf_control.messages.topics import (
    ADAPTATION_TERM,
    COMMANDS,
    JOINT_STATES,
    RECORDED,
    ROBOT_DESCRIPTION,
    TOPICS,
)
from adaptive_blf_control.simulation.closed_loop import ClosedLoop
from adaptive_blf_control.simulation.sample import Sample

__all__ = ['BagObserver']


class BagObserver:
    """Context manager and observer of :meth:`ClosedLoop.run`; stamps start at ``epoch``."""

    def __init__(self, path: Path, loop: ClosedLoop, data: Mapping[str, Any],
                 epoch_ns: int = 1_000_000_000, *, built: bool = True) -> None:
        """Open the bag; BagError where the folder exists.

        Args:
            path: Folder of the bag.
            loop: The loop that will run.
            data: The scenario's parameter file, stored in the bag.
            epoch_ns: Stamp of the first sample; fixed, so that equal runs give equal bags.
            built: Whether the plant was built from ``data``. Where it was given as an object, the
                bag has no parameters of a driver, as that of a real robot: they would tell a θ*
                that it does not have.
        """
        self._loop = loop
        self._epoch_ns = epoch_ns
        arm = loop.arm
        parameters = {f'/{node}': {'ros__parameters': node_values(data, node)}
                      for node in TABLES if node != 'recorder' and (built or node != 'arm_driver')}
        self._bag = BagWriter(path, custom_data={
            PARAMETERS_KEY: yaml.safe_dump(parameters, sort_keys=False)})
        for topic, type_name in RECORDED.items():
            if not topic.startswith('/'):  # those belong to nodes
                durability = 'transient_local' if TOPICS[topic].latched else 'volatile'
                self._bag.add_topic(f'/{topic}', type_name,
                                    qos=default_qos(durability=durability))
        text = robot_description(arm)
        if text is not None:
            self._bag.write(f'/{ROBOT_DESCRIPTION}', encode_text(text), epoch_ns)
        self._state = JointStateCodec(arm.joints, 'base_link')
        self._torque = Float64MultiArrayCodec(arm.n)
        self._controller = ControllerCodecs(arm.joints, arm.parameters,
                                            loop.controller.constraints.names, watched=getattr(
                                                loop.controller.safety_filter, 'watched', ()))
        self._decimation = node_settings(data, ControllerNodeSettings).monitor_decimation
        self._monitors = MonitorStream(self._controller)
        identifier = node_settings(data, IdentifierNodeSettings)
        self._estimates = EstimateStream(arm.parameters, arm.joints,
                                         identifier.external_torque_decimation)
        self._payload = build_payload(identifier, loop.identifier.arm, loop.identifier.memory)
        # The load is found from the pair of each sample: the loop may not run ahead of them.
        loop.sample_by_sample = loop.sample_by_sample or self._payload is not None
        self._payloads = PayloadStream(identifier.payload.frame)

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
                                      lambda: controller.lyapunov(output, sample.theta_used),
                                      getattr(controller.safety_filter, 'watch', None)),
            **self._payload_messages(stamp),
            **self._estimates.messages(
                stamp, sample.theta_hat, sample.insertions,
                lambda: HistoryFigures(sample.rank, sample.sigma_min, sample.excitation),
                lambda: sample.external_torque),
        }
        for topic, message in messages.items():
            self._bag.write(f'/{topic}', message, stamp)

    def _payload_messages(self, stamp: int) -> dict[str, bytes]:
        """Return what the identifier node would say of the load after a sample."""
        found, t = self._payload, (stamp - self._epoch_ns) * 1e-9
        if found is None or not found.follow(t, self._loop.identifier) or found.estimate is None:
            return {}
        return self._payloads.messages(stamp, found.estimate)
