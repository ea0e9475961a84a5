# SPDX-License-Identifier: Apache-2.0
"""Loops that are joined by hand: what does not fit together or cannot begin is refused."""

from __future__ import annotations

import numpy as np
import pytest

import adaptive_blf_control as door

ARM = door.TwoLinkArm()
SWING = {'amplitude': 0.3, 'frequency': 2.0}


class Moved(door.Plant):
    """The arm of a user's own, at a posture that they choose."""

    def __init__(self, q):
        """Begin there, at rest."""
        self.q, self.qd, self.torque = np.array(q, dtype=float), np.zeros(2), np.zeros(2)
        self._dynamics = ARM.dynamics(ARM.nominal)

    def advance(self, dt):
        """Move on."""
        self.q, self.qd = self._dynamics.advance(self.q, self.qd, self.torque, dt)


def controller(**changes):
    return door.Controller(ARM, k2=[30.0, 10.0], torque_limit=100.0, safety=(-1.0, 1.0),
                           performance=(-0.1, 0.1),
                           reference={'joint1': SWING, 'joint2': SWING}, **changes)


@pytest.mark.parametrize('run', [lambda loop: loop.run(0.01), door.simulate,
                                 lambda loop: next(loop.samples(0.01))],
                         ids=['run', 'simulate', 'samples'])
def test_a_loop_whose_plant_is_outside_the_performance_set_does_not_start(run):
    loop = door.ClosedLoop(Moved([0.5, 0.0]), controller(start=[0.0, 0.0]))
    with pytest.raises(door.SetViolation, match=r"'joint1'.*start error outside the performance "
                       r'set: 0\.5 rad against 0\.1 rad: .*start=.*begin\(q, qd\)'):
        run(loop)
    loop.controller.begin(loop.plant.q, loop.plant.qd)
    assert door.simulate(loop, 0.5).kept


def test_a_second_run_begins_where_the_plant_has_got_to_or_is_refused():
    loop = door.ClosedLoop(Moved([0.0, 0.0]), controller(start=[0.0, 0.0]))
    loop.run(0.3)
    loop.plant.q = np.array([0.0, 0.4])
    with pytest.raises(door.SetViolation, match="'joint2'.*start error"):
        loop.run(0.3)
    loop.plant.q = np.array([0.0, 1.4])
    with pytest.raises(door.SetViolation, match="'joint2'.*start position outside the safety"):
        loop.run(0.3)


@pytest.mark.parametrize('duration', [-1.0, np.nan, np.inf, '1', None])
def test_a_loop_runs_for_no_time_that_is_none(duration):
    loop = door.ClosedLoop(Moved([0.0, 0.0]), controller(start=[0.0, 0.0]))
    for call in (loop.run, lambda time: list(loop.samples(time))):
        with pytest.raises(door.ParameterError, match="'duration' is .*expected a time >= 0 s"):
            call(duration)
