# SPDX-License-Identifier: Apache-2.0
"""Facts about declared parameters and the messages that refuse a value."""

from __future__ import annotations

import math

import numpy as np
import pytest

from adaptive_blf_control.configuration.node_settings import TABLES
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.parameters.table import (
    broadcast,
    JOINT,
    Parameter,
    per_joint,
    validated,
    value_problem,
)

GAIN = Parameter('gain', 'double', 1.0, 'A gain.', 'N*m', 0.0, 10.0)
POSITIVE = Parameter('time', 'double', 1.0, 'A time.', 's', 0.0, exclusive=True)
COUNT = Parameter('count', 'int', 3, 'A count.', '', 1, 5)
FLAG = Parameter('flag', 'bool', True, 'A flag.')
MODE = Parameter('mode', 'string', 'slow', 'A mode.', choices=('slow', 'fast'))
GAINS = Parameter('gains', 'double_array', [1.0], 'Gains.', 'N*m', 0.0, exclusive=True,
                  length='joints')
THREE = Parameter('three', 'double_array', [0.0, 0.0, 0.0], 'A vector.', length=3)
NAMES = Parameter('names', 'string_array', ['a'], 'Names.')
TABLE = (GAIN, POSITIVE, COUNT, FLAG, MODE, GAINS, THREE, NAMES)

ALL = [pytest.param(node, parameter, id=f'{node}.{parameter.name}')
       for node, table in TABLES.items() for parameter in table]


@pytest.mark.parametrize(('parameter', 'value'), [
    (GAIN, 0.0), (GAIN, 10.0), (POSITIVE, 1e-9), (POSITIVE, 1e308), (COUNT, 1), (COUNT, 5),
    (FLAG, False), (MODE, 'fast'), (GAINS, [2.0]), (GAINS, [1.0, 2.0]), (THREE, [1.0, 2.0, 3.0]),
    (NAMES, []), (NAMES, ['x', 'y', 'z'])])
def test_good_values_are_accepted(parameter, value):
    assert value_problem(parameter, value, {'joints': 2}) is None


@pytest.mark.parametrize(('parameter', 'value', 'expected'), [
    (GAIN, 1, 'a floating-point number: write 1.0'),
    (GAIN, -7, 'a floating-point number: write -7.0'),
    (GAIN, '1e-3', 'a floating-point number'),  # YAML 1.1 reads 1e-3 as a string
    (GAIN, True, 'a floating-point number'),
    (GAIN, None, 'a floating-point number'),
    (GAIN, [1.0], 'a floating-point number'),
    (GAIN, math.nan, 'a number, not NaN'),
    (GAIN, -0.1, '>= 0 and <= 10 N*m'),
    (GAIN, 10.1, '>= 0 and <= 10 N*m'),
    (GAIN, -math.inf, 'a finite number'),
    (POSITIVE, math.inf, 'a finite number'),
    (POSITIVE, 0.0, '> 0 s'),
    (POSITIVE, -1.0, '> 0 s'),
    (COUNT, 2.0, 'an integer'),
    (COUNT, True, 'an integer'),
    (COUNT, 0, '>= 1 and <= 5'),
    (COUNT, 6, '>= 1 and <= 5'),
    (FLAG, 1, 'true or false'),
    (FLAG, 'true', 'true or false'),
    (MODE, 'medium', 'one of slow, fast'),
    (MODE, 3, 'one of slow, fast'),
    (GAINS, 1.0, 'a list of doubles'),
    (GAINS, '1.0', 'a list of doubles'),
    (GAINS, [1.0, 2], 'a list in which every element is a floating-point number: write 2.0'),
    (GAINS, [1.0, math.nan], 'a list in which every element is a number, not NaN'),
    (GAINS, [1.0, math.inf], 'a list in which every element is a finite number'),
    (GAINS, [1.0, 0.0], 'a list in which every element is > 0 N*m'),
    (GAINS, [[1.0], [1.0]], 'one flat list of doubles: Gains'),
    (GAINS, [], 'a list of length 1 or 2 (one for each of the joints)'),
    (GAINS, [1.0] * 3, 'a list of length 1 or 2 (one for each of the joints)'),
    (THREE, [1.0], 'a list of length 3'),
    (NAMES, 'joint1', 'a list of strings'),
    (NAMES, ['a', 1], 'a list in which every element is a string'),
])
def test_bad_values_are_told_what_is_expected(parameter, value, expected):
    assert value_problem(parameter, value, {'joints': 2}) == expected


