# SPDX-License-Identifier: Apache-2.0
"""A stranger's plant, law and update law, named in parameters, through the real nodes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from sensor_msgs.msg import JointState

from adaptive_blf_control.messages.joint_state import decode_joint_state
from adaptive_blf_control.messages.topics import (
    ADAPTATION_TERM,
    JOINT_STATES,
    THETA_HAT,
    TRACKING_ERROR,
)
from adaptive_blf_control.nodes.arm_driver import ArmDriver
from adaptive_blf_control.nodes.controller import ControllerNode
from adaptive_blf_control.nodes.identifier import IdentifierNode

ROOMS = Path(__file__).resolve().parents[1]
SWING = {f'reference__{joint}__{name}': [value] for joint in ('joint1', 'joint2')
         for name, value in (('amplitude', 0.2), ('frequency', 1.0), ('phase', 0.0))}


def test_the_nodes_drive_a_foreign_plant_under_foreign_laws(graph, wait_until, monkeypatch):
    monkeypatch.syspath_prepend(str(ROOMS / 'simulation'))
    for room in ('control', 'identification'):
        monkeypatch.syspath_prepend(str(ROOMS / room))
    driver = graph.make(ArmDriver, rate=200.0, plant='foreign_plant:Pendulums')
    controller = graph.make(ControllerNode, law='foreign_law:Spring', performance__lower=[-0.6],
                            performance__upper=[0.6], state_timeout=60.0, **SWING)
    identifier = graph.make(IdentifierNode, update_law='foreign_update_law:LeastSquares')
    peer = graph.peer()
    errors, terms = (peer.listen(JointState, f'/{topic}')
                     for topic in (TRACKING_ERROR, ADAPTATION_TERM))
    states, estimates = (peer.listen(JointState, f'/{topic}')
                         for topic in (JOINT_STATES, THETA_HAT))
    for node in (driver, controller, identifier):
        graph.run(node)

    def moved() -> bool:
        return bool(states) and np.abs(decode_joint_state(states[-1][0]).position).max() > 0.1

    wait_until(moved, what='a motion of the foreign plant')
    wait_until(lambda: estimates and np.any(decode_joint_state(estimates[-1][0]).position),
               what='an estimate of the foreign law')
    assert type(driver.plant).__name__ == 'Pendulums'
    assert np.isfinite([decode_joint_state(data).position for data, _ in errors]).all()
    assert not np.any([decode_joint_state(data).position for data, _ in terms])
