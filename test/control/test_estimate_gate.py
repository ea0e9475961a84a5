# SPDX-License-Identifier: Apache-2.0
"""Facts about which estimates a controller uses, and when."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.control.estimate_gate import EstimateGate

FIRST = np.array([1.0, 2.0])
GOOD = np.array([3.0, -4.0])


def gate() -> EstimateGate:
    return EstimateGate(('mass', 'friction'), FIRST, np.array([10.0, 5.0]))


def test_an_estimate_up_to_the_limit_is_used_at_once():
    subject = gate()
    edge = np.array([-10.0, 5.0])
    assert subject.offer(edge) is None
    assert subject.theta is edge


@pytest.mark.parametrize(('theta', 'reason', 'detail', 'fault'), [
    ([np.nan, 1.0], 'non-finite estimate', 'the last one is kept', False),
    ([1.0, np.inf], 'non-finite estimate', 'the last one is kept', False),
    ([1.0, -7.5], 'estimate beyond its limit',
     'friction = -7.5 is beyond estimate_limit 5: the last estimate is kept', True),
    ([10.5, -7.5], 'estimate beyond its limit',
     'friction = -7.5 is beyond estimate_limit 5: the last estimate is kept', True),
    ([10.5, 1.0], 'estimate beyond its limit',  # one of them is enough
     'mass = 10.5 is beyond estimate_limit 10: the last estimate is kept', True)])
def test_an_estimate_that_cannot_be_trusted_leaves_the_last_one(theta, reason, detail, fault):
    subject = gate()
    assert subject.offer(np.array(theta)) == (reason, detail, fault)
    assert subject.theta is FIRST


def test_an_estimate_has_to_be_finite_where_it_has_no_limit():
    subject = gate()
    subject.limit = np.full(2, np.inf)
    assert subject.offer(np.array([-1e300, 1e300])) is None
    assert subject.offer(np.array([1.0, -np.inf])).reason == 'non-finite estimate'


def test_in_lockstep_an_estimate_waits_for_the_state_after_its_own():
    subject = gate()
    assert not subject.use_after(100)
    subject.offer_after(100, GOOD)
    assert subject.theta is FIRST
    assert not subject.use_after(99)
    assert subject.use_after(100)
    assert subject.theta is GOOD


def test_in_lockstep_a_refused_estimate_lets_its_state_be_answered_with_the_last_one():
    subject = gate()
    assert subject.offer_after(100, np.array([np.nan, 0.0])) is not None
    assert subject.use_after(100)
    assert subject.theta is FIRST


def test_in_lockstep_only_a_few_estimates_are_kept():
    subject = gate()
    for stamp in range(10):
        subject.offer_after(stamp, GOOD)
    assert [stamp for stamp in range(10) if subject.use_after(stamp)] == [6, 7, 8, 9]


def test_in_lockstep_each_state_is_answered_with_its_own_estimate_and_no_other():
    subject, other = gate(), np.array([1.0, 1.0])
    subject.offer_after(100, GOOD)
    subject.offer_after(200, other)
    assert subject.use_after(200)
    assert subject.theta is other
    assert not subject.use_after(150)
    assert subject.theta is other
