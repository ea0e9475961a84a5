# SPDX-License-Identifier: Apache-2.0
"""Values and parts that a person gives: of one joint, of an arm of their own, a class."""

from __future__ import annotations

import numpy as np
import pytest

import adaptive_blf_control as door

ARM = door.TwoLinkArm()


class Wheel(door.Arm):
    """An arm of one joint in plain NumPy."""

    joints, parameters = ('axle',), ('inertia', 'damping', 'weight')
    nominal = np.array([0.1, 0.2, 0.5])

    def Y1(self, q, qd):
        """Return the momentum regressor."""
        return np.array([[qd[0], 0.0, 0.0]])

    def Y2(self, q, qd):
        """Return the rest of it."""
        return np.array([[0.0, qd[0], np.sin(q[0])]])

    def X(self, q, qd, alpha, alpha_dot):
        """Return the regressor of the torque."""
        return np.array([[alpha_dot[0], qd[0], np.sin(q[0])]])

    def dynamics(self, theta):
        """Return its dynamics."""
        return Turning(theta)


class Turning(door.ForwardDynamics):
    """Its dynamics, which calculate with arrays."""

    def __init__(self, theta):
        """Take the parameters."""
        self.theta = theta

    def acceleration(self, q, qd, tau):
        """Return the acceleration."""
        inertia, damping, weight = self.theta
        return (tau - damping * qd - weight * np.sin(q)) / inertia


class Wild(Turning):
    """Dynamics of another shape."""

    def acceleration(self, q, qd, tau):
        """Return two accelerations for one joint."""
        return [0.0, 0.0]


WHEEL = Wheel()


def test_the_torque_of_one_joint_has_the_shape_of_its_positions():
    q, qd, qdd = np.random.default_rng(0).normal(size=(3, 20))
    theta, identifier = WHEEL.nominal, door.Identifier(WHEEL, initial_estimate=WHEEL.nominal)
    whole = door.inverse_dynamics(WHEEL, theta, q[:, None], qd[:, None], qdd[:, None])
    np.testing.assert_allclose(whole[:, 0], 0.1 * qdd + 0.2 * qd + 0.5 * np.sin(q))
    for call in (lambda *motion: door.inverse_dynamics(WHEEL, theta, *motion), identifier.predict):
        assert whole.shape == (20, 1)
        np.testing.assert_array_equal(call(q, qd, qdd), whole[:, 0])
        np.testing.assert_array_equal(call(q[:1], qd[:1], qdd[:1]), whole[0])
        one = call(q[0], qd[0], qdd[0])
        assert (np.shape(one), one) == ((), whole[0, 0])
    with pytest.raises(door.ParameterError, match=r"'qd' is .*expected shape \(20, 1\)"):
        door.inverse_dynamics(WHEEL, theta, q, qd[1:], qdd)
    with pytest.raises(door.ParameterError, match=r"'q' is 0\.0: expected shape \(N, 2\)"):
        door.inverse_dynamics(ARM, ARM.nominal, 0.0, 0.0, 0.0)


@pytest.mark.parametrize('state', [([0.1], [0.2], [0.3]), (0.1, 0.2, 0.3),
                                   tuple(np.float32([[0.1], [0.2], [0.3]]))])
def test_dynamics_of_a_users_own_are_given_arrays(state):
    robot = WHEEL.dynamics(WHEEL.nominal)
    expected = robot.advance(*np.array([[0.1], [0.2], [0.3]]), 1e-3)
    np.testing.assert_allclose(robot.advance(*state, 1e-3), expected, rtol=1e-6)


@pytest.mark.parametrize(('robot', 'given', 'message'), [
    (Turning, ([0.0], [0.0, 1.0], [0.0], 1e-3), r"'qd' is \[0\.0, 1\.0\]: expected shape \(1,\)"),
    (Turning, ([0.0], [0.0], ['a'], 1e-3), r"'tau' is \['a'\]: expected numbers of shape \(1,\)"),
    (Turning, ([0.0], [0.0], [0.0], 'dt'), "'dt' is 'dt': expected a number"),
    (Turning, ([0.0], [0.0], [0.0], 1e-3, 0), "'substeps' is 0: expected an integer"),
    (Wild, ([0.0], [0.0], [0.0], 1e-3), r"'Wild\.acceleration' is \[0\.0, 0\.0\]: .*\(1,\)")])
def test_what_dynamics_of_a_users_own_cannot_take_is_named(robot, given, message):
    with pytest.raises(door.ParameterError, match=message):
        robot(WHEEL.nominal).advance(*given)


class Still(door.Law):
    """A law without a constructor."""

    def answer(self, sample):
        """Return no torque."""
        return door.LawAnswer(np.zeros(2), sample.qd)


class Fixed(door.Plant):
    """A plant without a constructor."""

    q = qd = torque = np.zeros(2)

    def advance(self, dt):
        """Stay."""


