# SPDX-License-Identifier: Apache-2.0
"""Facts about who watches the set of θ*: when it is narrowed, and when it is the prior again."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.identification.history_stack import HistoryStack
from adaptive_blf_control.limits.prior import prior_of
from adaptive_blf_control.limits.set_estimator import SetEstimator

ARM = TwoLinkArm()
DELTA = np.array([0.3, 0.1])


class Recorded:
    """What is looked at of an identifier; a test adds pairs and says what was found."""

    def __init__(self, count: int = 12, theta: np.ndarray | None = None) -> None:
        self.stack = HistoryStack(ARM.n, ARM.m, 20, 0.01)
        self.response = 'quiet'
        self.found = {'alarms': 0, 'contacts': 0, 'loads': 0, 'changes': 0}
        self.random = np.random.default_rng(1)
        self.record(count, theta)

    def record(self, count: int, theta: np.ndarray | None = None) -> None:
        for _ in range(count):
            regressor = ARM.X(*self.random.normal(size=(4, 2)))
            self.stack.offer(regressor, regressor @ (ARM.nominal if theta is None else theta))


@pytest.fixture(name='estimator')
def _estimator() -> SetEstimator:
    return SetEstimator(prior_of(ARM, mass_error=0.3), DELTA, 0.1)


def width(estimator: SetEstimator) -> float:
    """Return the widest interval, of that of the prior."""
    return float((estimator.intervals.most - estimator.intervals.least).max()) / 2.0


def looked(estimator: SetEstimator, identifier: Any, times: int = 6, begin: float = 0.0) -> float:
    """Look some times, and return the widest interval."""
    for k in range(times):
        identifier.stack.offer(*_one_more(identifier))
        assert estimator.observe(begin + 0.125 * k, identifier)
    return width(estimator)


def _one_more(identifier: Any) -> tuple[np.ndarray, np.ndarray]:
    regressor = ARM.X(*3.0 * identifier.random.normal(size=(4, 2)))
    return regressor, regressor @ ARM.nominal


def test_pairs_narrow_both_sets_every_period(estimator):
    identifier = Recorded()
    assert estimator.observe(0.0, identifier)
    assert not estimator.observe(0.05, identifier)
    assert looked(estimator, identifier, begin=0.1) < 0.9
    assert estimator.ellipsoid.centre is not estimator.ellipsoid.prior.centre
    assert estimator.observe(-5.0, identifier)  # a clock that was set back


@pytest.mark.parametrize('response', ['doubt', 'held', 'loaded'])
def test_a_doubt_gives_the_prior_back_until_it_is_over(estimator, response):
    identifier = Recorded()
    assert looked(estimator, identifier) < 0.9
    identifier.response = response
    assert looked(estimator, identifier, 1, 1.0) == 1.0
    assert estimator.ellipsoid.centre is estimator.ellipsoid.prior.centre
    identifier.response = 'quiet'
    assert looked(estimator, identifier, begin=2.0) < 0.9


def test_pairs_that_an_estimated_load_has_moved_say_nothing_until_they_are_forgotten(estimator):
    identifier = Recorded()
    assert looked(estimator, identifier) < 0.9
    identifier.found = {**identifier.found, 'alarms': 1, 'loads': 1}
    assert looked(estimator, identifier, begin=1.0) == 1.0
    identifier.stack.clear()
    identifier.record(12)
    assert looked(estimator, identifier, begin=2.0) < 0.9


def test_an_event_between_two_looks_is_not_missed(estimator):
    identifier = Recorded()
    assert looked(estimator, identifier) < 0.9
    identifier.found = {**identifier.found, 'alarms': 1, 'contacts': 1}
    assert looked(estimator, identifier, 1, 1.0) == 1.0


def test_a_history_that_was_emptied_and_filled_between_two_looks_is_a_new_one(estimator):
    identifier = Recorded(6)
    assert looked(estimator, identifier) < 0.9
    identifier.stack.clear()
    identifier.record(15, 1.2 * ARM.nominal)
    assert estimator.observe(1.0, identifier)
    assert width(estimator) == 1.0
    for k in range(8):
        identifier.record(1, 1.2 * ARM.nominal)
        estimator.observe(2.0 + k, identifier)
    assert estimator.falsified == 0
    assert estimator.intervals.least.max() > 0.0  # 1.2 of the nominal ones


def test_what_contradicts_the_prior_is_counted_and_nothing_is_believed_until_it_is_forgotten(
        estimator):
    identifier = Recorded(12, 2.0 * ARM.nominal)
    assert estimator.observe(0.0, identifier)
    assert estimator.falsified == 1
    assert looked(estimator, identifier, begin=1.0) == 1.0
    assert estimator.falsified == 1
    identifier.stack.clear()
    identifier.record(12)
    assert looked(estimator, identifier, begin=2.0) < 0.9


def test_pairs_with_artificial_noise_say_nothing(estimator):
    identifier = Recorded()
    identifier.artificial_noise = True
    assert looked(estimator, identifier) == 1.0


def test_an_identifier_of_ones_own_needs_a_stack_only(estimator):
    recorded = Recorded()
    alone = SimpleNamespace(stack=recorded.stack, random=recorded.random)
    assert looked(estimator, alone) < 0.9
