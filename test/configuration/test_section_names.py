# SPDX-License-Identifier: Apache-2.0
"""Facts about which sections of a parameter file reach a node, as ROS has it."""

from __future__ import annotations

import pytest

from adaptive_blf_control.configuration.section_names import (
    check_sections_reach,
    reaches,
    unknown_sections,
)
from adaptive_blf_control.errors import ParameterError

NODES = ('/left/controller', '/controller', '/a/left/controller')


@pytest.mark.parametrize(('key', 'reached'), [  # what rclpy 7.1 does with each
    ('controller', (0, 1, 0)), ('/controller', (0, 1, 0)), ('/left/controller', (1, 0, 0)),
    ('left/controller', (1, 0, 0)), ('**/controller', (1, 1, 1)), ('/**/controller', (1, 1, 1)),
    ('/*/controller', (1, 0, 0)), ('/left/*', (1, 0, 0)), ('/**', (1, 1, 1)), ('*', (0, 1, 0)),
    ('/left/**', (1, 0, 0)), ('/**/left/controller', (1, 0, 1))])
def test_a_section_reaches_the_nodes_that_ros_gives_it_to(key, reached):
    assert tuple(reaches(key, node) for node in NODES) == tuple(map(bool, reached))


def test_all_but_stars_in_a_name_stands_for_itself():
    assert not reaches('/left.controller', '/left/controller')
    assert not reaches('/lef?/controller', '/left/controller')
    assert reaches('/left+/controller', '/left+/controller')


@pytest.mark.parametrize(('key', 'words'), [
    ('controller', '/left/controller'), ('/right/controller', '/\\*\\*/controller'),
    ('/**/controler', 'did you mean controller'), ('/**/identifer', 'did you mean identifier'),
    ('/**/arm-driver', 'did you mean arm_driver')])
def test_a_section_that_was_meant_and_reaches_nothing_is_an_error(key, words):
    with pytest.raises(ParameterError, match=words) as error:
        check_sections_reach(['/**', key], '/left/controller')
    assert key in str(error.value)


def test_one_file_may_have_a_section_for_each_of_several_namespaces():
    keys = ['/left/controller', '/right/controller']
    check_sections_reach(keys, '/left/controller')
    check_sections_reach(iter(['/**/controller', '/right/controller']), '/left/controller')
    with pytest.raises(ParameterError, match='/middle/controller'):
        check_sections_reach(keys, '/middle/controller')


def test_sections_of_other_nodes_are_left_to_them_and_foreign_ones_are_named():
    keys = ['/**', '/**/identifier', '/right/*', '/**/left/controller', '/**/gripper_driver']
    check_sections_reach(keys, '/left/controller')
    assert list(unknown_sections(keys, '/left/controller')) == ['/**/gripper_driver']