class Slow(door.Constraint):
    """A constraint whose constructor takes nothing."""

    name, quantity, unit, recovery = 'slowness', 'velocity', 'rad/s', 'slow down'
    bodies = ARM.joints

    def __init__(self):
        """Take the limit."""
        self.limit = np.full(2, 2.0)

    def bounded(self, state):
        """Return the velocities with their bounds."""
        return door.Bounded(state.qd, -self.limit, self.limit)


class Kept(door.UpdateLaw):
    """An update law without a constructor."""

    def step(self, theta, dt, evidence):
        """Learn nothing."""
        return theta


class Here(door.Reference):
    """A reference without a constructor."""

    def at(self, t):
        """Stay at zero."""
        return door.ReferencePoint(*np.zeros((3, 2)))

    def range(self):
        """Return zero."""
        return np.zeros(2), np.zeros(2)


def test_a_class_that_takes_nothing_is_as_good_as_its_object():
    run = door.simulate(ARM, 0.01, law=Still, plant=Fixed, constraints=Slow, update_law=Kept)
    assert isinstance(run.plant, Fixed)
    assert run.kept
    assert not run.torque.any()
    assert len(run.controller.constraints.parts) == 3
    assert isinstance(door.Controller(ARM, constraints=[Slow]).constraints.parts[2], Slow)


def test_a_class_where_only_an_object_fits_is_told_so():
    for call, message in (
            (lambda: door.ClosedLoop(Fixed, door.Controller(ARM)), r'Fixed\(\), not the class'),
            (lambda: door.Controller(ARM, reference=Here), r'Here\(\.\.\.\), not the class'),
            (lambda: door.Identifier(Wheel), r'Wheel\(\.\.\.\), not the class')):
        with pytest.raises(door.ParameterError, match=message):
            call()


def test_sinusoids_swing_around_zero_where_no_offset_is_given():
    both = door.SumOfSinusoids([0.0, 0.0], [0.1, 0.2], 3.0)
    np.testing.assert_array_equal(
        door.SumOfSinusoids(amplitude=[0.1, 0.2], frequency=3.0).at(0.4), both.at(0.4))
    for missing in ({'amplitude': 0.1}, {'frequency': 3.0}, {}):
        with pytest.raises(door.ParameterError, match='(amplitude|frequency).* is missing'):
            door.SumOfSinusoids(**missing)


def test_sinusoids_of_one_joint_are_given_as_numbers():
    one = door.SumOfSinusoids([0.5], [[0.1]], [[3.0]], [[1.0]])
    np.testing.assert_array_equal(door.SumOfSinusoids(0.5, 0.1, 3.0, 1.0).at(0.4), one.at(0.4))
    two = door.SumOfSinusoids([0.5], [[0.1, 0.2]], [[3.0, 5.0]])
    np.testing.assert_array_equal(
        door.SumOfSinusoids(0.5, [0.1, 0.2], [3.0, 5.0]).at(0.4), two.at(0.4))


def test_sinusoids_do_not_follow_arrays_that_are_filled_again():
    given = np.array([0.1, 0.2])
    reference = door.SumOfSinusoids(given, given, 2.0 * given)
    before = reference.at(0.4).position.copy()
    given[:] = 7.0
    np.testing.assert_array_equal(reference.at(0.4).position, before)


def test_constraints_show_themselves_and_name_their_margins():
    controller = door.Controller(ARM, constraints=Slow())
    assert repr(controller.constraints) == (
        '<Constraints: safety: position [rad] of joint1, joint2; performance: error [rad] of '
        'joint1, joint2; slowness: velocity [rad/s] of joint1, joint2>')
    assert repr(controller.constraints.parts[0]) == (
        '<SafetyConstraint: joint1 -3.14 to 3.14 rad, joint2 -3.14 to 3.14 rad>')
    margins = controller.margins(controller.update(0.0, [0.1, 0.0], [0.0, 0.5], np.zeros(5)))
    named = dict(zip(map(str, controller.constraints.names), margins, strict=True))
    assert named['joint1.safety_margin'] == pytest.approx(3.04)
    assert named['joint2.slowness_margin [rad/s]'] == pytest.approx(1.5)
    with pytest.raises(AttributeError, match=r'constraints\.names has them'):
        _ = controller.margin_names


@pytest.mark.parametrize('smooth_start', [1.0, 0.0])
def test_a_start_outside_the_safety_set_names_what_gives_it(smooth_start):
    settings = {'reference.smooth_start': smooth_start}
    for call in (lambda: door.Controller(ARM, start=[4.0, 0.0], **settings),
                 lambda: door.simulate(ARM, 0.01, initial_position=[4.0, 0.0], **settings)):
        with pytest.raises(door.SetViolation, match='start=.*initial_position=.*widen'):
            call()


