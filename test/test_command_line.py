# SPDX-License-Identifier: Apache-2.0
"""What every command takes and says alike."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest

from adaptive_blf_control.command_line import joint_names
from adaptive_blf_control.tools import identify
from patience import PATIENCE


@pytest.mark.parametrize('words', [['a,b'], ['a', 'b'], ['a,', 'b'], ['a, b']])
def test_joints_are_separated_by_spaces_or_commas(words):
    assert joint_names(words) == ['a', 'b']
    assert joint_names(None) is None


def test_identify_says_how_several_joints_are_written(tmp_path, capsys):
    log = tmp_path / 'log.csv'
    with pytest.raises(SystemExit):
        identify.main([str(log), '--joints', 'a', 'b', '--urdf', 'robot.urdf'])
    assert '--joints takes one word: expected --joints a,b' in capsys.readouterr().err


def test_a_command_whose_output_nobody_reads_ends_quietly():
    command = f'{sys.executable} -m adaptive_blf_control parameters; echo "status $?" >&2'
    done = subprocess.run(['bash', '-c', f'({command}) | head -1'], capture_output=True, text=True,
                          timeout=PATIENCE)
    assert 'Traceback' not in done.stderr
    assert 'BrokenPipe' not in done.stderr
    assert done.stderr in (f'status {128 + signal.SIGPIPE}\n', 'status 0\n')


def test_a_file_that_exists_is_named_with_both_ways_out(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'theta_hat.yaml').touch()
    config = tmp_path / 'c.yaml'
    config.write_text('/**/identifier: {ros__parameters: {arm: two_link}}', encoding='utf-8')
    assert identify.main(['log.csv', '--config', str(config)]) == 2
    said = capsys.readouterr().err
    assert "'theta_hat.yaml'" in said
    assert '--overwrite replaces it, --output FILE names another' in said


@pytest.mark.parametrize(('arguments', 'name'), [
    (['log.csv', '--config', 'nothing.yaml'], "'--config'"),
    (['log.csv', '--urdf', 'nothing.urdf'], 'nothing.urdf'),
    (['log.csv', '--config', 'two.yaml', '--train', '5:1'], 'log.csv')])
def test_an_option_is_named_as_it_was_written(arguments, name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'two.yaml').write_text('/**/identifier: {ros__parameters: {arm: two_link}}',
                                       encoding='utf-8')
    assert identify.main(arguments) == 2
    assert name in capsys.readouterr().err