def test_an_unknown_length_is_not_checked():
    assert value_problem(GAINS, [1.0] * 9, {}) is None


def test_arrays_as_ros_gives_them_are_accepted():
    from array import array
    assert value_problem(GAINS, array('d', [1.0, 2.0]), {'joints': 2}) is None


def test_defaults_fill_what_is_not_given():
    values = validated(TABLE, {'gain': 2.0}, 'node', {'joints': 2})
    assert values == {**{p.name: p.default for p in TABLE}, 'gain': 2.0}


def test_an_unknown_name_lists_the_known_ones_and_a_close_one():
    with pytest.raises(ParameterError, match=r"'node\.filter\.gain' is 2\.0.*no such parameter "
                                             r'\(did you mean gain\?\); known: count, flag'):
        validated(TABLE, {'filter.gain': 2.0}, 'node')


def test_the_message_names_parameter_value_and_expectation():
    with pytest.raises(ParameterError) as caught:
        validated(TABLE, {'gain': 11.0}, 'node')
    error = caught.value
    assert (error.name, error.value, error.expected) == ('node.gain', 11.0, '>= 0 and <= 10 N*m')
    assert str(error) == "parameter 'node.gain' is 11.0: expected >= 0 and <= 10 N*m"


def test_per_joint_names_are_expanded():
    table = (Parameter(f'reference.{JOINT}.offset', 'double', 0.5, 'Centre.', 'rad'), GAIN)
    expanded = per_joint(table, ['elbow', 'wrist'])
    assert list(expanded) == ['reference.elbow.offset', 'reference.wrist.offset', 'gain']
    assert expanded['reference.wrist.offset'].unit == 'rad'
    assert expanded['reference.wrist.offset'].default == 0.5


def test_one_element_stands_for_all():
    np.testing.assert_array_equal(broadcast([2.0], 3), [2.0, 2.0, 2.0])
    np.testing.assert_array_equal(broadcast([1.0, 2.0], 2), [1.0, 2.0])
    assert broadcast([1.0, 2.0], 3).shape == (2,)


@pytest.mark.parametrize(('node', 'parameter'), ALL)
def test_every_declared_default_is_accepted_by_its_own_declaration(node, parameter):
    sizes = {'joints': 2, 'parameters': 5}
    assert value_problem(parameter.named('joint1'), parameter.default, sizes) is None


@pytest.mark.parametrize(('node', 'parameter'), ALL)
def test_every_declaration_says_what_it_is(node, parameter):
    assert parameter.description.endswith('.')
    assert parameter.name == parameter.name.lower()
    assert parameter.minimum is None or parameter.maximum is None \
        or parameter.minimum < parameter.maximum


@pytest.mark.parametrize('node', TABLES)
def test_names_are_declared_once(node):
    names = [parameter.name for parameter in TABLES[node]]
    assert len(names) == len(set(names))


def test_everything_about_learning_is_live():
    structure = {'initial_estimate', 'initial_estimate_file', 'resume_within', 'estimate_file',
                 'filter.state_filter', 'history.selection', 'change.monitor'}
    learning = {p.name: p for p in TABLES['identifier']
                if p.name.split('.')[0] in ('gamma', 'kt', 'kh', 'filter', 'change', 'history',
                                            'excitation', 'update_law', 'estimate_file',
                                            'estimate_period', *structure)}
    assert len(learning) == 32
    assert {name for name, p in learning.items() if p.read_only} == structure


@pytest.mark.parametrize('name', ['filter.time_constant', 'filter.gap', 'filter.settle',
                                  'filter.state_time_constant', 'change.window',
                                  'change.threshold', 'change.resolution', 'history.epsilon',
                                  'history.minimum_growth', 'history.noise',
                                  'excitation.window', 'estimate_period', 'resume_within'])
def test_settings_of_the_identifier_have_an_upper_end(name):
    parameter = {p.name: p for p in TABLES['identifier']}[name]
    assert value_problem(parameter, parameter.maximum, {}) is None
    assert value_problem(parameter, 1.001 * parameter.maximum, {}) == parameter.range_text()
