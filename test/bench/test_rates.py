# SPDX-License-Identifier: Apache-2.0
"""The rate part of the benchmark counts right, and prints a whole table of a real run."""

from __future__ import annotations

import os
from pathlib import Path
import re
import time

import numpy as np
import pytest

from adaptive_blf_control.bags.writer import BagWriter
from adaptive_blf_control.bench import bench
from adaptive_blf_control.bench.rate_figures import (
    Loop,
    median,
    of_bag,
    of_bare,
    RateFigures,
    Row,
    Seen,
    Usage,
    usage_of,
)
from adaptive_blf_control.bench.rates import BARE, OURS
from adaptive_blf_control.errors import BagError
from adaptive_blf_control.messages.cdr import Float64MultiArrayCodec, JointStateCodec
from adaptive_blf_control.runtime.loop_statistics import LoopStatistics, START_UP

MS = 1_000_000  # ns
START = 1_700_000_000_000_000_000  # ns


def test_missed_periods_of_the_bare_echo_are_counted_after_the_start_up(tmp_path: Path) -> None:
    sent = START + MS * np.arange(5001)
    trips = np.full(sent.size, 2 * MS)
    trips[:1000] = 40 * MS  # start-up
    trips[2000:2100] = 0  # never answered
    trips[4000:4010] = MS  # all others are late
    files = {name: tmp_path / f'{name}.npz' for name in BARE}
    np.savez(files['driver'], served=sent, trips=trips)
    np.savez(files['echo'], served=np.delete(sent, slice(3000, 3390)), trips=[])
    np.savez(files['listener'], served=sent, trips=[])
    run = of_bare(files, dict.fromkeys(BARE, Usage(30.0, 70.0)), 1000.0, 1.0,
                  Seen(0.5, 3.5))
    assert run.rows['driver'][:3] == pytest.approx((1000.0, 0, 3900))
    assert run.rows['echo'][:3] == pytest.approx((900.0, 390, 3900))
    assert run.loop == pytest.approx((2.0, 2.0, 2.0, 2.0, 100 * 3800 / 3900, 100 * 10 / 3900,
                                      0.9, 0.5, 3.5))


