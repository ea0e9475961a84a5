# SPDX-License-Identifier: Apache-2.0
"""YAML of strangers ends in one error, in a moment and a little memory."""

from __future__ import annotations

import os

import pytest
import yaml

from adaptive_blf_control.bags.metadata import load_metadata
from adaptive_blf_control.bounded_yaml import load_yaml_text, read_yaml_text
from adaptive_blf_control.configuration.parameter_file import load_yaml
from adaptive_blf_control.errors import BagError, ParameterError

BOMB = 'a: &a [x, x, x, x, x, x, x, x, x]\n' + '\n'.join(
    f'{b}: &{b} [{", ".join([f"*{a}"] * 9)}]' for a, b in zip('abcdefgh', 'bcdefghi'))
DEEP = '[' * 5000


@pytest.mark.parametrize(('text', 'words'), [
    (BOMB, 'aliases followed'), (DEEP, 'levels'), ('a: &a [*a]', 'alias of what it is in'),
    ('{' * 5000, 'levels'), ('2001-99-99', 'month')])
def test_what_is_beyond_bounds_is_an_error_of_yaml(text, words):
    with pytest.raises(yaml.YAMLError, match=words):
        load_yaml_text(text)


def test_anchors_of_usual_files_are_followed():
    assert load_yaml_text('a: &x {k: [1, 2]}\nb: *x\nc: {<<: *x, j: 3}') == {
        'a': {'k': [1, 2]}, 'b': {'k': [1, 2]}, 'c': {'k': [1, 2], 'j': 3}}


@pytest.mark.parametrize('text', [BOMB, DEEP])
def test_every_reader_ends_with_its_own_error(tmp_path, text):
    (tmp_path / 'metadata.yaml').write_text(text)
    with pytest.raises(BagError, match=r'metadata\.yaml'):
        load_metadata(tmp_path)
    with pytest.raises(ParameterError, match=r'metadata\.yaml'):
        load_yaml(tmp_path / 'metadata.yaml')


def test_a_pipe_is_no_file(tmp_path):
    os.mkfifo(tmp_path / 'pipe.yaml')
    with pytest.raises(OSError, match='regular'):
        read_yaml_text(tmp_path / 'pipe.yaml')
