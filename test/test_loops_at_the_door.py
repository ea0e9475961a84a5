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


OTHER = door.TwoLinkArm(('joint2', 'joint1'))


class Renamed(door.TwoLinkArm):
    """The same joints with other parameters."""

    @property
    def parameters(self):
        """Name them in another order."""
        return ('p2', 'p1', 'p3', 'fv_joint1', 'fv_joint2')

    @parameters.setter
    def parameters(self, names):
        """Take none."""


class Named(Moved):
    """A plant that knows its joints."""

    joints = ('joint2', 'joint1')


class Three(Moved):
    """A plant of three joints."""

    def __init__(self):
        """Begin at zero."""
        self.q, self.qd, self.torque = np.zeros((3, 3))


@pytest.mark.parametrize(('plant', 'identifier', 'message'), [
    (Moved([0.0, 0.0]), door.Identifier(OTHER),
     "'identifier' is .*the joints joint1, joint2 in this order; it has joint2, joint1"),
    (Moved([0.0, 0.0]), door.Identifier(Renamed()),
     "'identifier' is .*the parameters p1, p2, .*; it has p2, p1, "),
    (Moved([0.0, 0.0]), door.Identifier(door.ThreeLinkArm()),
     "'identifier' is .*; it has joint1, joint2, joint3"),
    (door.simulate(OTHER, 0.001).plant, None,
     "'plant' is .*the joints joint1, joint2 in this order; it has joint2, joint1"),
    (Named([0.0, 0.0]), None, "'plant' is .*; it has joint2, joint1"),
    (Three(), None, r"'plant\.q' is .*expected shape \(2,\) \(one for each of joint1, joint2\)")])
def test_parts_of_other_joints_or_in_another_order_are_not_joined(plant, identifier, message):
    with pytest.raises(door.ParameterError, match=message):
        door.ClosedLoop(plant, controller(), identifier)


def test_a_loop_starts_with_an_estimate_by_name():
    known = door.Identifier(ARM, initial_estimate=ARM.nominal)
    for given in (known, known.estimate):
        loop = door.ClosedLoop(Moved([0.0, 0.0]), controller(), initial_estimate=given)
        np.testing.assert_array_equal(loop.initial_estimate, ARM.nominal)