THREE = door.ThreeLinkArm()
EPOCHS = door.simulate(THREE, 0.01, schedule=[(0.002, 'payload', 1.0), (0.005, 'payload', 2.0)]
                       ).plant.truth(THREE.parameters)


@pytest.mark.parametrize('given', [
    [(0.005, 'payload', 2.0), (0.002, 'payload', 1.0)],
    {'time': [0.002, 0.005], 'parameter': ['payload', 'payload'], 'value': [1, 2]},
    '{time: [0.002, 0.005], parameter: [payload, payload], value: [1.0, 2.0]}',
    ['{time: 0.005, parameter: payload, value: 2.0}', '[0.002, payload, 1.0]']])
def test_a_schedule_is_given_as_changes_as_columns_or_as_yaml(given):
    epochs = door.simulate(THREE, 0.01, schedule=given).plant.truth(THREE.parameters)
    assert [t for t, _ in EPOCHS] == [t for t, _ in epochs] == [0.0, 0.002, 0.005]
    for (_, first), (_, second) in zip(EPOCHS, epochs):
        np.testing.assert_array_equal(first, second)


def test_one_change_needs_no_list_and_none_changes_nothing():
    one = door.simulate(THREE, 0.01, schedule=(0.002, 'payload', 1.0))
    assert [t for t, _ in one.plant.truth(THREE.parameters)] == [0.0, 0.002]
    none = door.simulate(THREE, 0.01, schedule=[])
    assert [t for t, _ in none.plant.truth(THREE.parameters)] == [0.0]


@pytest.mark.parametrize(('given', 'message'), [
    ('payload=2.0', r"'schedule' is 'payload=2\.0': expected changes such as \[\(5\.0, 'payload'"),
    ({'time': [0.005]}, "'schedule' is .*as columns of the same length"),
    ({'times': [0.005]}, r"'schedule\.times' is .*did you mean schedule\.time\?"),
    ([(1.0, 'payload', 'heavy')], "'schedule' is .*expected changes"),
    ([(1.0, 'paylod', 2.0)], "schedule.parameter' is 'paylod': expected one of p1, .*payload")])
def test_a_schedule_that_cannot_be_used_says_what_one_is(given, message):
    with pytest.raises(door.ParameterError, match=message):
        door.simulate(THREE, 0.01, schedule=given)


@pytest.mark.parametrize(('changes', 'meant'), [
    ({'schedul': [(5.0, 'payload', 1.0)]}, 'schedule'),
    ({'schedul': {'time': [1.0]}}, r'arm_driver\.schedule\.time'),
    ({'saftey': (-1.0, 1.0)}, r'controller\.safety'), ({'histry': 3}, r'identifier\.history'),
    ({'excitaton': {'window': 1.0}}, r'identifier\.excitation\.window')])
def test_a_misspelt_group_is_told_the_one_that_is_meant(changes, meant):
    with pytest.raises(door.UnknownParameter, match=rf'did you mean {meant}\b'):
        door.simulate(ARM, 0.01, **changes)


def test_the_settings_of_a_real_robot_are_those_of_identify():
    t = np.arange(0.0, 3.0, 1e-3)
    q = np.column_stack([np.sin(3.0 * t), np.cos(2.0 * t)])
    qd = np.column_stack([3.0 * np.cos(3.0 * t), -2.0 * np.sin(2.0 * t)])
    taken = door.identify({'t': t, 'q': q, 'qd': qd, 'tau': q}, ARM, kh=50.0).settings.values()
    stated = door.IdentifierSettings.real_robot(kh=50.0).resolved(joints=2, parameters=5).values()
    assert {name: taken[name] for name in stated} == stated
    assert door.IdentifierSettings.real_robot() != door.IdentifierSettings()
    with pytest.raises(door.UnknownParameter, match=r'did you mean kh\?'):
        door.IdentifierSettings.real_robot(khh=50.0)


def test_settings_of_one_arm_fit_another_where_they_are_the_defaults():
    identifier = door.Identifier(THREE, door.Identifier(ARM).settings)
    assert identifier.theta.shape == (11,)
    controller = door.Controller(THREE, door.Controller(ARM).settings)
    assert controller.settings.k1.tolist() == [40.0] * 3
    with pytest.raises(door.ParameterError, match=r"gamma' is \[1\.0, 1\.0\]: .*length 1 or 11"):
        door.Identifier(THREE, gamma=[1.0, 1.0])  # stated here, not left from another arm
    with pytest.raises(door.ParameterError, match=r"k2' is \[1\.0, 2\.0\]: .*length 1 or 3"):
        door.Controller(THREE, door.Controller(ARM, k2=[1.0, 2.0]).settings)
    with pytest.raises(door.ParameterError, match="'safety' is .*bounds for each of joint1, .*3"):
        door.Controller(THREE, safety=door.Controller(ARM).safety)


