# SPDX-License-Identifier: Apache-2.0
"""Facts about the times of recorded pairs."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.identification.identifier import Identifier
from adaptive_blf_control.identification.pair_times import PairTimes


def identifier(size: int) -> Identifier:
    return Identifier(TwoLinkArm(), kt=0.0, kh=0.0, filter={'time_constant': 0.02},
                      change={'window': 0.0}, history={'size': size})


@pytest.mark.parametrize('size', [10, 30])
def test_every_recorded_pair_has_the_time_it_was_taken_at(record: Callable[..., list],
                                                          size: int) -> None:
    learner, seen, taken = identifier(size), PairTimes(), {}
    for sample in record(3000):
        before = learner.stack.insertions
        learner.update(*sample)
        seen.observe(sample.t, learner)
        if learner.stack.insertions > before:
            taken[learner.pair[1].tobytes()] = sample.t
    stack = learner.stack
    assert stack.insertions > stack.count == size  # pairs were replaced
    assert seen.times(stack).tolist() == [taken[row.tobytes()] for row in stack.torques]


def test_a_pair_that_was_not_seen_has_no_time(record: Callable[..., list]) -> None:
    learner, seen = identifier(30), PairTimes()
    for i, sample in enumerate(record(1500)):
        learner.update(*sample)
        if i > 600:
            seen.observe(sample.t, learner)
    times = seen.times(learner.stack)
    assert np.isnan(times).any()
    assert np.nanmin(times) > 0.6


def test_a_history_that_was_emptied_starts_again(record: Callable[..., list]) -> None:
    learner, seen = identifier(30), PairTimes()
    for i, sample in enumerate(record(3000)):
        if i == 1500:
            learner.reset_history()
        learner.update(*sample)
        seen.observe(sample.t, learner)
    assert np.nanmin(seen.times(learner.stack)) >= 1.5


def test_what_is_recorded_is_a_copy_that_stays(record: Callable[..., list]) -> None:
    learner, seen = identifier(10), PairTimes()
    for sample in record(1500):
        learner.update(*sample)
        seen.observe(sample.t, learner)
    recorded = seen.recorded(learner)
    before = [part.copy() for part in recorded[:3]]
    assert recorded.regressors.shape == (10, 2, 5)
    assert recorded.memory == learner.memory
    learner.reset_history()
    for part, expected in zip(recorded[:3], before, strict=True):
        np.testing.assert_array_equal(part, expected)
