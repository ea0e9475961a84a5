# SPDX-License-Identifier: Apache-2.0
"""Loops that are joined by hand: what does not fit together or cannot begin is refused."""

from __future__ import annotations

import copy
import re

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


@pytest.mark.parametrize(('factor', 'unit'), [(1e3, 'ms'), (1e6, 'us'), (1e9, 'ns')])
@pytest.mark.parametrize('since', [0.0, 1.7e9])
def test_times_in_another_unit_are_noticed_by_what_takes_sample_after_sample(factor, unit, since):
    identifier, law = door.Identifier(ARM), controller()
    asked = re.escape(f'times in {unit}? t / {factor:g} ')
    with pytest.warns(UserWarning, match=asked) as caught:
        [identifier.update(factor * (since + 1e-3 * k), *np.zeros((3, 2))) for k in range(20)]
    assert (len(caught), caught[0].filename) == (1, __file__)
    assert f'times in {unit}?' in identifier.notes[0]
    assert repr(identifier).endswith('see its notes>')
    if since:
        with pytest.raises(door.ParameterError, match="'t' is .*since 1970: .* / 1e?[+0]*"):
            law.update(factor * since, *np.zeros((2, 2)), ARM.nominal)
        return
    with pytest.warns(UserWarning, match=asked) as caught:
        [law.update(1e-3 * factor * k, *np.zeros((2, 2)), ARM.nominal) for k in range(20)]
    assert (len(caught), caught[0].filename) == (1, __file__)
    assert f'times in {unit}?' in law.notes[-1]


def test_one_pause_is_none_of_another_unit(recwarn):
    identifier, law = door.Identifier(ARM), controller()
    for k in range(100):
        t = 1e-3 * k + 0.3 * (k > 50)
        identifier.update(t, *np.zeros((3, 2)))
        law.update(t, *np.zeros((2, 2)), ARM.nominal)
    assert identifier.notes == ()
    assert law.notes == controller().notes
    assert not recwarn.list


def test_a_copy_of_a_controller_has_notes_of_its_own():
    law = controller()
    law.update(0.0, *np.zeros((2, 2)), ARM.nominal)
    before, other = law.notes, copy.copy(law)
    with pytest.warns(UserWarning, match='went on by 2 s'):
        other.update(2.0, *np.zeros((2, 2)), ARM.nominal)
    assert law.notes == before != other.notes


def test_a_loop_whose_identifier_would_restart_at_every_sample_is_not_joined():
    with pytest.raises(door.ParameterError, match=r"'period' is 1\.0.*0\.05 s.*1 ms are 0\.001 s"):
        door.ClosedLoop(Moved([0.0, 0.0]), controller(), period=1.0)
    slow = door.Identifier(ARM, filter={'gap': 2.0})
    assert door.ClosedLoop(Moved([0.0, 0.0]), controller(), slow, period=1.0).period == 1.0