class Swinging(door.Reference):
    """A reference whose points hold lists, or numbers."""

    def __init__(self, form):
        """Take what makes a list or a number of a number."""
        self.form = form

    def at(self, t):
        """Evaluate."""
        return door.ReferencePoint(*map(self.form, (
            0.1 * np.sin(t), 0.1 * np.cos(t), -0.1 * np.sin(t))))

    def range(self):
        """Return the range."""
        return self.form(-0.1), self.form(0.1)


@pytest.mark.parametrize('form', [lambda number: [number], float])
def test_a_reference_of_a_users_own_may_answer_with_lists_or_numbers(form):
    given = {'start': [0.05], 'reference': Swinging(form)}
    arrays = {'start': [0.05], 'reference': Swinging(lambda number: np.array([number]))}
    first, second = door.Controller(WHEEL, **given), door.Controller(WHEEL, **arrays)
    for t in (0.0, 0.3, 7.0):
        np.testing.assert_array_equal(first.update(t, 0.05, 0.0, WHEEL.nominal).torque,
                                      second.update(t, 0.05, 0.0, WHEEL.nominal).torque)
    np.testing.assert_array_equal(*(door.simulate(
        WHEEL, 0.1, reference=each['reference']).q for each in (given, arrays)))
    first.retune(7.0, [0.05], reference=Swinging(form))
    with pytest.raises(door.ParameterError, match=r"'reference\.position' is .*one for each of"):
        door.Controller(ARM, reference=Swinging(form))


def test_a_constraint_of_a_users_own_may_answer_with_lists():
    class Listed(Slow):
        """The same in lists."""

        def bounded(self, state):
            """Return lists."""
            return door.Bounded(list(state.qd), [-2.0, -2.0], [2.0, 2.0])

    for kind in (Slow, Listed):
        controller = door.Controller(ARM, constraints=kind)
        state = controller.state(0.0, np.zeros(2), np.array([0.5, 0.0]))
        assert controller.constraints.margins(state)[-2:].tolist() == [1.5, 2.0]


T = np.arange(0.0, 0.3, 1e-3)
WAVE = np.column_stack([np.sin(3.0 * T), np.cos(2.0 * T)])
HIDDEN = np.ma.masked_array(WAVE, mask=False)
HIDDEN[7, 1] = np.ma.masked
LOG = {'t': T, 'q': WAVE, 'qd': WAVE, 'tau': WAVE}
COLUMNS = {'t': T, **{f'{kind}{i + 1}': HIDDEN[:, i] if kind == 'qd' else WAVE[:, i]
                      for kind in ('q', 'qd', 'tau') for i in range(2)}}
ONE = np.ma.masked_array([0.1, 0.2], mask=[True, False])


@pytest.mark.parametrize(('call', 'message'), [
    (lambda: door.read_log({**LOG, 'qd': HIDDEN}), r"'qd' is .*qd\[7, 1\] is masked, 1 of 600"),
    (lambda: door.read_log(COLUMNS), r"'qd2' is .*qd2\[7\] is masked"),
    (lambda: door.identify({**LOG, 'tau': HIDDEN}, arm=ARM), r'tau\[7, 1\] is masked.*NaN'),
    (lambda: door.Identifier(ARM).learn(T, HIDDEN, WAVE, WAVE), r'q\[7, 1\] is masked'),
    (lambda: door.Identifier(ARM).learn({**LOG, 'q': HIDDEN, 'joints': ARM.joints[::-1]}),
     r'q\[7, 0\] is masked'),
    (lambda: door.Identifier(ARM).learn(T, list(HIDDEN), WAVE, WAVE), r'q\[7, 1\] is masked'),
    (lambda: door.Identifier(ARM).update(0.0, ONE, [0.0, 0.0], [0.0, 0.0]), r'q\[0\] is masked'),
    (lambda: door.Controller(ARM).update(0.0, [0.0, 0.0], ONE, np.zeros(5)), r'qd\[0\] is masked'),
    (lambda: door.Controller(ARM).update(np.ma.masked, ONE, ONE, np.zeros(5)), 't is masked'),
    (lambda: door.Controller(ARM, start=ONE), r'start\[0\] is masked'),
    (lambda: door.Controller(ARM, k2=ONE), r'k2\[0\] is masked'),
    (lambda: door.inverse_dynamics(ARM, ARM.nominal, HIDDEN, WAVE, WAVE), r'q\[7, 1\] is masked'),
])
def test_a_masked_element_is_refused_by_name_and_place(call, message):
    with pytest.raises(door.BlfError, match=message):
        call()


def test_an_array_in_which_nothing_is_masked_is_an_array():
    np.testing.assert_array_equal(
        door.read_log({**LOG, 'q': np.ma.masked_array(WAVE, mask=False)}).q, WAVE)
