# SPDX-License-Identifier: Apache-2.0
"""``bench steps``: what the nodes compute for a sample, from message in to messages out.

Without ROS: the bytes of a joint state are read, answered and encoded by the objects of the nodes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
import time
from typing import Any

import numpy as np

from adaptive_blf_control.configuration.build_closed_loop import build_closed_loop
from adaptive_blf_control.control.state_gate import StateGate
from adaptive_blf_control.identification.identifier import Identifier
from adaptive_blf_control.messages.cdr import Float64MultiArrayCodec
from adaptive_blf_control.messages.controller_codecs import ControllerCodecs, MonitorStream
from adaptive_blf_control.messages.identifier_codecs import EstimateStream, HistoryFigures
from adaptive_blf_control.messages.joint_state import JointStateCodec
from adaptive_blf_control.messages.usual_joint_state import UsualJointStateReader
from adaptive_blf_control.simulation.closed_loop import ClosedLoop

__all__ = ['CONTROLLER', 'IDENTIFIER', 'times_of']

CONTROLLER, IDENTIFIER = 'controller', 'identifier'
DECIMATION = 10  # the default of ``monitor_decimation``


class _ControllerStep:
    def __init__(self, loop: ClosedLoop) -> None:
        self._controller, arm = loop.controller, loop.arm
        self._reader = UsualJointStateReader(arm.joints)
        self._torque = Float64MultiArrayCodec(arm.n)
        self._codecs = ControllerCodecs(arm.joints, arm.parameters,
                                        loop.controller.constraints.names)
        self._monitors, self._gate = MonitorStream(self._codecs), StateGate(arm.joints)

    def answer(self, data: bytes, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return torque and adaptation term, (n,) and (m,), after encoding what is published."""
        controller = self._controller
        stamp, q, qd, torque = self._reader.read(data)
        self._gate.not_finite(q, qd)
        answered = controller.answer(stamp * 1e-9, q, qd, theta, torque)
        self._torque.encode(answered.torque)
        self._codecs.adaptation_term(stamp, answered)
        self._monitors.messages(stamp, answered, answered.margins, DECIMATION,
                                lambda: controller.lyapunov(answered.output, theta))
        return answered.torque, answered.adaptation_term


class _IdentifierStep:
    def __init__(self, identifier: Identifier) -> None:
        self._identifier, arm = identifier, identifier.arm
        self._reader = UsualJointStateReader(arm.joints)
        self._stream = EstimateStream(arm.parameters, arm.joints, DECIMATION)

    def answer(self, data: bytes, term: np.ndarray) -> np.ndarray:
        """Return θ̂, shape (m,), after encoding what is published."""
        identifier, stack = self._identifier, self._identifier.stack
        stamp, q, qd, tau = self._reader.read(data)
        theta = identifier.take(stamp * 1e-9, q, qd, tau, term)
        self._stream.messages(stamp, theta, stack.insertions, lambda: HistoryFigures(
            stack.rank, stack.sigma_min, identifier.excitation),
            lambda: identifier.external_torque)
        return theta


def times_of(data: Mapping[str, Any], duration: float) -> dict[str, np.ndarray]:
    """Return the processor times of each sample of a scenario [µs], shape (N,), by node.

    Args:
        data: The scenario, as `load_yaml` returns it.
        duration: Of the run [s].
    """
    loop = build_closed_loop(data)
    loop.warm_up_parts()
    times = np.array(list(_times(loop, round(duration / loop.period)))).T
    return dict(zip((CONTROLLER, IDENTIFIER), times, strict=True))


def _times(loop: ClosedLoop, samples: int) -> Iterator[tuple[float, float]]:
    plant, codec = loop.plant, JointStateCodec(loop.arm.joints)
    controller, identifier = _ControllerStep(loop), _IdentifierStep(loop.identifier)
    theta, term = loop.initial_estimate, np.zeros(loop.arm.m)
    for k in range(samples):
        measured = plant.measure(plant.torque, loop.period if k else 0.0)
        message = codec.encode(round(k * loop.period * 1e9), *measured)
        begin = time.thread_time_ns()
        torque, following = controller.answer(message, theta)
        between = time.thread_time_ns()
        estimate = identifier.answer(message, term)
        yield 1e-3 * (between - begin), 1e-3 * (time.thread_time_ns() - between)
        theta, term = theta if loop.known is not None else estimate.copy(), following.copy()
        plant.apply(torque)
        plant.advance(loop.period)
