# SPDX-License-Identifier: Apache-2.0
"""Facts about chatter, saturation, reserve, and joints that oscillate inside their sets."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.runs.torque_use import (
    oscillation_text,
    oscillations,
    torque_figures,
    torque_table,
    TorqueUse,
)

T = np.arange(0.0, 8.0, 1e-3)
LOWER, UPPER = np.array([-0.2, -0.1]), np.array([0.2, 0.1])


def test_chatter_saturation_and_reserve_are_those_of_the_commands() -> None:
    torque = np.column_stack([np.full(T.size, 2.0), np.where(np.arange(T.size) % 2, 1.0, -1.0)])
    torque[:800, 0] = -10.0
    figures = torque_figures(TorqueUse(torque, np.array([10.0, 4.0])))
    assert figures['chatter'] == pytest.approx([0.0, 2.0])
    assert figures['saturated'] == pytest.approx([0.1, 0.0])
    assert figures['torque_reserve'] == pytest.approx([0.0, 0.75])
    lines = torque_table({'joints': ['a', 'b'], **figures})
    assert [line.split() for line in lines[2:]] == [['a', '0.00e+00', '10.00', '0'],
                                                    ['b', '2.00e+00', '0.00', '75']]


def test_columns_stand_below_their_names_however_long_a_joint_is_called() -> None:
    figures = torque_figures(TorqueUse(np.ones((T.size, 2)), np.ones(2)))
    _, head, *rows = torque_table({'joints': ['a', 'shoulder_lift_joint_of_arm'], **figures})
    end = head.index('reserve [%]') + len('reserve [%]')
    assert [len(row) for row in rows] == [end, end]


def test_without_commands_nothing_is_said() -> None:
    figures = torque_figures(None)
    assert set(figures.values()) == {None}
    assert torque_table({'joints': ['a'], **figures}) == []
    alone = torque_figures(TorqueUse(np.zeros((1, 2)), np.ones(2)))
    assert alone['chatter'] is None


@pytest.mark.parametrize(('frequency', 'size', 'found'), [
    (40.0, 0.05, True), (100.0, 0.15, True), (4.0, 0.15, False), (40.0, 0.004, False)])
def test_a_joint_oscillates_where_its_error_is_large_and_faster_than_any_reference(
        frequency: float, size: float, found: bool) -> None:
    e1 = np.column_stack([0.1 + size * np.sin(frequency * T), 0.05 * np.sin(T)])
    fast, slow = oscillations(T, e1, LOWER, UPPER)
    assert slow is None
    assert fast == (pytest.approx(frequency, rel=0.02) if found else None)
    text = oscillation_text({'joints': ['wrist', 'base'], 'oscillation': [fast, slow]})
    assert text == (f'wrist oscillates with {fast:.0f} rad/s' if found else '')


def test_an_oscillation_that_has_died_out_is_none() -> None:
    e1 = (0.1 * np.exp(-T) * np.sin(40.0 * T))[:, None]
    assert oscillations(T, e1, LOWER[:1], UPPER[:1]) == [None]
