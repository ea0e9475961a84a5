# SPDX-License-Identifier: Apache-2.0
"""Facts about the file a run writes θ̂ to and a later run starts from."""

from __future__ import annotations

import numpy as np
import pytest
import yaml

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.estimate_file import read_estimate, write_estimate
from adaptive_blf_control.identification.identifier import Identifier, IdentifierSettings

ARM = TwoLinkArm()


@pytest.fixture
def learned(record) -> Identifier:
    result = Identifier(ARM, IdentifierSettings(
        np.zeros(5), np.ones(5), 10.0, 10.0, time_constant=0.001, gap=0.05, size=7, epsilon=0.1))
    for sample in record(steps=50):
        result.update(*sample)
    return result


def test_an_estimate_comes_back_to_the_last_bit(learned, tmp_path):
    path = tmp_path / 'theta.yaml'
    write_estimate(path, ARM.parameters, learned)
    np.testing.assert_array_equal(read_estimate(path, ARM.parameters), learned.theta)
    content = yaml.safe_load(path.read_text())
    assert content['history_rank'] == learned.stack.rank
    assert content['history_sigma_min'] == learned.stack.sigma_min
    assert content['insertions'] == learned.stack.insertions


def test_values_are_matched_by_name(learned, tmp_path):
    path = tmp_path / 'theta.yaml'
    write_estimate(path, ARM.parameters, learned)
    np.testing.assert_array_equal(read_estimate(path, ARM.parameters[::-1]), learned.theta[::-1])


def test_a_file_is_replaced_and_nothing_is_left_beside_it(learned, tmp_path):
    path = tmp_path / 'theta.yaml'
    path.write_text('old')
    write_estimate(path, ARM.parameters, learned)
    assert [entry.name for entry in tmp_path.iterdir()] == ['theta.yaml']
    assert 'theta_hat' in path.read_text()


def test_a_folder_that_does_not_exist_is_an_os_error(learned, tmp_path):
    with pytest.raises(OSError, match='No such file'):
        write_estimate(tmp_path / 'nowhere' / 'theta.yaml', ARM.parameters, learned)


@pytest.mark.parametrize(('text', 'expected'), [
    (None, r'a readable file \(No such file'),
    ('theta_hat: {p1: 1.0, p2: 2.0}', "an entry 'p3'"),
    ('theta: {p1: 1.0}', "an entry 'theta_hat'"),
    ('theta_hat: {p1: heavy}', 'numbers'),
    ('theta_hat: {p1: [1.0]}', 'numbers'),
    ('theta_hat: 3.0', 'a mapping theta_hat'),
    ('[1.0, 2.0]', 'a mapping theta_hat'),
    ('', 'a mapping theta_hat'),
    ('{theta_hat: ', 'a mapping theta_hat'),
])
def test_an_unusable_file_is_named_with_what_is_expected(tmp_path, text, expected):
    path = tmp_path / 'theta.yaml'
    if text is not None:
        path.write_text(text)
    with pytest.raises(ParameterError, match=expected) as caught:
        read_estimate(path, ARM.parameters)
    assert str(path) in str(caught.value)
    assert caught.value.name == 'identifier.initial_estimate_file'


def test_bytes_that_are_not_text_are_refused(tmp_path):
    path = tmp_path / 'theta.yaml'
    path.write_bytes(b'\xff\xfe\x00')
    with pytest.raises(ParameterError, match='a mapping theta_hat'):
        read_estimate(path, ARM.parameters)
