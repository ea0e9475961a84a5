# SPDX-License-Identifier: Apache-2.0
"""The nodes beside a driver that shares nothing with them but rclpy and the messages."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.nodes.controller import ControllerNode
from adaptive_blf_control.nodes.identifier import IdentifierNode
from foreign_driver import ForeignDriver, FRICTION, P1, P2, P3
from patience import PATIENCE

PERIOD, STEPS = 0.004, 1500
TRUE = np.array([P1, P2, P3, *FRICTION])
ARM = {'joints': ['shoulder', 'elbow'], 'initial_estimate': [0.0, 9.0, 6.0, 0.0, 0.0]}
SETS = {'safety__lower': [-1.17, -2.17], 'safety__upper': [1.2, 2.2],
        'performance__lower': [-0.17, -0.17], 'performance__upper': [0.2, 0.2]}
MOTION = {'reference__smooth_start': 0.0,
          'reference__shoulder__amplitude': [1.0], 'reference__shoulder__frequency': [0.5],
          'reference__elbow__amplitude': [2.0], 'reference__elbow__frequency': [0.5],
          'reference__elbow__phase': [0.5 * np.pi]}


@pytest.fixture
def run(graph, wait_until):
    """Return ``run(effort)``: drive the arm for six seconds of its own time."""
    def make(effort: str):
        controller = graph.make(ControllerNode, **ARM, **SETS, **MOTION, k1=[100.0, 100.0],
                                k2=[60.0, 8.0], torque_limit=[200.0, 100.0])
        identifier = graph.make(IdentifierNode, **ARM, kt=100.0, kh=100.0, history__size=10,
                                filter__time_constant=0.02, filter__effort=effort)
        driver = graph.spin(ForeignDriver(graph.context, PERIOD))
        for node in (controller, identifier):
            graph.run(node)
        wait_until(lambda: driver.count_subscribers('joint_states') >= 2, what='listeners')
        wait_until(lambda: driver.step(0.02), what='the first command')
        for _ in range(STEPS):
            assert driver.step(PATIENCE), 'no command'
            stamp = round(driver.sent * PERIOD * 1e9)
            wait_until(lambda stamp=stamp: identifier.last_ns >= stamp, what='the identifier')
        return controller, identifier

    return make


def test_a_foreign_driver_is_driven_inside_the_sets_and_learned(run) -> None:
    controller, identifier = run('instant')
    assert (controller.output is not None, controller.monitors.violations) == (True, 0)
    assert identifier.identifier.rank == 5
    np.testing.assert_allclose(identifier.identifier.theta, TRUE, rtol=0.01)


def test_a_torque_of_the_sample_taken_for_a_mean_is_learned_wrongly(run) -> None:
    _, identifier = run('mean')
    assert np.abs(identifier.identifier.theta / TRUE - 1.0).max() > 0.02
