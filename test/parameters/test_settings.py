# SPDX-License-Identifier: Apache-2.0
"""Facts about settings: typed, frozen, compared by value, refused when they cannot be used."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from adaptive_blf_control.configuration.node_settings import NODE_SETTINGS, TABLES
from adaptive_blf_control.control.settings import ControllerSettings
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.settings import HistorySettings, IdentifierSettings
from adaptive_blf_control.parameters.settings import changed_names


@pytest.mark.parametrize('node', NODE_SETTINGS)
def test_the_path_of_every_attribute_is_the_name_of_its_parameter(node):
    settings = NODE_SETTINGS[node]()
    for parameter in TABLES[node]:
        value = settings
        for part in parameter.name.split('.'):
            if part == '<joint>':  # a mapping by joint, empty here
                break
            value = getattr(value, part)
        else:
            assert settings.values()[parameter.name] == parameter.default
            assert np.array_equal(value, parameter.default) or tuple(value) == tuple(
                parameter.default)


@pytest.mark.parametrize('node', NODE_SETTINGS)
def test_values_come_back_as_the_same_settings(node):
    settings = NODE_SETTINGS[node]()
    assert NODE_SETTINGS[node].from_values(settings.values()) == settings


def test_settings_of_a_joint_come_back_by_its_name():
    settings = ControllerSettings(reference={'of_joint': {'elbow': {'amplitude': [0.1, 0.2]}}})
    values = settings.values()
    assert values['reference.elbow.amplitude'] == [0.1, 0.2]
    assert ControllerSettings.from_values(values) == settings


def test_equal_values_are_equal_settings_with_equal_hashes():
    first, second = IdentifierSettings(gamma=[1, 2]), IdentifierSettings(gamma=np.array([1., 2.]))
    assert first == second
    assert hash(first) == hash(second)
    assert first != IdentifierSettings(gamma=[1.0, 3.0])
    assert first != HistorySettings()
    assert len({first, second}) == 1


def test_neither_a_field_nor_an_array_can_be_written():
    settings = IdentifierSettings()
    with pytest.raises(dataclasses.FrozenInstanceError):
        settings.kt = 3.0
    with pytest.raises(ValueError, match='read-only'):
        settings.gamma[0] = 3.0


def test_a_list_that_was_given_can_be_changed_afterwards_without_effect():
    gamma = np.array([1.0, 2.0])
    settings = IdentifierSettings(gamma=gamma)
    gamma[0] = 9.0
    assert settings.gamma.tolist() == [1.0, 2.0]


@pytest.mark.parametrize(('given', 'expected'), [
    (3, [3.0]), (3.5, [3.5]), ([1, 2], [1.0, 2.0]), (np.float32(0.5), [0.5]),
    (np.array([1, 2], dtype=np.float32), [1.0, 2.0]), ((1.0, 2.0), [1.0, 2.0])])
def test_arrays_take_scalars_lists_tuples_and_float32(given, expected):
    gamma = IdentifierSettings(gamma=given).gamma
    assert gamma.tolist() == expected
    assert gamma.dtype == np.float64


def test_numbers_take_integers_and_numpy_scalars():
    settings = IdentifierSettings(kt=3, kh=np.float32(0.5), history={'size': np.int64(7)})
    assert (settings.kt, settings.kh, settings.history.size) == (3.0, 0.5, 7)


@pytest.mark.parametrize(('make', 'message'), [
    (lambda: IdentifierSettings(kt=-1.0), r"'identifier\.kt' is -1\.0: expected >= 0"),
    (lambda: IdentifierSettings(kt='fast'), r"'identifier\.kt' is 'fast': expected a floating"),
    (lambda: IdentifierSettings(gamma=[1.0, float('nan')]), r'identifier\.gamma.*not NaN'),
    (lambda: IdentifierSettings(gamma='many'), r"identifier\.gamma' is 'many'.*list of doubles"),
    (lambda: HistorySettings(size=0), r'identifier\.history\.size.*>= 1'),
    (lambda: HistorySettings(size=2.5), r'identifier\.history\.size.*an integer'),
    (lambda: IdentifierSettings(update_law='guess'), r"update_law' is 'guess'.*one of gradient"),
    (lambda: IdentifierSettings(history=3), r"identifier\.history' is 3.*HistorySettings"),
    (lambda: IdentifierSettings(filter={'state_order': 1}), r'state_order.*at least 2')])
def test_a_value_that_cannot_be_used_is_refused_when_it_is_given(make, message):
    with pytest.raises(ParameterError, match=message):
        make()


def test_replace_takes_dotted_names_and_leaves_the_rest():
    before = IdentifierSettings(kt=3.0)
    after = before.replace(**{'history.size': 30, 'kh': 5})
    assert (after.kt, after.kh, after.history.size) == (3.0, 5.0, 30)
    assert before.history.size == 20
    assert changed_names(before, after) == {'history.size', 'kh'}
    with pytest.raises(ParameterError, match=r"'identifier\.history\.sise'.*no such parameter"):
        before.replace(**{'history.sise': 30})


def test_resolved_gives_every_array_its_full_length():
    settings = ControllerSettings(k1=[40.0, 30.0], k2=5.0).resolved(joints=2)
    assert settings.k1.tolist() == [40.0, 30.0]
    assert settings.k2.tolist() == [5.0, 5.0]
    assert settings.safety.lower.tolist() == [-3.14, -3.14]
    assert settings.resolved(joints=2) is settings
    with pytest.raises(ParameterError, match=r'controller\.k1.*length 1 or 3'):
        settings.resolved(joints=3)


def test_the_text_of_settings_shows_what_differs_from_the_defaults():
    text = repr(IdentifierSettings(kt=3.0, history=HistorySettings(size=30)))
    assert text == 'IdentifierSettings(kt=3.0, history=HistorySettings(size=30))'
