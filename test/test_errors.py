# SPDX-License-Identifier: Apache-2.0
"""Facts about what messages say of names and values."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.errors import close_names, ParameterError, UnknownParameter

KNOWN = ['identifier.history.size', 'identifier.history.noise', 'controller.k1', 'controller.k2',
         'controller.safety.upper', 'controller.performance.upper', 'joints', 'gravity']


@pytest.mark.parametrize(('written', 'meant'), [
    ('k22', ['controller.k2']), ('controller__k2', ['controller.k2']),
    ('contoller.k2', ['controller.k2']), ('identifier.k2', ['controller.k2']),
    ('historysize', ['identifier.history.size']), ('size', ['identifier.history.size']),
    ('History.Size', ['identifier.history.size']), ('controller.safty.upper',
                                                    ['controller.safety.upper']),
    ('joint', ['joints']), ('colour', []), ('', [])])
def test_a_name_is_suggested_where_one_is_close(written, meant):
    assert close_names(written, KNOWN)[:1] == meant


def test_more_names_than_a_message_can_list_are_counted():
    text = str(UnknownParameter('colour', 1.0, [f'p{k}' for k in range(300)]))
    assert 'parameters lists all 300' in text
    assert 'p17' not in text


def test_a_suggestion_takes_the_place_of_a_long_list():
    assert 'gravity' not in str(UnknownParameter('k22', 1.0, [*KNOWN, 'a', 'b']))
    assert 'gravity' in str(UnknownParameter('colour', 1.0, [*KNOWN, 'a', 'b']))


@pytest.mark.parametrize(('value', 'shown'), [
    (np.arange(3000.0).reshape(1000, 3),
     'an array of shape (1000, 3), 0.0, 1.0 ... 2999.0'),
    (list(range(50)), 'a list of 50 elements, 0, 1 ... 49'),
    ([[0.5]] * 20, 'a list of 20 elements, [0.5], [0.5] ... [0.5]'),
    ([1.0, 2.0], '[1.0, 2.0]'), (np.zeros(2), 'array([0., 0.])'), ('x', "'x'")])
def test_a_message_shows_of_a_long_array_its_shape_and_ends(value, shown):
    assert str(ParameterError('q', value, 'less')) == f"parameter 'q' is {shown}: expected less"
