# SPDX-License-Identifier: Apache-2.0
"""Facts about the response to a contradiction: contact, load, and another arm are told apart."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.change_monitor import ResidualMonitor
from adaptive_blf_control.identification.change_response import (
    ADAPT,
    ALARMS,
    CONTACTS,
    FORGET,
    KEEP,
    KNOWN,
    LEARN,
    LOADS,
    new_response,
    QUIET,
    RECALL,
    remembered,
    REMEMBERS,
    respond,
    retreat,
    STATE,
)
from adaptive_blf_control.identification.history_stack import HistoryStack
from adaptive_blf_control.identification.identifier import Identifier


@pytest.fixture(autouse=True)
def foreign(monkeypatch) -> None:
    """Let parameters name the foreign parts beside this file."""
    monkeypatch.syspath_prepend(str(Path(__file__).parent))


DT, NOISE = 1e-3, 0.05
TRUE = np.array([3.0, -1.0, 0.5, 2.0])
LOAD = np.array([[1.0], [0.5], [0.0], [0.0]])


class Subject:
    """A response beside 60 pairs of the true arm; each ``feed`` is one pair of an arm."""

    def __init__(self, **settings) -> None:
        self.random = np.random.default_rng(4)
        self.stack = HistoryStack(2, 4, 60, 0.0, 0.05)
        self.theta = TRUE.copy()
        for _ in range(800):  # then few pairs make it better
            self.stack.offer(*self._pair(TRUE, 0.0))
        self.monitor = ResidualMonitor(2, 4, 0.1, 25.0, 0.0)
        self.response = new_response(2, 4, LOAD)._replace(
            suspicion=2.0, memory=0.02, settling=0.05, patience=2.0)._replace(**settings)
        self.response.clock[KNOWN] = 1.0  # what is ordinary has been seen

    def _pair(self, theta, push):
        regressor = self.random.normal(size=(2, 4))
        return regressor, regressor @ theta + push + NOISE * self.random.normal(size=2)

    def feed(self, theta, push=0.0, settled=True) -> int:
        regressor, torque = self._pair(theta, push)
        verdict = respond(self.response, self.monitor.arrays, self.stack.pairs, self.theta, DT,
                          regressor, torque, settled)
        if verdict == LEARN:
            self.stack.offer(regressor, torque)
        return verdict

    def count(self, name) -> int:
        return int(self.response.counts[name])


def test_what_contradicts_the_recorded_pairs_does_not_come_among_them():
    subject = Subject()
    changed = TRUE + [0.0, 0.0, 0.0, 0.25]  # a mean of d² between suspicion and threshold
    for _ in range(200):
        subject.feed(changed)
    before = subject.stack.insertions
    verdicts = {subject.feed(changed) for _ in range(300)}
    assert verdicts == {RECALL}
    assert subject.stack.insertions == before
    assert 2.0 < subject.monitor.statistic.max() < 25.0


def test_a_doubt_that_comes_to_nothing_is_given_up():
    subject = Subject()
    changed = TRUE + [0.0, 0.0, 0.0, 0.25]
    verdicts = [subject.feed(changed) for _ in range(3500)]
    assert verdicts[500] == RECALL
    assert LEARN in verdicts[2200:]
    assert subject.count(ALARMS) == 0


def test_a_load_is_found_and_corrects_the_recorded_pairs():
    subject = Subject()
    loaded = TRUE + 2.0 * LOAD[:, 0]
    verdicts = [subject.feed(loaded) for _ in range(1500)]
    assert verdicts.index(KEEP) < 20
    assert verdicts[-1] == LEARN
    assert FORGET not in verdicts
    assert (subject.count(ALARMS), subject.count(LOADS), subject.count(STATE)) == (1, 1, QUIET)
    fitted = np.linalg.solve(subject.stack.gram, subject.stack.moment)
    np.testing.assert_allclose(fitted, loaded, atol=0.05)
    np.testing.assert_allclose(subject.theta, loaded, atol=0.05)
    for _ in range(1500):  # and when it is gone
        subject.feed(TRUE)
    assert subject.count(LOADS) == 2
    np.testing.assert_allclose(subject.theta, TRUE, atol=0.05)


def test_a_load_that_predicts_the_pairs_at_once_is_confirmed_after_little_more_than_3_windows():
    subject = Subject()
    loaded = TRUE + 2.0 * LOAD[:, 0]
    verdicts = [subject.feed(loaded) for _ in range(600)]
    alarm = verdicts.index(KEEP)
    known = verdicts.index(RECALL, alarm)
    confirmed = round(3.0 * subject.monitor.arrays.window / DT)
    settled = round(subject.response.settling / DT)
    assert settled + confirmed < known - alarm < settled + 1.5 * confirmed


def test_a_push_is_no_load_and_leaves_everything_as_it_was():
    subject = Subject()
    regressors, torques = subject.stack.regressors.copy(), subject.stack.torques.copy()
    verdicts = [subject.feed(TRUE, push=np.array([3.0 + np.sin(0.01 * k), -4.0]))
                for k in range(1000)]
    assert verdicts.index(KEEP) < 20
    assert verdicts[-1] == KEEP
    np.testing.assert_array_equal(subject.stack.regressors, regressors)
    subject.theta += 0.3  # as Xᵀe2 may have moved it
    verdicts = [subject.feed(TRUE) for _ in range(1200)]
    assert (subject.count(CONTACTS), subject.count(LOADS)) == (1, 0)
    released = verdicts.index(LEARN)
    assert released < 1000
    np.testing.assert_array_equal(subject.theta, TRUE)
    assert np.abs(subject.stack.torques - torques).max() < 20.0  # none from the time of the push


def test_another_arm_is_learned_from_the_beginning_beside_a_part_of_what_was_known():
    subject = Subject()
    other = TRUE + [0.0, 0.0, 2.0, 0.0]
    verdicts = [subject.feed(other) for _ in range(2100)]
    assert verdicts.index(FORGET) == pytest.approx(2000, abs=30)
    gram, theta = subject.stack.gram.copy(), subject.theta.copy()
    retreat(subject.response, subject.monitor.arrays, subject.stack.pairs, subject.theta)
    np.testing.assert_array_equal(subject.theta, theta)
    left, moment = remembered(subject.response, np.zeros((4, 4)), np.zeros(4))
    np.testing.assert_allclose(left, 0.01 * gram)
    np.testing.assert_allclose(np.linalg.solve(left, moment), theta)
    assert subject.count(REMEMBERS) == 1
    subject.stack.clear()
    subject.monitor.reset()
    for _ in range(800):
        subject.feed(other)
    assert subject.count(REMEMBERS) == 0  # the new pairs are as strong


def test_what_xt_e2_may_do_while_the_reason_is_not_known_is_a_setting():
    for adapts, expected in ((False, KEEP), (True, ADAPT)):
        subject = Subject(adapts=adapts)
        verdicts = [subject.feed(TRUE, push=np.array([5.0, 5.0])) for _ in range(100)]
        assert verdicts[-1] == expected


def test_a_load_that_is_expected_is_held_by_itself_before_it_is_confirmed():
    subject = Subject(adapts=True)
    loaded = TRUE + 2.0 * LOAD[:, 0]
    verdicts = [subject.feed(loaded) for _ in range(250)]
    assert ADAPT in verdicts
    assert verdicts[-1] == KEEP
    assert subject.count(LOADS) == 0
    np.testing.assert_allclose(subject.theta, loaded, atol=0.05)
    fitted = np.linalg.solve(subject.stack.gram, subject.stack.moment)
    np.testing.assert_allclose(fitted, TRUE, atol=0.05)  # the recorded pairs are as they were
    for _ in range(50):  # what does not predict is no load
        subject.feed(TRUE, push=np.array([50.0, -50.0]))
    np.testing.assert_array_equal(subject.theta, TRUE)


def test_nothing_is_learned_while_a_contact_is_known_of_and_the_filters_settle_after_it():
    subject = Subject()
    known = subject.response._replace(contact=True)
    subject.response, before = known, subject.response
    assert {subject.feed(TRUE, settled=False) for _ in range(10)} == {KEEP}
    assert {subject.feed(TRUE, push=np.ones(2)) for _ in range(10)} == {KEEP}
    subject.response = before
    verdicts = [subject.feed(TRUE) for _ in range(400)]
    assert 50 <= verdicts.index(LEARN) < 400
    assert subject.count(ALARMS) == 0


def test_settling_at_the_start_and_after_a_change_are_two_parameters():
    random = np.random.default_rng(0)
    for settle, longest in ((0.0, 1), (30.0, 40)):
        subject = Identifier(TwoLinkArm(), change_monitor='foreign_parts:Alarm',
                             filter={'settle': 0.0}, history={'epsilon': 0.0},
                             change={'settle': settle})
        counts = []
        for k in range(180):
            subject.update(1e-3 * k, *random.normal(size=(3, 2)))
            counts.append(subject.stack.count)
        assert counts[10] > 5
        first = counts.index(0, 50) if 0 in counts[50:] else 101
        refilled = next((k for k in range(first, 180) if counts[k] > 0), 180)
        assert refilled - first <= longest
        assert settle == 0.0 or refilled - first >= 29


def test_a_known_contact_teaches_nothing_beside_a_monitor_that_is_not_ours_either():
    random = np.random.default_rng(0)
    subject = Identifier(TwoLinkArm(), change_monitor='foreign_parts:Alarm', known_contact=True,
                         filter={'settle': 0.0}, history={'epsilon': 0.0},
                         change={'settle': 5.0})
    before = subject.theta.copy()
    for k in range(40):
        subject.update(1e-3 * k, *random.normal(size=(3, 2)), np.ones(subject.arm.m))
    np.testing.assert_array_equal(subject.theta, before)
    assert subject.stack.count == 0
    subject.retune(known_contact=False)
    counts = []
    for k in range(40, 100):
        subject.update(1e-3 * k, *random.normal(size=(3, 2)))
        counts.append(subject.stack.count)
    assert counts[3] == 0  # the filters still remember it
    assert counts[-1] > 0


def test_a_suspicion_above_the_threshold_is_refused_by_name():
    with pytest.raises(ParameterError, match=r'identifier\.change\.suspicion'):
        Identifier(TwoLinkArm(), change={'suspicion': 30.0})


def test_a_history_whose_rank_is_full_just_now_raises_no_alarm_about_what_it_has_not_seen():
    for seen, expected in ((0.0, 0), (1.0, 1)):
        subject = Subject()
        subject.response.clock[KNOWN] = seen
        for _ in range(300):  # six to seven standard deviations
            subject.feed(TRUE, push=np.array([0.5, 0.5]))
        assert subject.count(ALARMS) == expected