def test_the_way_of_a_round_trip_comes_from_the_times_that_the_raw_nodes_keep(
        tmp_path: Path) -> None:
    due = START + MS * np.arange(1001)
    sent = due + MS // 10
    sent[100:200] = due[100:200] + 6 * MS // 10  # late by more than half a period
    answered = np.delete(np.arange(1001), 500)
    files = {name: tmp_path / f'{name}.npz' for name in BARE}
    np.savez(files['driver'], served=sent, trips=np.full(1001, MS // 2), due=due)
    np.savez(files['echo'], served=sent[answered], trips=[], stamp=answered + 1,
             sent=sent[answered] + MS // 5)
    np.savez(files['listener'], served=sent)
    way = of_bare(files, dict.fromkeys(BARE, Usage(30.0, 70.0)), 1000.0, 0.0).way
    assert way == pytest.approx((0.1, 0.6, 100 * 100 / 901, 0.2, 0.2, 0.3), rel=0.01)
    assert median([RateFigures({}, Loop(*range(7)), way)] * 2).way == pytest.approx(way)


def test_the_way_of_a_round_trip_comes_from_the_times_of_publication_in_a_bag(
        tmp_path: Path) -> None:
    codec, torque = JointStateCodec(['j'], fields=('position',)), Float64MultiArrayCodec(
        1, '/controller#01234567')
    with BagWriter(tmp_path / 'bag') as writer:
        writer.add_topic('/joint_states', 'sensor_msgs/msg/JointState')
        writer.add_topic('/effort_controller/commands', 'std_msgs/msg/Float64MultiArray')
        for stamp in range(START, START + 1000 * MS, MS):
            writer.write('/joint_states', codec.encode(stamp, np.zeros(1)), stamp + 2 * MS,
                         stamp + MS // 10)
            writer.write('/effort_controller/commands', torque.encode(np.zeros(1), stamp),
                         stamp + 2 * MS, stamp + MS // 2)
    log = ''.join(f'/{topic}: received 1000, written 1000, lost 0\n'
                  for topic in ('joint_states', 'effort_controller/commands'))
    way = of_bag(tmp_path / 'bag', log, dict.fromkeys(OURS, Usage(25.0, 200.0)), 1000.0, 0.0).way
    assert way[:5] == pytest.approx((0.1, 0.1, 0.0, 0.4, 0.4))
    assert np.isnan(way.back)  # no diagnostics in this bag


def test_missed_periods_of_a_bag_come_from_the_stamps(tmp_path: Path) -> None:
    codec = JointStateCodec(['j'], fields=('position',))
    torque = Float64MultiArrayCodec(1, '/controller#01234567')
    states = np.arange(-20, 2001)  # the first 20 before the motion
    kept = {'joint_states': states[states % 10 != 5],
            'effort_controller/commands': np.arange(0, 2001, 2),
            # Out of order, and some twice: a second estimate does not serve a second period.
            'identifier/theta_hat': np.concatenate([states, states[-1000:]])[::-1]}
    with BagWriter(tmp_path / 'bag') as writer:
        for topic, numbers in kept.items():
            commands = topic.endswith('commands')
            writer.add_topic(f'/{topic}', 'std_msgs/msg/Float64MultiArray' if commands else
                             'sensor_msgs/msg/JointState')
            for number in numbers.tolist():
                stamp = START + number * MS
                data = (torque.encode(np.zeros(1), stamp) if commands else
                        codec.encode(stamp, np.zeros(1)))
                writer.write(f'/{topic}', data, stamp, stamp)
    log = ''.join(f'/{topic}: received {numbers.size}, written {numbers.size}, lost 3\n'
                  for topic, numbers in kept.items())
    usage = dict.fromkeys(OURS, Usage(25.0, 200.0))
    run = of_bag(tmp_path / 'bag', log, usage, 1000.0, 1.0)
    assert run.rows['arm_driver'][:3] == pytest.approx((900.0, 90, 900))
    assert run.rows['controller'][:3] == pytest.approx((500.0, 450, 900))
    assert run.rows['identifier'][:3] == pytest.approx((1000.0, 0, 900))
    assert run.rows['recorder'][1:3] == (9, sum(n.size for n in kept.values()) + 9)
    assert run.loop.met == pytest.approx(50.0)
    assert run.loop.cores == pytest.approx(1.0)
    assert np.isnan(run.loop.p50)  # no diagnostics in this bag
    with pytest.raises(BagError, match=r'2\.00 s of motion: expected more than 3\.1 s'):
        of_bag(tmp_path / 'bag', log, usage, 1000.0, 3.0)


def test_repeated_runs_give_the_median_of_each_figure() -> None:
    runs = [RateFigures({'echo': Row(rate, 1000.0 - rate, 1000.0)}, Loop(p50, 2, 3, 4, 99, 98, 1))
            for rate, p50 in ((900.0, 0.3), (1000.0, 0.5), (990.0, 0.4))]
    both = median(runs)
    assert both.rows['echo'][:2] == (990.0, 10.0)
    assert both.loop.p50 == 0.4


def test_what_a_process_uses_is_read_while_it_lives() -> None:
    usage = usage_of(os.getpid())
    assert usage is not None
    assert usage[0] == pytest.approx(time.process_time(), abs=0.5)
    pages = int(Path('/proc/self/statm').read_text(encoding='ascii').split()[1])
    assert usage[1] == pytest.approx(pages * os.sysconf('SC_PAGE_SIZE') * 1e-6, rel=0.2)
    assert usage_of(2**22 + 1) is None  # beyond the largest process id


def test_figures_of_the_whole_run_forget_the_start_and_those_of_a_second_do_not() -> None:
    statistics = LoopStatistics()
    for number in range(3000):
        statistics.callback.add(9 * MS if number < 1000 else MS // 2)
        statistics.sample(START + number * MS)
    figures = statistics.take()
    key = 'callback so far p50, p99, p99.9, largest [ms]'
    assert START_UP == 2.0
    assert all(abs(float(value) - 0.5) < 0.01 for value in figures[key].split(', '))
    assert float(figures['callback p50, p99, largest so far [ms]'].split(', ')[1]) > 8.9


def test_a_short_run_prints_every_figure(repository: Path,
                                         capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip('rclpy', reason='no ROS 2 here: the nodes cannot run')
    status = bench.main(['rates', '--rates', '100', '--seconds', '1.5', '--executor', 'plain',
                         '--config', str(repository / 'config'), '--composed', '--floor'])
    output = capsys.readouterr()
    assert status == 0, output.err
    cells = {row[0]: row[1:] for row in (
        re.split(r' \| ', line.strip('| ')) for line in output.out.splitlines()
        if line.startswith('| '))}
    assert cells['identifier, composed'][-2:] == ['–', '–']  # it has no process of its own
    cells['identifier, composed'][-2:] = cells['identifier'][-2:]
    for name in (*OURS, *(f'{name}, composed' for name in OURS)):
        rate, missed, percent, p50, p99, largest, cpu, memory = map(float, cells[name])
        assert 0.0 < rate < (110.0 if 'recorder' not in name else 2000.0)
        assert missed >= 0.0
        assert 0.0 <= percent <= 100.0
        assert 0.0 < p50 <= p99 <= max(largest, p99)
        assert 0.0 < cpu < 200.0
        assert 20.0 < memory < 2000.0
    for name in (f'{kind}_{name}' for kind in ('bare', 'raw') for name in BARE):
        row = cells[name]
        assert row[3:6] == ['–'] * 3
        assert float(row[0]) > 0.0
    for name in ('four nodes', 'composed', 'raw echo'):
        late, late99, slow, answer, answer99, back = map(float, cells[f'way, {name}'])
        assert 0.0 < late <= late99
        assert 0.0 <= slow <= 100.0
        assert 0.0 < answer <= answer99
        assert answer + back == pytest.approx(float(cells[name][0]), abs=2e-3)
    for name in ('four nodes', 'composed', 'bare echo', 'raw echo', 'four nodes / bare echo',
                 'composed / bare echo', 'raw echo / bare echo'):
        *figures, stolen, start = cells[name]
        assert len(figures) == 7
        in_time = float(figures.pop(5))
        assert in_time >= 0.0  # on a busy machine perhaps none
        assert all(float(value) > 0.0 for value in figures)
        assert stolen == start == '–' if '/' in name else 0.0 <= float(stolen) < 100.0
        assert '/' in name or 0.0 < float(start) < 90.0


def test_a_node_that_fails_is_shown_with_what_it_printed(
        repository: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip('rclpy', reason='no ROS 2 here: the nodes cannot run')
    text = (repository / 'config/two_link.yaml').read_text(encoding='utf-8')
    (tmp_path / 'two_link.yaml').write_text(
        text.replace('k1: [1000.0, 1000.0]', 'k1: [-1.0, 1000.0]'), encoding='utf-8')
    status = bench.main(['rates', '--rates', '100', '--config', str(tmp_path)])
    error = capsys.readouterr().err
    assert status == 1
    assert 'bench: controller did not end well, it printed:' in error
    assert 'k1' in error.partition('printed:')[2]


def test_options_that_make_no_run_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip('rclpy', reason='no ROS 2 here: the nodes cannot run')
    for option, value in (('--seconds', '0'), ('--repeats', '0'), ('--realtime', '2'),
                          ('--rates', '-5')):
        assert bench.main(['rates', f'{option}={value}']) == 1
        assert f"parameter '{option}' is " in capsys.readouterr().err
