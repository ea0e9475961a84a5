# SPDX-License-Identifier: Apache-2.0
"""`bench log_memory`: the logs that it grows, and what it measures."""

import numpy as np
import pytest

from adaptive_blf_control.bags.logs import read_log
from adaptive_blf_control.bags.reader import read_bag
from adaptive_blf_control.bags.writer import BagWriter
from adaptive_blf_control.bench import log_memory
from adaptive_blf_control.errors import BlfError
from adaptive_blf_control.messages.joint_state import JointStateCodec

PERIOD = 4_000_000  # ns
ROWS = 400


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    folder = tmp_path_factory.mktemp('log') / 'once'
    codec = JointStateCodec(('a', 'b'))
    with BagWriter(folder) as writer:
        writer.add_topic('/joint_states', 'sensor_msgs/msg/JointState')
        for k in range(ROWS):
            stamp = 10**9 + k * PERIOD
            values = np.array([np.sin(0.01 * k), np.cos(0.01 * k)])
            writer.write('/joint_states', codec.encode(stamp, values, 2.0 * values, 3.0 * values),
                         stamp)
    return read_bag(folder)


def check(grown, bag, rows):
    once = read_log(bag)
    again = rows // ROWS
    assert again >= 3
    assert len(grown.t) == rows == again * ROWS
    assert (grown.dropped, grown.breaks) == (0, ())
    np.testing.assert_allclose(grown.tau, np.tile(once.tau, (again, 1)), atol=1e-8)
    pauses = np.diff(grown.t)[ROWS - 1::ROWS]
    np.testing.assert_allclose(pauses, log_memory._PAUSE, atol=1e-6)


def test_a_csv_file_has_the_run_again_and_again_with_growing_stamps(bag, tmp_path):
    path = tmp_path / 'log.csv'
    rows = log_memory.grown_csv(bag, path, 80_000)
    assert path.stat().st_size >= 80_000
    check(read_log(path), bag, rows)


def test_a_bag_has_the_run_again_and_again_with_growing_stamps(bag, tmp_path):
    # What is written reaches the file chunk by chunk.
    rows = log_memory.grown_bag(bag, tmp_path / 'grown', 1_000_000)
    check(read_log(tmp_path / 'grown'), bag, rows)


def test_a_command_has_a_peak_and_a_failing_one_says_why(tmp_path):
    peak = log_memory.measured(['topics'])
    assert 5.0 < peak.own < peak.resident < 2000.0
    with pytest.raises(BlfError, match='nowhere'):
        log_memory.measured(['recover', str(tmp_path / 'nowhere')])


@pytest.mark.parametrize(('grow', 'name'), [
    (log_memory.grown_csv, 'log.csv'), (log_memory.grown_bag, 'grown')])
def test_the_clock_of_a_grown_log_may_begin_again_with_each_repetition(bag, tmp_path, grow, name):
    rows = grow(bag, tmp_path / name, 1_000, set_back=True)
    log = read_log(tmp_path / name)
    assert (len(log.t), log.breaks) == (rows, tuple(range(ROWS, rows, ROWS)))
