# SPDX-License-Identifier: Apache-2.0
"""The soak run counts right: on numbers whose answer is known, and on four real processes."""

from __future__ import annotations

import json
from pathlib import Path
import re

import numpy as np
import pytest

from adaptive_blf_control.bags.writer import BagWriter
from adaptive_blf_control.bench import soak
from adaptive_blf_control.bench.soak_bag import read_run
from adaptive_blf_control.bench.soak_figures import account_of, growth_of, latency_of
from adaptive_blf_control.errors import BagError
from adaptive_blf_control.messages.cdr import Float64MultiArrayCodec, JointStateCodec

LOG = """[INFO] [1.0] [recorder]: /joint_states: received 12, written 12, lost 3
[INFO] [1.0] [recorder]: /other: received 7, written 5, dropped 2, lost 0
"""


def test_growth_leaves_out_the_start_and_compares_medians() -> None:
    t = np.arange(200.0)
    memory = np.where(t < 60, 50.0 + t, 110.0 + 0.01 * (t - 60))
    memory[[70, 199]] = 1e6  # one wild sample moves no median
    growth = growth_of(list(t), list(memory), 60.0)
    assert growth.first == pytest.approx(110.065, rel=1e-4)
    assert growth.percent == pytest.approx(100 * 1.26 / 110.065, rel=2e-2)
    with pytest.raises(BagError, match='1 samples of the memory after 199:'):
        growth_of(list(t), list(memory), 199.0)


def test_latency_compares_the_first_and_the_last_third_after_the_start_up() -> None:
    sent = 0.001 * np.arange(10_000)
    latency = np.full(10_000, 4e-4)
    latency[:1000] = 1.0  # start-up
    latency[-10:] = 3e-3
    figures = latency_of(sent, latency, 1.0)
    assert (figures.first.p50, figures.last.p50) == pytest.approx((0.4, 0.4))
    assert figures.first.answers == figures.last.answers == 3000
    assert figures.last.largest == pytest.approx(3.0)
    assert not figures.drifts
    latency[-2000:] = 4.5e-4
    assert latency_of(sent, latency, 1.0).drifts
    with pytest.raises(BagError, match='no state was answered'):
        latency_of(np.empty(0), np.empty(0), 1.0)


def test_account_needs_written_and_dropped_to_make_up_what_was_received() -> None:
    rows = account_of(LOG, {'/joint_states': 12, '/other': 5})
    assert [row.complete for row in rows] == [True, True]
    assert (rows[0].lost, rows[1].dropped) == (3, 2)
    assert not account_of(LOG, {'/joint_states': 11, '/other': 5})[0].complete
    wrong = account_of(LOG.replace('dropped 2', 'dropped 1'), {'/joint_states': 12, '/other': 5})
    assert not wrong[1].complete
    with pytest.raises(BagError, match='did not report /third'):
        account_of(LOG, {'/third': 1})


def test_states_and_answers_are_matched_by_stamp_in_any_order(tmp_path: Path) -> None:
    joints, torque = JointStateCodec(['j1']), Float64MultiArrayCodec(1, '/ns/controller#01234567')
    start = 1_700_000_000_000_000_000
    with BagWriter(tmp_path / 'run') as writer:
        writer.add_topic('/ns/joint_states', 'sensor_msgs/msg/JointState')
        writer.add_topic('/ns/effort_controller/commands', 'std_msgs/msg/Float64MultiArray')
        for i in range(50):
            stamp = start + i * 1_000_000
            both = [('/ns/joint_states', joints.encode(stamp, *np.zeros((3, 1))), stamp + 100),
                    ('/ns/effort_controller/commands', torque.encode(np.zeros(1), stamp),
                     stamp + 100 + 1000 * (i + 1))]
            if i % 10 == 9:  # superseded: no answer
                del both[1]
            for topic, data, sent in both[::-1] if i % 2 else both:
                writer.write(topic, data, stamp + 500_000, sent)
    run = read_run(tmp_path / 'run')
    answered = np.array([i for i in range(50) if i % 10 != 9])
    assert run.counts == {'/ns/joint_states': 50, '/ns/effort_controller/commands': 45}
    np.testing.assert_allclose(run.sent, 1e-3 * answered, atol=1e-12)
    np.testing.assert_allclose(run.latency, 1e-6 * (answered + 1), atol=1e-12)


