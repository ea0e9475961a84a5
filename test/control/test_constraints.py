# SPDX-License-Identifier: Apache-2.0
"""Facts about what counts as inside: margins, names, violations, the start."""

from __future__ import annotations

import importlib
from pathlib import Path

import numpy as np
import pytest

import adaptive_blf_control as door
from adaptive_blf_control.control.constraints import Bounded, Constraints, MarginName, MotionState
from adaptive_blf_control.control.set_constraints import PerformanceConstraint, SafetyConstraint
from adaptive_blf_control.control.sets import Bounds, JointInterval
from adaptive_blf_control.errors import ParameterError, SetViolation

JOINTS = ('joint1', 'joint2')
ARM = door.TwoLinkArm()
SAFETY = JointInterval(np.array([-1.17, -2.17]), np.array([1.2, 2.2]), 'safety')
PERFORMANCE = Bounds(np.array([-0.17, -0.17]), np.array([0.2, 0.2]), np.zeros(2), np.zeros(2))
BOTH = [SafetyConstraint(JOINTS, SAFETY), PerformanceConstraint(JOINTS)]


@pytest.fixture
def foreign(monkeypatch):
    """Return a module with constraints that share no code with ours."""
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    return importlib.import_module('foreign_constraints')


@pytest.fixture
def everything(foreign):
    """Return both sets, a limit of the velocity and a table."""
    return Constraints([*BOTH, foreign.VelocityLimit(ARM, None), foreign.Table(ARM, None)],
                       JOINTS)


def state(q=(0.0, 0.0), e1=(0.0, 0.0), qd=(0.0, 0.0)) -> MotionState:
    return MotionState(0.0, np.array(q), np.array(qd), np.array(e1), PERFORMANCE)


def test_margins_are_the_distances_to_the_nearer_bounds_in_the_order_of_their_names(everything):
    margins = everything.margins(state([1.0, -2.0], [0.1, -0.1], [-1.5, 0.5]))
    height = np.sin(1.0) + np.sin(-1.0)
    np.testing.assert_allclose(margins, [0.2, 0.17, 0.1, 0.07, 0.5, 1.5, 3.0 + height])
    assert [str(name) for name in everything.names] == [
        'joint1.safety_margin', 'joint2.safety_margin', 'joint1.performance_margin',
        'joint2.performance_margin', 'joint1.velocity_margin [rad/s]',
        'joint2.velocity_margin [rad/s]', 'tip.table_margin [m]']
    assert everything.names[4].label == 'joint1 velocity margin [rad/s]'


@pytest.mark.parametrize('name', [MarginName('joint1', 'safety'),
                                  MarginName('left.arm.tip', 'table', 'm')])
def test_the_name_of_a_margin_is_read_back_from_its_text(name):
    assert MarginName.parse(str(name)) == name


def test_what_names_no_margin_is_read_as_none():
    assert [MarginName.parse(text) for text in ('V', 'joint1.safety', 'safety_margin')] == [
        None] * 3


def test_along_a_run_the_margins_are_those_of_its_samples(everything):
    generator = np.random.default_rng(1)
    q, qd, e1 = (generator.uniform(-0.1, 0.1, (5, 2)) for _ in range(3))
    run = MotionState(np.arange(5.0), q, qd, e1, PERFORMANCE)
    expected = [everything.margins(state(*each)) for each in zip(q, e1, qd)]
    np.testing.assert_array_equal(everything.margins_along(run), expected)


def test_a_start_inside_is_accepted(everything):
    everything.check_start(state([1.19, -2.16], [0.19, -0.16], [1.9, -1.9]))


@pytest.mark.parametrize('q', [[0.0, 2.2], [0.0, 2.3], [0.0, -2.17], [0.0, float('nan')]])
def test_a_start_position_on_or_beyond_the_safety_bound_is_refused(everything, q):
    with pytest.raises(SetViolation, match="'joint2': start position outside the safety set"):
        everything.check_start(state(q))


@pytest.mark.parametrize('error', [[0.2, 0.0], [-0.17, 0.0], [float('nan'), 0.0]])
def test_a_start_error_on_or_beyond_the_performance_bound_is_refused(everything, error):
    with pytest.raises(SetViolation, match="'joint1': start error outside the performance set"):
        everything.check_start(state(e1=error))


