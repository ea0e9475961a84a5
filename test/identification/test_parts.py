# SPDX-License-Identifier: Apache-2.0
"""State filter, history and change monitor as parts: named, passed in, swapped, refused."""

from __future__ import annotations

import importlib
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import adaptive_blf_control as door
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.history_stack import HistoryStack
from adaptive_blf_control.identification.identifier import Identifier

ARM = door.TwoLinkArm()
NAMES = {'filter.state_filter': 'foreign_parts:Smoothing',
         'history.selection': 'foreign_parts:LatestPairs',
         'change.monitor': 'foreign_parts:Alarm'}
BASE = {'kt': 100.0, 'kh': 100.0, 'history.size': 30, 'filter.settle': 1.0, 'change.settle': 1.0}


@pytest.fixture(autouse=True)
def foreign(monkeypatch) -> ModuleType:
    """Return the module of the parts, which parameters may name from now on."""
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    return importlib.import_module('foreign_parts')


def learn(subject: Identifier, samples) -> Identifier:
    for sample in samples:
        subject.update(*sample)
    return subject


def error_of(theta: np.ndarray) -> float:
    return float(np.linalg.norm(theta - ARM.nominal) / np.linalg.norm(ARM.nominal))


def test_parts_that_are_named_learn_together(record, foreign):
    subject = learn(Identifier(ARM, **{**BASE, **NAMES}), record(steps=1500))
    assert error_of(subject.theta) < 0.01
    stack, monitor = subject.stack, subject.monitor
    assert type(stack) is foreign.LatestPairs
    assert type(monitor) is foreign.Alarm
    assert monitor.watched == 1500 - 2 * 5  # the filters settle before and after the alarm
    assert monitor.resets == subject.changes == 1
    assert stack.insertions < 1400 / 10  # it was emptied at the alarm
    assert subject.memory == 0.001 + 0.005


@pytest.mark.parametrize('made', [False, True])
def test_a_state_filter_is_passed_in_as_a_class_or_an_object(record, foreign, made):
    part = foreign.Smoothing(ARM, None) if made else foreign.Smoothing
    subject = learn(Identifier(ARM, state_filter=part, **BASE), record(steps=50))
    named = learn(Identifier(ARM, state_filter='foreign_parts:Smoothing', **BASE),
                  record(steps=50))
    np.testing.assert_array_equal(subject.pair[0], named.pair[0])


def test_objects_that_are_passed_in_are_used_and_left_alone_by_the_warm_up(record, foreign):
    settings = door.IdentifierSettings()
    smoothing, alarm = foreign.Smoothing(ARM, settings), foreign.Alarm(ARM, settings)
    pairs = foreign.LatestPairs(ARM, settings)
    subject = Identifier(ARM, state_filter=smoothing, history_stack=pairs, change_monitor=alarm)
    subject.warm_up()
    assert (smoothing.samples, pairs.insertions, alarm.watched) == (0, 0, 0)
    learn(subject, record(steps=50))
    assert subject.stack is pairs
    assert subject.monitor is alarm
    assert smoothing.samples == 51
    assert pairs.insertions > 0


def test_parts_that_are_named_learn_in_the_closed_loop(repository, foreign):
    run = door.simulate(repository / 'config' / 'two_link.yaml', 3.0, identifier=dict(NAMES))
    assert run.kept
    assert type(run.identifier.stack) is foreign.LatestPairs
    assert run.identifier.changes == 1
    assert error_of(run.theta_hat[-1]) < 0.3 * error_of(run.theta_hat[0])


def test_a_retune_reaches_each_part(record):
    subject = learn(Identifier(ARM, **{**BASE, **NAMES}), record(steps=50))
    stack, monitor = subject.stack, subject.monitor
    subject.retune(subject.settings.replace(**{
        'history.size': 9, 'history.epsilon': 0.2, 'change.window': 0.3, 'kt': 1.0}))
    assert (subject.stack, subject.monitor) == (stack, monitor)
    assert stack.retuned[-1] == (9, 0.2, 0.0)
    assert monitor.retuned[-1] == (0.3, 25.0, 0.01)


def test_another_selection_is_offered_the_pairs_recorded_so_far(record):
    subject = learn(Identifier(ARM, **BASE), record(steps=300))
    count = subject.stack.count
    subject.retune(subject.settings.replace(**{'history.selection': NAMES['history.selection']}))
    assert subject.stack.insertions == count // 10
    subject.retune(subject.settings.replace(**{'history.selection': 'algorithm_1'}))
    assert type(subject.stack) is HistoryStack
    assert subject.stack.count == count // 10


def test_another_monitor_begins_without_a_statistic(record):
    subject = learn(Identifier(ARM, **BASE), record(steps=300))
    assert subject.monitor.statistic.any()
    subject.retune(subject.settings.replace(**{'change.monitor': NAMES['change.monitor']}))
    learn(subject, record(steps=301)[-1:])
    assert subject.monitor.watched == 1
    subject.retune(subject.settings.replace(**{'change.monitor': 'residual'}))
    assert not subject.monitor.statistic.any()


@pytest.mark.parametrize(('name', 'value', 'message'), [
    *((name, 'no_such_module:Part', 'ModuleNotFoundError') for name in NAMES),
    *((name, 'guess', f"{name}' is 'guess'.*module:name") for name in NAMES),
    ('filter.state_filter', 'foreign_parts:Nothing', 'Nothing has no update, reset, memory'),
    ('history.selection', 'foreign_parts:Nothing', 'Nothing has no offer, clear, retune'),
    ('change.monitor', 'foreign_parts:Nothing', 'Nothing has no watch, reset, retune')])
def test_a_part_that_is_not_there_is_named_and_a_retune_to_it_changes_nothing(name, value,
                                                                              message):
    with pytest.raises(ParameterError, match=message):
        Identifier(ARM, **{name: value})
    subject = Identifier(ARM)
    before = subject.settings
    with pytest.raises(ParameterError, match=message):
        subject.retune(before.replace(**{name: value, 'kt': 3.0}))
    assert subject.settings is before


@pytest.mark.parametrize(('changes', 'message'), [
    ({'state_filter': 'foreign_parts:Crooked'}, r'Crooked\.update.*shape \(2,\)'),
    ({'history_stack': 'foreign_parts:Flat'}, r'Flat\.gram.*shape \(5, 5\)')])
def test_what_a_part_returns_is_refused_where_it_has_another_shape(record, changes, message):
    with pytest.raises(ParameterError, match=message):
        learn(Identifier(ARM, **changes), record(steps=3))