def test_what_the_nodes_reported_last_is_taken_from_the_bag(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'run') as writer:
        writer.add_topic('/diagnostics', 'diagnostic_msgs/msg/DiagnosticArray')
        for second, (node, missed) in enumerate((('a', 1), ('b', 7), ('a', 3))):
            writer.write('/diagnostics', _diagnostics(node, {'missed periods': str(missed)}),
                         10**9 * (second + 1))
    run = read_run(tmp_path / 'run')
    assert run.diagnostics == {'a': {'missed periods': '3'}, 'b': {'missed periods': '7'}}
    assert run.latency.size == 0


def _diagnostics(node: str, values: dict[str, str]) -> bytes:
    """A DiagnosticArray of one status as CDR."""
    data = bytearray(b'\0\1\0\0' + bytes(8))

    def word(number: int) -> None:
        data.extend(bytes(-len(data) % 4) + number.to_bytes(4, 'little'))

    def text(value: str) -> None:
        word(len(value) + 1)
        data.extend(value.encode() + b'\0')

    text('')
    word(1)
    data.append(0)
    for value in (f'{node}: kind', 'running', 'arm'):
        text(value)
    word(len(values))
    for pair in values.items():
        for value in pair:
            text(value)
    return bytes(data)


def test_a_short_run_of_four_processes_accounts_for_every_message(
        tmp_path: Path, capsys: pytest.CaptureFixture[str],
        monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip('rclpy', reason='no ROS 2 here: the nodes cannot run')
    monkeypatch.setattr(soak, 'MINUTE', 3.0)
    status = soak.main(['--minutes', '0.15', '--output', str(tmp_path / 'run')])
    output = capsys.readouterr()
    assert status in (0, 1), output.err  # a busy machine may well drift
    for row in re.finditer(
            r'^\| (/\S+) \| (\d+) \| (\d+) \| (\d+) \| (\d+) \|', output.out, re.M):
        received, written, in_bag, dropped = map(int, row.groups()[1:])
        assert received == written + dropped
        assert written == in_bag
    states = re.search(r'^\| /joint_states \| (\d+)', output.out, re.M)
    assert states is not None
    assert int(states[1]) > 1000
    for name in soak.NODES:
        assert re.search(rf'^\| {name} (\| \d{{2,3}}\.\d ){{2}}\| [+-]\d+\.\d+ % '
                         r'\| \d\.\d\d \| (\d+|-) \|$', output.out, re.M)
    assert re.search(r'^\| last third \| \d+\.\d+', output.out, re.M)
    assert 'FAILED /' not in output.out
    assert (tmp_path / 'run' / 'bag').exists() == (status == 1)  # kept to look for the reason
    figures = json.loads((tmp_path / 'run' / 'soak.json').read_text(encoding='utf-8'))
    assert figures['topics']['/joint_states']['written'] == int(states[1])
    assert set(figures['cores']) == set(figures['memory_mb']) == set(soak.NODES)
    assert set(figures['missed_periods']) == {'arm_driver', 'controller', 'identifier'}
    assert len(figures['minutes']) >= 2
    for minute in figures['minutes']:
        assert 10.0 < minute['memory_mb']['controller'] < 1000.0
    assert output.out.count(' cores\n') == len(figures['minutes'])


def test_what_cannot_be_run_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert soak.main(['--minutes', '0']) == 2
    assert soak.main(['--minutes', '1e5', '--output', str(tmp_path / 'long')]) == 2
    assert soak.main(['--minutes', '1', '--output', str(tmp_path)]) == 2
    errors = capsys.readouterr().err
    assert 'expected more than 0' in errors
    assert 'GB are free: expected' in errors
    assert not (tmp_path / 'long').exists()
