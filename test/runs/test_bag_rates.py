# SPDX-License-Identifier: Apache-2.0
"""Facts about the rates of the nodes, as a bag shows them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import adaptive_blf_control as blf
from adaptive_blf_control.bags.reader import read_bag
from adaptive_blf_control.bags.writer import BagWriter
from adaptive_blf_control.messages.cdr import Float64MultiArrayCodec
from adaptive_blf_control.messages.topics import COMMANDS
from adaptive_blf_control.runs.bag_run import rates, run_of_bag

RAMP = 200  # commands


@pytest.mark.parametrize('label', ['', '/controller#01234567'])
def test_commands_of_a_ramp_are_no_part_of_the_rate_of_the_controller(
        tmp_path: Path, label: str) -> None:
    """The commands before it answer states; some say which, those of a simulation do not."""
    blf.simulate('two_link', 0.5, bag=tmp_path / 'run')
    bag = read_bag(tmp_path / 'run')
    codec, torque = Float64MultiArrayCodec(2, '/controller#01234567'), np.ones(2)
    with BagWriter(tmp_path / 'ramped', custom_data=bag.custom_data) as writer:
        for name, info in bag.topics.items():
            writer.add_topic(name, info.type_name)
        for message in bag:
            said = message.topic.lstrip('/') == COMMANDS and label
            writer.write(message.topic, codec.encode(torque, message.log_time_ns) if said
                         else message.data, message.log_time_ns)
            last = message.log_time_ns
        commands = next(name for name in bag.topics if name.lstrip('/') == COMMANDS)
        for k in range(RAMP):
            writer.write(commands, codec.encode(torque), last + k * 1_000_000)
    ramped = read_bag(writer.path)
    held = rates(ramped, run_of_bag(ramped))
    assert held == pytest.approx(rates(bag, run_of_bag(bag)))
    assert held['controller'] == pytest.approx(1000.0, rel=0.01)
