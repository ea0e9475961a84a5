# SPDX-License-Identifier: Apache-2.0
"""``identify --payload`` finds the load of a log, ``--estimate-gains`` the gains of drives."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip('pinocchio')

from adaptive_blf_control.arms.load_frame import load_map
from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.identification.estimate_file import write_estimate
from adaptive_blf_control.identification.knowledge import Snapshot
from adaptive_blf_control.tools.identify import main
from spatial_arm import JOINTS, spatial_arm, true_theta, URDF

PERIOD = 0.004
LOAD = np.array([1.5, 0.03, 0.0, 0.06, 0.005, 0.0, 0.006, -0.001, 0.0, 0.004])  # π at the tool
GAINS = np.array([0.8, 1.25, 1.1])  # N·m per unit of the effort


@pytest.fixture(scope='module')
def arm() -> UrdfArm:
    return spatial_arm()


def write_log(path: Path, arm: UrdfArm, load: np.ndarray, rates: tuple[float, ...],
              gains: np.ndarray | float = 1.0, size: float = 0.8, noise: float = 0.1) -> Path:
    """Write 8 s of a motion under a load; efforts are means over the interval that ends there."""
    random, speed = np.random.default_rng(1), np.array(rates)
    theta = true_theta(arm) + load_map(arm, 'tool') @ load
    rows, before = [], np.zeros(3)
    for k in range(2000):
        t = PERIOD * k
        q, qd = size * np.sin(speed * t), size * speed * np.cos(speed * t)
        tau = arm.Y(q, qd, -size * speed ** 2 * np.sin(speed * t)) @ theta
        mean, before = 0.5 * (before + tau), tau
        rows.append([t, *q, *qd, *(mean + random.normal(scale=noise, size=3)) / gains])
    np.savetxt(path, rows, '%.10g', ',', comments='', header='t,' + ','.join(
        f'{kind}{j}' for kind in ('q', 'qd', 'tau') for j in (1, 2, 3)))
    return path


@pytest.fixture(scope='module')
def files(tmp_path_factory, arm) -> dict[str, str]:
    """Return a loaded log, the URDF, and a model without the load, by name."""
    folder = tmp_path_factory.mktemp('load')
    (folder / 'arm.urdf').write_text(URDF, encoding='utf-8')
    write_estimate(folder / 'theta_hat.yaml',
                   Snapshot(arm.parameters, true_theta(arm), arm.m, 1.0, 100))
    write_log(folder / 'loaded.csv', arm, LOAD, (2.1, 3.3, 4.7))
    return {name: str(folder / name) for name in ('arm.urdf', 'theta_hat.yaml', 'loaded.csv')}


def arguments(files, *more: str) -> list[str]:
    return [files['loaded.csv'], '--urdf', files['arm.urdf'], '--joints', ','.join(JOINTS),
            '--set', 'filter.time_constant=0.02', *more]


def test_the_load_is_printed_with_standard_deviations(files, capsys) -> None:
    beside = arguments(files, '--payload', files['theta_hat.yaml'], '--payload-frame', 'tool')
    assert main([*beside, '--json']) == 0
    load = json.loads(capsys.readouterr().out)['load']
    assert load['attached']
    assert load['mass'] == pytest.approx(1.5, rel=0.05)
    np.testing.assert_allclose(load['com'], LOAD[1:4] / LOAD[0], atol=0.01)
    assert abs(load['mass'] - 1.5) < 4.0 * load['mass_std'] < 0.4
    assert main(beside) == 0
    printed = capsys.readouterr().out
    assert 'since the beginning (filters settled at 0.10 s)' in printed
    assert f'mass            {load["mass"]:.3f} ± {load["mass_std"]:.3f} kg' in printed
    assert f'95 % interval {load["mass"] - 1.96 * load["mass_std"]:.3f} .. ' in printed


def test_a_load_that_is_there_from_the_first_sample_on_is_dated_to_the_beginning(files,
                                                                              capsys) -> None:
    assert main(arguments(files, '--payload', files['theta_hat.yaml'], '--payload-frame', 'tool',
                          '--json')) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures['changes'] == 1
    assert figures['load']['since'] <= 0.26  # the first block of settled filters
    assert all(each['attached'] for each in figures['over_time'] if each['t'] > 2.0)
    assert not figures['notes']


def test_a_log_that_cannot_tell_a_load_says_what_is_needed(files, tmp_path, arm, capsys) -> None:
    """Swings of a degree in one posture under much noise fit many loads, or none."""
    slow = write_log(tmp_path / 'slow.csv', arm, LOAD, (2.1, 3.3, 4.7), size=0.02, noise=30.0)
    assert main(arguments({**files, 'loaded.csv': str(slow)}, '--payload',
                          files['theta_hat.yaml'], '--payload-frame', 'tool', '--json')) == 0
    figures = json.loads(capsys.readouterr().out)
    assert not figures['load']['attached']
    assert figures['load']['undecided']
    assert figures['load']['mass_most'] > 1.5
    assert 'not known whether there is a load' in figures['notes'][0]
    assert 'different postures' in figures['notes'][0]


def test_a_log_without_a_load_says_above_which_mass_there_is_none(files, tmp_path, arm,
                                                                   capsys) -> None:
    without = write_log(tmp_path / 'without.csv', arm, 0.0 * LOAD, (2.1, 3.3, 4.7))
    assert main(arguments({**files, 'loaded.csv': str(without)}, '--payload',
                          files['theta_hat.yaml'], '--payload-frame', 'tool')) == 0
    printed = capsys.readouterr()
    most = float(printed.out.rsplit('at the end: no load above ')[1].split()[0])
    assert 0.0 < most < 0.1
    assert 'not known' not in printed.err


def test_a_model_that_leaves_much_of_the_torque_unexplained_is_named(files, tmp_path, arm,
                                                                     capsys) -> None:
    """Dry friction that the robot has not is none of the load, which explains the rest."""
    theta = true_theta(arm)
    theta[[name.startswith('fc_') for name in arm.parameters]] += 4.0
    poor = tmp_path / 'poor.yaml'
    write_estimate(poor, Snapshot(arm.parameters, theta, arm.m, 1.0, 100))
    assert main(arguments(files, '--payload', str(poor), '--payload-frame', 'tool',
                          '--json')) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures['load']['attached']
    assert f'neither by {poor} nor by the load' in figures['notes'][0]


def test_the_load_explains_the_torque_that_the_model_does_not(files, capsys) -> None:
    assert main(arguments(files, '--payload', files['theta_hat.yaml'], '--payload-frame', 'tool',
                          '--json')) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures['rmse_with'][1] < 0.2 * figures['rmse_without'][1]


def test_a_load_that_comes_off_within_the_log_is_listed(files, tmp_path, arm, capsys) -> None:
    path = write_log(tmp_path / 'both.csv', arm, LOAD, (2.1, 3.3, 4.7))
    after = write_log(tmp_path / 'after.csv', arm, 0.0 * LOAD, (2.1, 3.3, 4.7))
    kept = path.read_text().splitlines()[:1001] + after.read_text().splitlines()[1001:]
    path.write_text('\n'.join(kept), encoding='utf-8')
    assert main(arguments({**files, 'loaded.csv': str(path)}, '--payload', files['theta_hat.yaml'],
                          '--payload-frame', 'tool')) == 0
    printed = capsys.readouterr().out
    since, _, until, *rest = printed.split('before:')[1].split()[:6]
    assert float(since) == pytest.approx(0.1, abs=0.01)
    assert float(until) == pytest.approx(4.0, abs=0.5)
    assert float(rest[1]) == pytest.approx(1.5, rel=0.05)
    assert 'at the end: no load above 0.' in printed


@pytest.mark.parametrize('option', ['--train=:4', '--html=page.html', '--require-rmse=5%'])
def test_an_option_that_would_do_nothing_is_refused(files, capsys, option) -> None:
    assert main(arguments(files, '--payload', files['theta_hat.yaml'], '--payload-frame', 'tool',
                          option)) == 2
    assert f"'{option.partition('=')[0]}' is" in capsys.readouterr().err


@pytest.mark.parametrize(('frame', 'told'), [
    (('--payload-frame', 'palm'), "'palm'"), ((), "''")])
def test_a_frame_that_is_not_there_is_refused_with_those_that_are(files, capsys, frame,
                                                                  told) -> None:
    assert main(arguments(files, '--payload', 'nominal', *frame)) == 2
    error = capsys.readouterr().err
    assert f"'--payload-frame' is {told}" in error
    assert 'column, upper, fore, tool' in error


def test_a_model_of_another_robot_is_refused(files, tmp_path, capsys) -> None:
    other = tmp_path / 'other.yaml'
    write_estimate(other, Snapshot(('elbow_joint.Ixx',), np.ones(1), 1, 1.0, 100))
    assert main(arguments(files, '--payload', str(other), '--payload-frame', 'tool')) == 2
    error = capsys.readouterr().err
    assert "'--payload'" in error
    assert 'parameters of this arm' in error


def test_gains_are_found_from_a_load_whose_mass_is_known(files, tmp_path, arm, capsys) -> None:
    without = write_log(tmp_path / 'without.csv', arm, 0.0 * LOAD, (2.1, 3.3, 4.7), GAINS)
    along = write_log(tmp_path / 'with.csv', arm, LOAD, (2.3, 3.1, 4.4), GAINS)
    asked = arguments({**files, 'loaded.csv': str(without)}, '--estimate-gains', str(along),
                      '--payload-frame', 'tool', '--known-load', '1.5')
    assert main([*asked, '--json']) == 0
    found = json.loads(capsys.readouterr().out)
    np.testing.assert_allclose(found['gain'], GAINS, rtol=0.05)
    assert (np.abs(np.array(found['gain']) - GAINS) < 2.0 * np.array(found['half_width'])).all()
    assert main([*asked, '--gain', 'lift:1.25']) == 0  # what is given is part of what is found
    assert ',lift:1.2' in capsys.readouterr().out


@pytest.mark.parametrize('known', ['', 'heavy', '-1', '1,2', '0'])
def test_a_load_that_cannot_be_is_refused(files, capsys, known) -> None:
    assert main(arguments(files, '--estimate-gains', files['loaded.csv'], '--payload-frame',
                          'tool', f'--known-load={known}')) == 2
    assert "'--known-load'" in capsys.readouterr().err
