# SPDX-License-Identifier: Apache-2.0
"""What `node_steps` measures, for commit d8177d4, whose objects have other names and places.

Run by :mod:`adaptive_blf_control.bench.step_pairs` in a checkout of that commit, with a scenario's
file and a duration [s]; prints the medians of the processor times [µs] by node as JSON.
"""

from __future__ import annotations

from importlib import import_module
import json
from pathlib import Path
import sys
import time
from typing import Any

import numpy as np


def _of(module: str, *names: str) -> list[Any]:
    found = import_module(f'adaptive_blf_control.{module}')
    return [getattr(found, name) for name in names]


class _Steps:
    """Controller and identifier of a loop, as the nodes of that commit called them."""

    def __init__(self, loop: Any) -> None:
        codec, reader = _of('bags.joint_state', 'JointStateCodec', 'JointStateReader')
        array, self._float, self._int = _of('bags.cdr', 'Float64MultiArrayCodec',
                                            'encode_float64', 'encode_int32')
        codecs, stream = _of('bags.controller_codecs', 'ControllerCodecs', 'MonitorStream')
        news, = _of('identification.news', 'HistoryNews')
        arm, self._loop = loop.arm, loop
        self._readers = [reader(arm.joints) for _ in range(2)]
        self._torque, self._codecs = array(arm.n), codecs(arm.joints, arm.parameters)
        self._monitors, self._news = stream(self._codecs), news()
        self._theta = codec(arm.parameters, fields=('position',))
        self.states = codec(arm.joints)

    def control(self, data: bytes, theta: np.ndarray) -> Any:
        controller = self._loop.controller
        stamp, q, qd, _ = self._readers[0].read(data)
        assert np.isfinite(q).all()
        assert np.isfinite(qd).all()
        output = controller.update(stamp * 1e-9, q, qd, theta)
        self._torque.encode(output.torque)
        self._codecs.adaptation_term(stamp, output)
        margins = controller.margins(q, output)
        margins.min()
        self._monitors.messages(stamp, output, margins, 10,
                                lambda: controller.lyapunov(q, output, theta))
        return output

    def learn(self, data: bytes, term: np.ndarray) -> np.ndarray:
        identifier = self._loop.identifier
        stamp, q, qd, tau = self._readers[1].read(data)
        theta: np.ndarray = identifier.update(stamp * 1e-9, q, qd, tau, term)
        if self._news.due(identifier.stack.insertions):
            self._int(identifier.stack.rank)
            self._float(identifier.stack.sigma_min)
        self._theta.encode(stamp, theta)
        return theta


def main(scenario: str, duration: float) -> None:
    """Run a scenario and print the medians."""
    load, = _of('parameters.yaml_file', 'load_yaml')
    build, = _of('simulation.closed_loop', 'build_closed_loop')
    loop = build(load(Path(scenario)))
    loop.warm_up()
    steps, plant = _Steps(loop), loop.plant
    theta, term, times = loop.initial_estimate, np.zeros(loop.arm.m), []
    for k in range(round(duration / loop.period)):
        measured = plant.measure(plant.torque, loop.period if k else 0.0)
        message = steps.states.encode(round(k * loop.period * 1e9), *measured)
        begin = time.thread_time_ns()
        output = steps.control(message, theta)
        between = time.thread_time_ns()
        estimate = steps.learn(message, term)
        times.append((between - begin, time.thread_time_ns() - between))
        theta, term = theta if loop.known is not None else estimate, output.adaptation_term
        plant.apply(output.torque)
        plant.advance(loop.period)
    middle = np.median(np.array(times) * 1e-3, axis=0)
    print(json.dumps(dict(zip(('controller', 'identifier'), middle.tolist()))))


if __name__ == '__main__':
    main(sys.argv[1], float(sys.argv[2]))
