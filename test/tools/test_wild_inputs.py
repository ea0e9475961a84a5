# SPDX-License-Identifier: Apache-2.0
"""Inputs as users report them: each is learned from rightly, or refused for the right reason.

They lie beside the repository, as the measured logs do; the tests of the rooms have their own.
"""

from __future__ import annotations

from pathlib import Path
import shutil

import numpy as np
import pytest

pytest.importorskip('pinocchio')

from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.bags.recovery import recover_bag
from adaptive_blf_control.errors import BagError
from adaptive_blf_control.runs.identification import identify
from adaptive_blf_control.runs.log_options import LogOptions
from adaptive_blf_control.tools.identify import main

JOINTS = ('joint_a', 'joint_b', 'joint_c')
GAINS = dict(zip(JOINTS, (13.6, 14.3, 11.4)))
STATE = {'filter': {'state_order': 4, 'state_time_constant': 0.01}}
# The case, its log, and what is said; with the options the same log is learned from.
REFUSED = [
    ('02_nan_effort_all', 'bag', "no velocity for joint 'joint_a'"),
    ('03_effort_all_zero', 'bag', "joint 'joint_b': the effort is zero"),
    ('04_velocity_all_zero', 'bag', "joint 'joint_c': the velocity is zero while the position"),
    ('15_slow_10_Hz', 'bag', '--set filter.gap=0.3'),
    ('26_two_recordings_in_one_folder', 'logs', 'several recordings: monday_0.mcap, tuesday_0'),
    ('44_csv_degrees', 'log.csv', '--degrees'),
    ('50_no_velocity', 'nan', '--set filter.state_order=4'),
    ('50_no_velocity', 'empty', '--set filter.state_order=4'),
    ('50_no_velocity', 'zero', '--set filter.state_order=4'),
    ('50_no_velocity', 'noqd.csv', '--set filter.state_order=4'),
    ('56_short_log', 'short', 'too short'), ('56_short_log', 'three', 'too short')]
LEARNED = [
    ('05_effort_is_current', 'bag', {'options': LogOptions(gain=GAINS)}),
    ('07_arm_in_two_messages', 'bag', {}), ('09_clock_jumps_back', 'bag', {}),
    ('10_one_stamp_in_future', 'bag', {}), ('21_file_compressed_folder', 'bag', {}),
    ('21_file_compressed_folder', 'bag/bag.mcap.zstd', {}), ('23_message_compressed', 'bag', {}),
    ('23_message_compressed', 'bag/bag.db3', {}), ('29_mcap_without_schema', 'log.mcap', {}),
    ('29_mcap_without_schema', 'log.mcap', {'topic': '/joint_states'}),
    ('32_only_dynamic_joint_states', 'bag', {}),
    ('32_only_dynamic_joint_states', 'bag', {'topic': '/dynamic_joint_states'}),
    ('41_csv_semicolon_comma', 'log.csv', {}),
    *(('42_csv_other_headers', f'{name}.csv', {}) for name in (
        'ddq', 'plain', 'plotjuggler', 'timestamp', 'zero')),
    ('44_csv_degrees', 'log.csv', {'options': LogOptions(degrees=True)}),
    *(('50_no_velocity', name, STATE) for name in ('nan', 'empty', 'zero', 'noqd.csv')),
    ('60_no_inertials', 'bag', {})]


@pytest.fixture(scope='module')
def wild(repository: Path) -> Path:
    """Return the folder of the inputs, or skip."""
    folder = repository.parent / 'shared' / 'wild' / 'cases'
    if not folder.is_dir():
        pytest.skip(f'no inputs from the field: {folder} does not exist')
    return folder


def torque_error(result, true_urdf: Path) -> float:
    """Return the RMS error of the predicted torque against the true arm, as a part of it."""
    arm = UrdfArm(true_urdf, JOINTS, viscous=0.8, friction_coulomb=True, coulomb=0.5,
                  friction_offset=True, offset=0.1)
    random = np.random.default_rng(2)
    motions = [random.uniform(-limit, limit, (200, 3)) for limit in (1.0, 1.5, 4.0)]
    true = np.array([arm.Y(*motion) @ arm.nominal for motion in zip(*motions)])
    return float(np.linalg.norm(result.predict(*motions) - true) / np.linalg.norm(true))


@pytest.mark.parametrize(('case', 'log', 'words'), REFUSED)
def test_what_cannot_be_right_is_refused_with_what_would_help(capsys, tmp_path, wild, case, log,
                                                              words):
    output = tmp_path / 'theta.yaml'
    assert main([str(wild / case / log), '--urdf', str(wild / case / 'ph.urdf'), '--output',
                 str(output)]) == 2
    assert words in capsys.readouterr().err
    assert not output.exists()


@pytest.mark.parametrize(('case', 'log', 'options'), LEARNED)
def test_what_can_be_read_is_learned_from(wild, case, log, options):
    result = identify(wild / case / log, wild / case / 'ph.urdf', **options)
    # Clean logs give 0.4 %; these have a third of the rows, or no measured velocity.
    short = case.startswith(('32', '50'))
    assert torque_error(result, wild / case / 'true.urdf') < (0.04 if short else 0.012)
    if case.startswith(('09', '10')):
        assert 'clock goes back by 3600 s' in result.notes[0] or '1 stamps far' in result.notes[0]


def test_currents_are_suspected(wild):
    case = wild / '05_effort_is_current'
    result = identify(case / 'bag', case / 'ph.urdf')
    assert {finding.check for finding in result.findings} == {'unit'}
    assert all('gain' in finding.hint for finding in result.findings)


def test_a_middle_link_without_inertial_changes_nothing(wild):
    log = wild / '41_csv_semicolon_comma/log.csv'
    described = identify(log, wild / '41_csv_semicolon_comma/ph.urdf')
    bare = identify(log, wild / '73_middle_link_no_inertial/ph.urdf')
    np.testing.assert_array_equal(bare.theta, described.theta)


@pytest.mark.parametrize('axis', ['long', 'neg', 'none'])
def test_axes_are_those_of_the_urdf(wild, axis):
    case = wild / '64_axis'
    result = identify(case / 'bag', case / f'{axis}.urdf', options=LogOptions(force=True))
    assert result.rank == result.arm.m
    if axis == 'long':  # the same arm; the others are other arms than the log is of
        assert torque_error(result, case / f'{axis}_true.urdf') < 0.012


@pytest.mark.parametrize(('case', 'urdf', 'words'), [
    ('64_axis', 'zero.urdf', "has the axis '0 0 0'"),
    *(('66_xacro', f'{name}.xacro', 'this is a xacro file')
      for name in ('www', 'old', 'dollar', 'find', 'empty'))])
def test_urdfs_that_are_none_are_named(capsys, tmp_path, wild, case, urdf, words):
    assert main([str(wild / case / 'bag'), '--urdf', str(wild / case / urdf), '--output',
                 str(tmp_path / 'theta.yaml')]) == 2
    assert words in capsys.readouterr().err


def test_compressed_bags_are_recovered_and_several_recordings_are_not(tmp_path, wild):
    done = recover_bag(wild / '21_file_compressed_folder/bag', tmp_path / 'copy')
    assert (done.what, done.messages, done.problem) == ('copy', 4000, None)
    shutil.copytree(wild / '26_two_recordings_in_one_folder/logs', tmp_path / 'logs')
    with pytest.raises(BagError, match='several recordings'):
        recover_bag(tmp_path / 'logs')
    assert not (tmp_path / 'logs/metadata.yaml').exists()
