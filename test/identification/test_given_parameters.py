# SPDX-License-Identifier: Apache-2.0
"""Facts about parameters given as values, by the word nominal, or by a file of an estimate."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.configuration.build_closed_loop import build_closed_loop
from adaptive_blf_control.configuration.parameter_file import apply_settings, load_yaml
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.estimate_file import write_estimate
from adaptive_blf_control.identification.given_parameters import given_parameters
from adaptive_blf_control.identification.identifier import Identifier

ARM = TwoLinkArm()
LEARNED = np.array([3.0, 0.2, 0.25, 5.0, 1.0])


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / 'theta_hat.yaml'
    write_estimate(path, Identifier(ARM, initial_estimate=LEARNED).snapshot())
    return path


def test_a_list_the_nominal_arm_and_a_file_are_all_parameters(file: Path) -> None:
    for value, expected in ((np.array([2.0]), np.full(5, 2.0)), (LEARNED, LEARNED),
                            ('nominal', ARM.nominal), (str(file), LEARNED)):
        np.testing.assert_array_equal(given_parameters('x', value, ARM), expected)


def test_what_is_returned_can_be_changed_without_a_trace() -> None:
    given_parameters('x', 'nominal', ARM)[:] = 0.0
    assert ARM.nominal.any()


@pytest.mark.parametrize(('value', 'expected'), [
    (np.zeros(3), 'a list of length 1 or 5'), ('nowhere.yaml', 'a readable file')])
def test_what_cannot_be_used_is_refused_by_name(value, expected) -> None:
    with pytest.raises(ParameterError, match=f'controller.known_parameters.*{expected}'):
        given_parameters('controller.known_parameters', value, ARM)


@pytest.mark.parametrize('name', ['initial_estimate', 'controller.known_parameters',
                                  'arm_driver.true_parameters'])
def test_a_word_that_is_neither_nominal_nor_a_file_is_refused(repository: Path, name) -> None:
    data = apply_settings(load_yaml(repository / 'config/two_link.yaml'), [f'{name}=usual'])
    with pytest.raises(ParameterError, match='nominal, a .yaml file'):
        build_closed_loop(data)


def test_every_part_of_a_scenario_takes_them(repository: Path, file: Path) -> None:
    data = apply_settings(load_yaml(repository / 'config/two_link.yaml'), [
        'identifier.initial_estimate=nominal', f'controller.known_parameters={file}',
        'controller.model=known', f'arm_driver.true_parameters={file}'])
    loop = build_closed_loop(data)
    np.testing.assert_array_equal(loop.identifier.theta, loop.arm.nominal)
    np.testing.assert_array_equal(loop.known, LEARNED)
    np.testing.assert_array_equal(loop.plant.truth(loop.arm.parameters)[0][1], LEARNED)


def test_an_identifier_that_is_retuned_does_not_read_its_file_again(file: Path) -> None:
    identifier = Identifier(ARM, initial_estimate=str(file))
    file.unlink()
    identifier.retune(identifier.settings.replace(kt=3.0))
    np.testing.assert_array_equal(identifier.theta, LEARNED)
