# SPDX-License-Identifier: Apache-2.0
"""Parts, parameters and arrays of a user's own: taken as they are meant, or refused with why."""

from __future__ import annotations

import copy
import functools
import inspect
import types

import numpy as np
import pytest

import adaptive_blf_control as door
from adaptive_blf_control.parameters.plugin import CALLED_AS
from adaptive_blf_control.tools.identify import main as identify_command

ARM = door.TwoLinkArm()
T = np.arange(0.0, 0.5, 1e-3)
Q = np.column_stack([np.sin(3.0 * T), np.cos(2.0 * T)])
LOG = {'t': T, 'q': Q, 'qd': Q, 'tau': Q}
STILL = ([0.1, 0.2], [0.0, 0.0], [1.0, 2.0])


class Silent:
    """An update law whose parameters are lost."""

    def step(self, theta, dt, evidence):
        return np.nan * theta


class OldStep:
    """An update law as another program calls it."""

    def step(self, theta, Y, tau, dt):
        return theta


class Timeless(door.Sensor):
    """A sensor that is not told the interval."""

    def measure(self, q, qd, tau):
        return door.Measurement(q, qd, tau)


class Turned(door.Constraint):
    """A constraint that answers for a whole run with its axes exchanged."""

    name, quantity, unit, recovery = 'half', 'position', 'rad', 'go back'
    bodies, whole_runs = ('joint1', 'joint2'), True

    def bounded(self, state):
        return door.Bounded(state.q.T, -3.0, 3.0)


class Upset(Turned):
    """One that cannot answer for a whole run."""

    def bounded(self, state):
        return door.Bounded(state.q, np.full(state.q.size, -3.0), 3.0)


@functools.cache
def pendulum():
    pytest.importorskip('pinocchio')
    return door.load_arm(
        '<robot name="r"><link name="base"/><link name="rod"><inertial><mass value="1"/>'
        '<origin xyz="0 0 -0.2"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/>'
        '</inertial></link><joint name="pivot" type="continuous"><parent link="base"/>'
        '<child link="rod"/><axis xyz="0 1 0"/></joint></robot>')


def known(arm):
    """Return what has an estimate of an arm: an identifier that begins with the nominal θ."""
    return door.Identifier(arm, initial_estimate=arm.nominal)


@pytest.mark.parametrize('given', [
    lambda arm: dict(zip(arm.parameters[::-1], arm.nominal[::-1])), known,
    lambda arm: arm.nominal.tolist()])
@pytest.mark.parametrize('made', [lambda: ARM, door.ThreeLinkArm, pendulum])
def test_dynamics_and_torques_take_parameters_by_name_or_of_what_has_learned(made, given):
    arm = made()
    q, qd, tau = (np.full(arm.n, value) for value in (0.3, 0.2, 1.0))
    np.testing.assert_array_equal(arm.dynamics(given(arm)).acceleration(q, qd, tau),
                                  arm.dynamics(arm.nominal).acceleration(q, qd, tau))
    np.testing.assert_array_equal(door.inverse_dynamics(arm, given(arm), q, qd, tau),
                                  door.inverse_dynamics(arm, arm.nominal, q, qd, tau))


@pytest.mark.parametrize('made', [lambda: ARM, pendulum])
def test_parameters_of_another_arm_are_refused_with_the_names_that_are_needed(made):
    arm = made()
    for theta in ({'mass': 1.0}, known(door.ThreeLinkArm())):
        with pytest.raises(door.ParameterError, match=f"'theta'.*one for each of "
                           f'{arm.parameters[0]}'):
            arm.dynamics(theta)


def test_a_run_begins_with_what_has_learned():
    theta = ARM.nominal + [0.5, 0.0, 0.0, 1.0, 2.0]
    begun = door.Identifier(ARM, initial_estimate=theta)
    run = door.simulate(ARM, 0.01, initial_estimate=begun)
    np.testing.assert_array_equal(run.theta_hat[0], theta)


