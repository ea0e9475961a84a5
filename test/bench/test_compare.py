# SPDX-License-Identifier: Apache-2.0
"""Facts about the command ``compare``: a table, JSON, clear messages."""

from __future__ import annotations

import json

import numpy as np
import pytest

from adaptive_blf_control.bench.compare import main
from adaptive_blf_control.bench.comparison import LAWS
from adaptive_blf_control.bench.noise_study import GatedStack, Ridge
from adaptive_blf_control.configuration.build_closed_loop import build_closed_loop
from adaptive_blf_control.configuration.parameter_file import load_yaml
from adaptive_blf_control.identification.identifier import Identifier


@pytest.fixture
def config(repository) -> str:
    return str(repository / 'config' / 'two_link.yaml')


def test_the_table_has_a_row_for_each_law(config, capsys):
    assert main([config, '--duration', '0.1']) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == '## two_link, 0.1 s'
    rows = [line for line in lines if line.startswith('| ')][1:]
    assert [row.split(' | ')[0][2:] for row in rows] == list(LAWS)


def test_json_has_the_figures_of_each_law(config, capsys):
    assert main([config, '--duration', '0.1', '--json']) == 0
    laws = json.loads(capsys.readouterr().out)['two_link']['laws']
    assert list(laws) == list(LAWS)
    for figures in laws.values():
        assert {'rms_error', 'max_abs_error', 'min_margin', 'rms_torque',
                'chatter'} <= set(figures['overall'])


@pytest.mark.parametrize(('arguments', 'expected'), [
    (['nowhere.yaml'], 'nowhere.yaml'), (['--noise', 'nonsense'], "'nonsense'")])
def test_bad_input_is_one_clear_line_and_status_2(capsys, arguments, expected):
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert error.startswith('compare: ')
    assert expected in error
    assert error.count('\n') == 1


@pytest.mark.parametrize('duration', ['0', '-1', 'nan', 'long'])
def test_a_duration_is_a_positive_time(config, duration):
    with pytest.raises(SystemExit) as caught:
        main([config, '--duration', duration])
    assert caught.value.code == 2


def test_the_gate_of_the_study_refuses_an_outlier_and_takes_what_fits():
    random, theta = np.random.default_rng(3), np.array([1.0, 2.0])
    stack = GatedStack(1, 2, 5, 0.0, 3.0)
    for _ in range(5):
        regressor = random.normal(size=(1, 2))
        stack.offer(regressor, regressor @ theta + 0.01 * random.normal(size=1))
    great = np.array([[5.0, -5.0]])
    assert stack.offer(great, great @ theta + 1.0) == -1
    assert stack.offer(great, great @ theta) >= 0


def test_the_ridge_of_the_study_holds_weak_directions_at_the_prior(repository):
    data = load_yaml(repository / 'config' / 'two_link.yaml')
    loop = build_closed_loop(data)
    settings = loop.identifier.settings
    loop.identifier = Identifier(loop.arm, settings, Ridge(settings, 1e9, loop.arm.nominal + 1.0))
    theta = loop.run(1.0).theta_hat[-1]
    np.testing.assert_allclose(theta, loop.arm.nominal + 1.0, atol=1e-3)
