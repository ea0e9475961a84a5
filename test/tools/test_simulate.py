# SPDX-License-Identifier: Apache-2.0
"""Facts about the command ``simulate``: figures, exit status, messages for bad input."""

from __future__ import annotations

import json

import pytest

from adaptive_blf_control.compiled import COMPILED
from adaptive_blf_control.tools.simulate import main

KEYS = ('set_violations', 'max_abs_error', 'rms_error_last_quarter', 'min_margin', 'theta_hat',
        'theta_error_norm', 'theta_settling_time_s', 'history_rank', 'history_sigma_min', 'wall_s',
        'real_time_factor', 'chatter', 'saturated', 'torque_reserve', 'oscillation')


@pytest.fixture
def config(repository) -> str:
    return str(repository / 'config' / 'two_link.yaml')


def test_json_has_every_figure(config, capsys):
    assert main([config, '--duration', '0.2', '--json']) == 0
    figures = json.loads(capsys.readouterr().out)
    assert set(KEYS) <= set(figures)
    assert figures['duration_s'] == pytest.approx(0.2)
    assert list(figures['theta_hat']) == ['p1', 'p2', 'p3', 'fv_joint1', 'fv_joint2']
    assert figures['real_time_factor'] == pytest.approx(0.2 / figures['wall_s'])


def test_a_shipped_scenario_is_run_by_its_name(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(['two_link', '--duration', '0.01']) == 0
    assert main(['two_lnik', '--duration', '0.01']) == 2
    assert 'did you mean two_link?' in capsys.readouterr().err
    assert main(['two_link', '--duration', '0.01', '--set', 'sensors.encoder_counts=4']) == 0
    assert 'sensors.encoder_counts is without effect' in capsys.readouterr().err


def test_the_table_is_printed(config, capsys):
    assert main([config, '--duration', '0.1']) == 0
    out = capsys.readouterr().out
    for part in ('sets: KEPT', 'joint2', 'parameter error', 'rank', 'x real time'):
        assert part in out
    assert ('uncompiled: numba is not installed' in out) is not COMPILED


def test_a_joint_that_oscillates_inside_its_sets_does_not_read_kept_without_a_word(
        config, capsys):
    late = ['--set', 'arm_driver.dead_time=15', '--set', 'controller.k2=[60.0, 30.0]',
            '--set', 'controller.loop.unstable=warn']
    assert main([config, '--duration', '4', *late]) == 0
    captured = capsys.readouterr()
    assert 'sets: KEPT' in captured.out
    assert 'attention: joint1 oscillates with' in captured.out
    assert 'simulate: warning: ' in captured.err


def test_an_unstable_loop_is_refused(config, capsys):
    assert main([config, '--duration', '0.1', '--set', 'arm_driver.dead_time=40']) == 2
    error = capsys.readouterr().err
    assert "'controller.k2' is [60.0, 8.0]: expected a stable loop" in error
    assert 'would do' in error


def test_settings_change_the_run(config, capsys):
    figures = []
    for extra in ([], ['--set', 'identifier.kt=1.0'], ['--set', 'kt=1.0']):
        assert main([config, '--duration', '0.05', '--json', *extra]) == 0
        figures.append(json.loads(capsys.readouterr().out)['theta_error_norm'])
    assert figures[0] != figures[1] == figures[2]


def test_the_drivers_duration_is_the_default(config, capsys):
    assert main([config, '--json', '--set', 'arm_driver.duration=0.15']) == 0
    assert json.loads(capsys.readouterr().out)['duration_s'] == pytest.approx(0.15)


def test_a_set_that_is_left_is_told_by_the_exit_status(config, capsys):
    weak = ['--set', 'controller.torque_limit=[0.001]']
    assert main([config, '--duration', '3', *weak]) == 1
    assert 'LEFT in' in capsys.readouterr().out


@pytest.mark.parametrize(('arguments', 'expected'), [
    (['--set', 'identifier.kt=much'], "parameter 'identifier.kt' is 'much': expected"),
    (['--set', 'nonsense=1.0'], "'nonsense'"),
    (['--set', 'controller.safety.upper=[1.0]'], "joint 'joint1': reference plus performance set"),
    (['--set', 'arm_driver.initial_position=[0.0, 1.0]'], "joint 'joint2': start error outside"),
    (['--set', 'joints=[a, b, c]'], "'arm_driver.initial_position' is [0.0, 2.0]"),
    (['--set', 'joints=[a, b]'], "'controller.reference.joint1"),
    (['--set', 'controller.initial_estimate=[1.0, 2.0]'], "'controller.initial_estimate'"),
    (['--set', 'arm=three'], 'one of two_link'),
])
def test_bad_input_is_one_clear_line_and_status_2(config, capsys, arguments, expected):
    assert main([config, '--duration', '0.1', *arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == ''
    assert captured.err.startswith('simulate: ')
    assert expected in captured.err
    assert captured.err.count('\n') == 1


def test_a_file_that_is_not_there_is_status_2(tmp_path, capsys):
    assert main([str(tmp_path / 'nowhere.yaml')]) == 2
    assert 'nowhere.yaml' in capsys.readouterr().err


@pytest.mark.parametrize('duration', ['0', '-1', 'nan', 'inf', 'long'])
def test_a_duration_is_a_positive_time(config, capsys, duration):
    with pytest.raises(SystemExit) as caught:
        main([config, '--duration', duration])
    assert caught.value.code == 2
    assert '--duration' in capsys.readouterr().err