@pytest.mark.parametrize(('call', 'message'), [
    (lambda: door.Identifier(ARM, update_law=Silent()).learn(T, Q, Q, Q),
     r"'Silent\.step' is nan: expected finite parameters: .*for 499 samples"),
    (lambda: door.Identifier(ARM, update_law=OldStep()),
     r"called as step\(theta, dt, evidence\): missing a required argument: 'dt'"),
    (lambda: door.simulate(ARM, 0.01, sensor=Timeless),
     r'called as measure\(q, qd, torque, dt\): too many positional'),
    (lambda: str(door.simulate(ARM, 0.01, constraints=[Turned()])),
     r"'half': .*\(N, k\) = \(11, 2\).*whole_runs is True: their shape is \(2, 11\)"),
    (lambda: str(door.simulate(ARM, 0.01, constraints=[Upset()])),
     r"'half': .*whole_runs is True \(ValueError: .*broadcast"),
    (lambda: door.simulate(ARM, 0.01, safety_filter=True),
     r"safety_filter' is True: expected one of none, limits, module:name"),
    (lambda: door.simulate(ARM, 0.01, true_parameters=known(ARM)), 'list of doubles: its theta'),
    (lambda: door.simulate(ARM, 0.01, update_law=lambda theta: 0.0),
     r'step\(theta, dt, evidence\) -> theta: float has no step'),
    (lambda: door.simulate(ARM, 0.01, constraints=[lambda state: 0.0]),
     r'bounded\(state\) -> Bounded\(value, lower, upper\); .*inherits from Constraint'),
    (lambda: door.simulate(ARM, 0.01, limits={'obstacles': {'spheres': [
        {'center': [1.0, 0.0, 0.0], 'radius': 0.1}]}}),
     'one flat list of doubles: x, y, z of the centre and the radius of each sphere$'),
    (lambda: door.simulate(ARM, 0.01, limits={'obstacles': {'spheres': [[1.0, 0.0, 0.0, 0.1]]}}),
     'one flat list of doubles: x, y, z of the centre'),
    (lambda: door.simulate(ARM, 0.01, sensor={'noise': 1e-3}),
     r"'encoder'; settings are given by name, sensors={'torque_noise': 0\.1}, .*encoder_counts"),
    (lambda: door.simulate('two_link', 0.01, arm_driver={'schedule': {}}),
     r"'arm_driver.schedule' is {}: .*it is a group, expected its members by name"),
    (lambda: door.simulate('two_link', 0.01, sensors={}), r"'sensors' is {}: .*it is a group"),
    (lambda: door.simulate('two_link', 0.01, controller={'limts': {}}), 'mean controller.limits'),
    (lambda: door.simulate('two_link', 0.01, nosuch={}), r"'nosuch' is {}: no such parameter"),
    (lambda: door.simulate(ARM, 0.01, position_noise=1e-3), 'mean arm_driver.sensors.encoder_co'),
    (lambda: door.simulate(ARM, 0.01, save='run'), r'did you mean bag'),
    (lambda: door.identify(LOG, ARM, regularization=1.0), r'did you mean initial_estimate\?'),
    (lambda: door.identify(LOG, ARM, method='ls'), r'did you mean update_law\?')])
def test_what_cannot_be_used_is_told_what_is_meant(call, message):
    with pytest.raises(door.ParameterError, match=message):
        call()


def test_a_node_without_a_change_runs_as_it_is():
    run = door.simulate('two_link', 0.01, controller={}, identifier={})
    assert len(run.t) == 11


def test_samples_that_are_not_finite_are_not_laid_at_the_door_of_the_law():
    with pytest.raises(door.ParameterError, match=r"'q' is .*in none of its 500 rows are all"):
        door.Identifier(ARM).learn(T, np.nan * Q, Q, Q)


def test_the_torque_of_an_output_is_asked_for_where_the_output_is_given():
    output = door.Controller(ARM).update(0.0, [0.0, 0.0], [0.0, 0.0], ARM.nominal)
    dynamics = ARM.dynamics(ARM.nominal)
    with pytest.raises(door.ParameterError, match=r"'tau' is ControlOutput.*: its torque$"):
        dynamics.advance([0.0, 0.0], [0.0, 0.0], output, 1e-3)
    with pytest.raises(door.ParameterError, match=r'joint2\)$'):
        dynamics.advance(output, [0.0, 0.0], [0.0, 0.0], 1e-3)


@pytest.mark.parametrize('arrays', [(T, Q, Q, Q), (T, T, Q, Q, Q, 0)])
def test_a_log_of_arrays_is_told_how_it_is_made(arrays):
    with pytest.raises(door.LogError, match=r"read_log\({'t': t, 'q': q, 'qd': qd, 'tau': tau}\)"):
        door.MeasuredLog(*arrays)
    log = door.read_log(LOG)
    np.testing.assert_array_equal(copy.deepcopy(log).q, log.replace(dropped=1).q)


@pytest.mark.parametrize(('method', 'protocol'), [
    ('answer', door.Law), ('bounded', door.Constraint), ('step', door.UpdateLaw),
    ('measure', door.Sensor)])
def test_a_method_is_called_as_messages_say(method, protocol):
    head, _, result = CALLED_AS[method].partition(' -> ')
    names = list(inspect.signature(getattr(protocol, method)).parameters)[1:]
    assert head == f'{method}({", ".join(names)})'
    kind, _, fields = result.rstrip(')').partition('(')
    assert fields.split(', ') == list(getattr(
        door, kind, types.SimpleNamespace(_fields=('',)))._fields)


@pytest.mark.parametrize('arguments', [['--arm', 'two_link'], ['--arm=two_link'],
                                       ['--urdf', 'two_link']])
def test_the_command_says_how_an_arm_in_closed_form_is_learned(tmp_path, capsys, arguments):
    path = tmp_path / 'log.csv'
    np.savetxt(path, np.column_stack([T, Q, Q, Q]), delimiter=',',
               header='t,q1,q2,qd1,qd2,tau1,tau2', comments='')
    try:
        status = identify_command([str(path), *arguments])
    except SystemExit as stop:
        status = stop.code
    assert status not in (0, None)
    assert '--set arm=two_link' in capsys.readouterr().err