def test_a_refused_start_names_body_value_bound_unit_and_what_to_do(everything):
    with pytest.raises(SetViolation) as caught:
        everything.check_start(state(qd=[0.0, -2.5]))
    assert str(caught.value) == ("joint 'joint2': start velocity outside the velocity set: "
                                 '-2.5 rad/s against -2 rad/s: slow the reference down')
    assert (caught.value.joint, caught.value.value, caught.value.bound, caught.value.unit) == (
        'joint2', -2.5, -2.0, 'rad/s')


@pytest.mark.parametrize(('where', 'text'), [
    ({'q': [1.3, 0.0], 'e1': [0.5, 0.0]},
     "joint 'joint1' has left its safety set: 1.3 rad is not within -1.17 .. 1.2 rad "
     '(margin -0.1 rad)'),
    ({'e1': [0.0, -0.2]},
     "joint 'joint2' has left its performance set: -0.2 rad is not within -0.17 .. 0.2 rad "
     '(margin -0.03 rad)'),
    ({'qd': [2.0, 3.0]},
     "joint 'joint2' has left its velocity set: 3 rad/s is not within -2 .. 2 rad/s "
     '(margin -1 rad/s)'),
    ({'qd': [float('nan'), 0.0]}, "joint 'joint1' has left its velocity set: nan rad/s"),
])
def test_of_the_first_violated_constraint_the_worst_body_is_described(everything, where, text):
    violation = everything.violation(state(**where))
    assert str(violation).startswith(text)


def test_a_body_that_is_no_joint_is_called_a_body(everything):
    table = everything.parts[-1]
    table.bounded = lambda _: Bounded(np.array([-0.25]), 0.0, np.inf)
    assert str(everything.violation(state())) == (
        "body 'tip' has left its table set: -0.25 m is not within 0 .. inf m (margin -0.25 m)")


def test_inside_nothing_is_violated(everything):
    assert everything.violation(state([1.0, 1.0], [0.1, 0.1], [1.0, -1.0])) is None


@pytest.mark.parametrize('name', ['safety', 'two words', 'a.b', ''])
def test_a_constraint_has_a_word_of_its_own_for_a_name(foreign, name):
    other = foreign.VelocityLimit(ARM, None)
    other.name = name
    with pytest.raises(ParameterError, match='all different'):
        Constraints([*BOTH, other], JOINTS)


@pytest.mark.parametrize(('bounded', 'message'), [
    (lambda _: Bounded(np.zeros(1), -1.0, 1.0), r'shape is \(1,\)'),
    (lambda _: 1.0 / 0.0, 'ZeroDivisionError'),
])
def test_a_constraint_that_gives_no_margins_is_refused_when_the_controller_is_made(
        foreign, bounded, message):
    broken = foreign.VelocityLimit(ARM, None)
    broken.bounded = bounded
    with pytest.raises(ParameterError, match=f"'velocity'.*{message}"):
        door.Controller(ARM, constraints=[broken])


@pytest.mark.parametrize(('name', 'message'), [
    ('nonsense', 'module:name'), ('no_such_module:Limit', 'ModuleNotFoundError'),
    ('adaptive_blf_control.control.constraints:Nobody', 'AttributeError'),
    ('adaptive_blf_control.control.sets:Bounds', 'TypeError'),
    ('adaptive_blf_control.arms.two_link:TwoLinkArm', 'name, quantity|TypeError')])
def test_a_constraint_that_is_not_there_is_named(name, message):
    with pytest.raises(ParameterError, match=message):
        door.Controller(ARM, door.ControllerSettings(constraints=[name]))


def test_constraints_stay_through_a_change_of_the_sets_and_of_the_gains(foreign):
    settings = door.ControllerSettings(constraints=['foreign_constraints:VelocityLimit'])
    controller = door.Controller(ARM, settings, constraints=[foreign.Table(ARM, None)])
    names = controller.constraints.names
    controller.retune(0.0, np.zeros(2), settings=settings.replace(k1=50.0),
                      safety=JointInterval(np.full(2, -2.0), np.full(2, 2.0)))
    assert controller.constraints.names == names
    assert {name.constraint for name in names} == {'safety', 'performance', 'velocity', 'table'}
    output = controller.update(0.0, [0.0, 0.0], [0.5, 0.0], np.zeros(5))
    np.testing.assert_allclose(controller.margins(output)[[0, 4]], [2.0, 1.5])
