# SPDX-License-Identifier: Apache-2.0
"""Facts about joints at a position limit: a stop does not teach, what is beside it does."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.identification.identifier import Identifier

STOP = 0.6  # rad, of joint 1
MEMORY = 0.02  # s, of the torque filter


class ArmInPython(TwoLinkArm):
    """The same arm, whose regressors are methods alone."""

    def Y12(self, q, qd):
        return super().Y12(q, qd)


def limited(kind=TwoLinkArm):
    """Return an arm whose first joint has a limit."""
    arm = kind()
    arm.position_lower, arm.position_upper = np.array([-np.inf] * 2), np.array([STOP, np.inf])
    return arm


def stop_torque(q, qd):
    """Return what a stiff stop adds to joint 1 beyond its limit, shape (2,) [N·m]."""
    depth = max(q[0] - STOP, 0.0)
    return np.array([-(3e4 * depth + 100.0 * qd[0]) if depth > 0.0 else 0.0, 0.0])


def record(push, start, steps=3000):
    """Return a log in which ``push`` [N·m] is added at joint 1, from ``start`` [rad] on."""
    arm = TwoLinkArm()
    dynamics = arm.dynamics(arm.nominal)
    q, qd = np.array([start, 0.0]), np.zeros(2)
    rows = [(0.0, q, qd, np.zeros(2))]
    for k in range(1, steps):
        t = 1e-3 * k
        tau = np.array([push + 12.0 * np.sin(2.0 * t) + 5.0 * np.sin(9.0 * t),
                        3.0 * np.cos(4.0 * t) + np.cos(11.0 * t)])
        for _ in range(4):  # the stop answers within a sample
            q, qd = dynamics.advance(q, qd, tau + stop_torque(q, qd), 2.5e-4, 1)
        rows.append((t, q, qd, tau))
    return [np.array(column) for column in zip(*rows)]


def learned(arm, log, **changes):
    subject = Identifier(arm, kt=10.0, kh=1000.0, filter={'time_constant': MEMORY},
                         history={'size': 50}, change={'window': 0.0}, **changes)
    subject.learn(*log)
    return subject


@pytest.fixture(scope='module')
def swinging():
    """Return a log in which joint 1 is moved onto its stop and away from it again."""
    log = record(push=4.0, start=0.0)
    at = log[1][:, 0] > STOP - 0.01
    assert 0.2 < at.mean() < 0.8
    assert not at[0]
    assert not at[-1]
    return log


@pytest.mark.parametrize('kind', [TwoLinkArm, ArmInPython])
def test_the_torque_of_a_stop_does_not_come_into_the_estimate(swinging, kind):
    if kind is ArmInPython:
        swinging = [each[:1500] for each in swinging]
    arm = limited(kind)
    off = np.abs(learned(arm, swinging).theta - arm.nominal)
    believed = np.abs(learned(arm, swinging, position_limit_margin=-1.0).theta - arm.nominal)
    assert off.max() < 0.1 < 1.0 < believed.max()


def test_a_joint_beside_one_that_rests_on_its_stop_is_learned():
    arm = limited()
    log = record(push=60.0, start=STOP)
    assert (log[1][1:, 0] > STOP - 0.01).all()
    subject = learned(arm, log)
    assert subject.at_limit == len(log[0])
    assert subject.stack.count == 50
    assert not subject.stack.regressors[:, 0].any()
    assert not subject.stack.torques[:, 0].any()
    for name in ('p2', 'fv_joint2'):  # all that acts on joint 2 while joint 1 stands
        assert subject.estimate[name] == pytest.approx(
            arm.nominal[arm.parameters.index(name)], rel=0.02)


def test_nothing_is_learned_of_a_joint_until_the_filters_have_forgotten_its_stop():
    arm = limited()
    subject = Identifier(arm, filter={'time_constant': MEMORY, 'settle': 0.0},
                         change={'settle': 3.0, 'window': 0.0})
    rest, tau = np.zeros(2), np.array([1.0, 1.0])
    settled = []
    for k in range(1, 200):
        q = np.array([STOP - 0.005 if k <= 100 else 0.0, 0.1])
        subject.update(1e-3 * k, q, rest, tau)
        settled.append(subject.settled)
    assert not any(settled[:160])  # the last at the limit is the 100th, and 3 times 20 ms later
    assert all(settled[161:])
    assert subject.at_limit == 100


def test_the_adaptation_term_does_not_move_the_estimate_while_a_joint_is_at_its_limit():
    subject = Identifier(limited(), filter={'time_constant': MEMORY})
    rest, term = np.zeros(2), np.full(5, 10.0)
    for k in range(50):
        subject.update(1e-3 * k, np.array([STOP, 0.0]), rest, rest, term)
    assert not subject.theta.any()
    for k in range(50, 400):
        subject.update(1e-3 * k, rest, rest, rest, term)
    assert subject.theta.any()


def test_a_gap_in_the_samples_forgets_the_stop_with_the_filters():
    subject = Identifier(limited(), filter={'time_constant': MEMORY, 'settle': 0.0},
                         change={'settle': 1000.0})
    rest = np.zeros(2)
    subject.update(0.0, np.array([STOP, 0.0]), rest, rest)
    subject.update(1e-3, np.array([STOP, 0.0]), rest, rest)
    subject.update(2.0, rest, rest, rest)
    subject.update(2.001, rest, rest, rest)
    assert subject.settled


def test_an_arm_without_position_limits_has_no_joint_at_one(swinging):
    subject = learned(TwoLinkArm(), [each[:300] for each in swinging])
    assert subject.at_limit == 0
    assert subject.settled
