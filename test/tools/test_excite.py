# SPDX-License-Identifier: Apache-2.0
"""The command ``excite``: its files say the same, are followed, and never replace others."""

from __future__ import annotations

import numpy as np
import pytest
import yaml

pytest.importorskip('pinocchio')

from adaptive_blf_control.bags.logs import read_log
from adaptive_blf_control.configuration.build_closed_loop import build_closed_loop
from adaptive_blf_control.configuration.parameter_file import load_yamls
from adaptive_blf_control.control.way import way_through
from adaptive_blf_control.runs.simulation import simulate
from adaptive_blf_control.tools.configure import main as configure
from adaptive_blf_control.tools.excite import main
from planar_arm import planar_urdf

URDF = planar_urdf()
FILES = {'-o': 'motion.csv', '--trajectory': 'trajectory.yaml', '--reference': 'reference.yaml'}


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp('excite')
    (folder / 'arm.urdf').write_text(URDF)
    options = [part for option, name in FILES.items() for part in (option, str(folder / name))]
    assert main([str(folder / 'arm.urdf'), '--duration', '8', '--lead', '3', *options]) == 0
    return folder


def test_the_csv_is_a_log_that_begins_and_ends_at_rest(folder):
    log = read_log(folder / 'motion.csv', joints=['shoulder', 'elbow'])
    assert log.t[-1] == 8.0
    assert len(log.t) == 801
    np.testing.assert_allclose(log.qd[[0, -1]], 0.0, atol=1e-6)
    assert np.abs(log.qd).max() > 2.0
    assert np.abs(log.tau).max() > 5.0


def test_the_trajectory_has_the_positions_of_the_csv(folder):
    log = read_log(folder / 'motion.csv', joints=['shoulder', 'elbow'])
    message = yaml.safe_load((folder / 'trajectory.yaml').read_text())
    assert message['joint_names'] == ['shoulder', 'elbow']
    times = np.array([point['time_from_start']['sec'] + 1e-9 * point['time_from_start']['nanosec']
                      for point in message['points']])
    assert times[0] == 3.0
    assert times[-1] == 11.0
    positions = np.array([point['positions'] for point in message['points']])
    expected = np.column_stack([np.interp(times - 3.0, log.t, q) for q in log.q.T])
    np.testing.assert_allclose(positions, expected, atol=2e-3)
    assert not np.any(message['points'][-1]['velocities'])
    assert not np.any(message['points'][-1]['accelerations'])


def test_the_controller_of_a_configured_arm_follows_the_reference(folder):
    config = folder / 'arm.yaml'
    assert configure([str(folder / 'arm.urdf'), '--rate', '200', '-o', str(config)]) == 0
    run = simulate(load_yamls([config, folder / 'reference.yaml']), 9.0)
    assert run.kept
    log = read_log(folder / 'motion.csv', joints=['shoulder', 'elbow'])
    late = run.t > 3.0  # after the smooth start
    wanted = np.column_stack([np.interp(run.t[late] % 8.0, log.t, q) for q in log.q.T])
    assert np.abs(run.q[late] - wanted).max() < 0.05


def test_a_controller_takes_the_trajectory_and_its_way_is_the_motion(folder):
    messages = pytest.importorskip('trajectory_msgs.msg')
    from adaptive_blf_control.nodes.joint_trajectory import points_of
    given = yaml.safe_load((folder / 'trajectory.yaml').read_text())
    message = messages.JointTrajectory(joint_names=given['joint_names'])
    for row in given['points']:
        time = row.pop('time_from_start')
        point = messages.JointTrajectoryPoint(**row)
        point.time_from_start.sec, point.time_from_start.nanosec = time['sec'], time['nanosec']
        message.points.append(point)
    config = folder / 'other.yaml'
    assert configure([str(folder / 'arm.urdf'), '--rate', '200', '-o', str(config)]) == 0
    controller = build_closed_loop(load_yamls([config])).controller
    way = way_through(points_of(message, ('shoulder', 'elbow')), controller, 0.0)
    log = read_log(folder / 'motion.csv', joints=['shoulder', 'elbow'])
    for k in range(0, len(log.t), 37):
        point = way.at(float(log.t[k]) + 3.0)
        np.testing.assert_allclose(point.position, log.q[k], atol=2e-4)
        np.testing.assert_allclose(point.velocity, log.qd[k], atol=5e-3)


def complaint(capsys, arguments):
    assert main(arguments) == 2
    printed = capsys.readouterr()
    assert printed.out == ''
    return printed.err.splitlines()[-1]


def test_files_that_exist_are_kept(folder, capsys):
    before = (folder / 'reference.yaml').read_text()
    error = complaint(capsys, [str(folder / 'arm.urdf'), '--reference',
                               str(folder / 'reference.yaml')])
    assert '--overwrite' in error
    assert (folder / 'reference.yaml').read_text() == before


@pytest.mark.parametrize(('arguments', 'part'), [
    (['--joints', 'wrist'], "no joint 'wrist'"), (['--duration', '1'], '--duration'),
    (['--rate', '3'], '--rate'), (['--torque-noise', '-1'], '--torque-noise'),
    (['--acceleration', '1', '2', '3'], '--acceleration'), (['--srdf', 'none.srdf'], '--srdf'),
    (['-o', 'nowhere/motion.csv'], '--output'), (['--centre', '9', '0'], 'shoulder'),
    (['--correlation', 'nan'], '--correlation')])
def test_bad_input_is_one_line_that_names_it(folder, capsys, arguments, part):
    assert part in complaint(capsys, [str(folder / 'arm.urdf'), *arguments])
