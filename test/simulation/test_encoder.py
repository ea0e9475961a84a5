# SPDX-License-Identifier: Apache-2.0
"""Facts about the scenario with encoders and torque noise."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.configuration.build_closed_loop import build_closed_loop
from adaptive_blf_control.configuration.parameter_file import apply_settings, load_yaml
from adaptive_blf_control.runs.summary import run_of_trace, summarise
from adaptive_blf_control.runs.torque_error import errors_of_trace


def run(repository, *settings: str, duration: float = 20.0):
    data = load_yaml(repository / 'config' / 'three_link_encoder.yaml')
    loop = build_closed_loop(apply_settings(data, list(settings)))
    return loop, loop.run(duration)


def test_encoders_give_the_torque_within_one_percent_in_twenty_seconds_and_then_rest(repository):
    loop, trace = run(repository, 'arm_driver.payload=1.0')
    assert summarise(run_of_trace(loop, trace))['set_violations'] == 0
    errors = errors_of_trace(loop, trace, np.arange(16.0, 21.0))
    assert errors.max() < 0.005
    assert loop.identifier.changes == 0
    assert loop.identifier.stack.rank == 11


def test_without_the_state_filter_the_encoder_spoils_the_estimate(repository):
    loop, trace = run(repository, 'identifier.filter.state_order=0', duration=10.0)
    assert errors_of_trace(loop, trace, np.array([10.0])).max() > 0.05


def test_a_payload_taken_up_is_found_and_pairs_of_the_old_arm_do_not_stay(repository):
    loop, trace = run(repository, 'arm_driver.schedule.time=[12.0]',
                      'arm_driver.schedule.parameter=[payload]', 'arm_driver.schedule.value=[1.0]',
                      duration=26.0)
    assert loop.identifier.changes == 1
    assert errors_of_trace(loop, trace, np.array([26.0])).max() < 0.01
    new = loop.plant.truth(loop.arm.parameters)[1][1]
    stack = loop.identifier.stack
    residual = stack.regressors @ new - stack.torques
    assert np.abs(residual).max() < 0.02  # 1 kg is 0.1 N·m and more
