# SPDX-License-Identifier: Apache-2.0
"""Facts about motions too fast for the state filter: they do not teach."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.identification.identifier import Identifier

ARM = TwoLinkArm()
ORDER, CONSTANT = 4, 0.01  # N and T [s]: at 5 rad/s half a per cent


def record(speed, steps=1500):
    """Return a log of joint 1 that turns with about ``speed`` [rad/s], joint 2 swings."""
    dynamics, t = ARM.dynamics(ARM.nominal), 0.0
    q, qd = np.zeros(2), np.array([speed, 0.0])
    rows = [(t, q, qd, np.zeros(2))]
    for k in range(1, steps):
        t = 1e-3 * k
        tau = np.array([5.3 * speed + 60.0 * (speed - qd[0]), 4.0 * np.cos(7.0 * t)])
        q, qd = dynamics.advance(q, qd, tau, 1e-3, 2)
        rows.append((t, q, qd, tau))
    return [np.array(column) for column in zip(*rows)]


def subject(distortion):
    return Identifier(ARM, filter={
        'time_constant': 0.02, 'state_order': ORDER, 'state_time_constant': CONSTANT,
        'distortion': distortion}, history={'size': 40}, change={'window': 0.0})


@pytest.mark.parametrize(('speed', 'taught'), [(4.0, True), (7.0, False)])
def test_a_motion_that_the_filter_distorts_does_not_teach(speed, taught):
    # N T² q̇²/2: 0.3 % at 4 rad/s, 1 % at 7 rad/s
    one = subject(distortion=0.006)
    one.learn(*record(speed))
    assert (one.stack.count > 0) is taught
    assert one.settled is taught


def test_without_a_limit_every_motion_teaches():
    one = subject(distortion=0.0)
    one.learn(*record(30.0))
    assert one.stack.count > 0


def test_a_fast_motion_is_remembered_as_long_as_the_torque_filter_remembers_it():
    one = subject(distortion=0.006)
    t, q, qd, tau = record(14.0)  # 4 %
    one.learn(t, q, qd, tau)
    last, rest = q[-1], np.zeros(2)
    settled = []
    for k in range(400):
        one.update(t[-1] + 1e-3 * (k + 1), last, rest, rest)
        settled.append(one.settled)
    first = settled.index(True)
    assert 0.02 < 1e-3 * first < 0.12  # ln(4/0.6) times 20 ms, and what the cascade takes
    assert all(settled[first:])
