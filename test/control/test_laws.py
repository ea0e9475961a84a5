# SPDX-License-Identifier: Apache-2.0
"""Facts about laws as parts: named in a parameter, passed in, or a stranger's."""

from __future__ import annotations

from copy import copy
from pathlib import Path

import numpy as np
import pytest

import adaptive_blf_control as door
from adaptive_blf_control.configuration.build_closed_loop import build_closed_loop
from adaptive_blf_control.configuration.parameter_file import load_yaml
from adaptive_blf_control.control.laws.ablf import AblfLaw
from adaptive_blf_control.control.laws.fixed import ComputedTorque, ProportionalDerivative
from adaptive_blf_control.control.laws.linear_gains import joint_inertia, linear_gains
from adaptive_blf_control.control.laws.protocol import own_estimate, uses_estimate
from adaptive_blf_control.control.settings import LAWS

HERE = Path(__file__).parent
ARM = door.TwoLinkArm()


@pytest.fixture
def stranger(monkeypatch):
    """Return the name of a law outside the package."""
    monkeypatch.syspath_prepend(str(HERE))
    return 'foreign_law:Spring'


@pytest.mark.parametrize('law', LAWS)
def test_every_law_of_ours_drives_the_loop_within_its_torque_limit(repository, law):
    run = door.simulate(repository / 'config' / 'two_link.yaml', 1.0, controller={'law': law})
    limit = run.loop.controller.settings.torque_limit
    assert (np.abs(run.torque) <= limit).all()
    assert np.abs(run.e1).max() < 0.2


def test_a_strangers_law_drives_the_loop_and_has_no_adaptation_term(repository, stranger):
    terms = []
    run = door.simulate(repository / 'config' / 'two_link.yaml', 2.0,
                        controller={'law': stranger},
                        observer=lambda sample: terms.append(sample.output.adaptation_term))
    assert run.kept
    assert not np.any(terms)
    assert run.rank[-1] == 5  # the identifier learns from what it sees, whoever drives


def test_a_law_that_is_passed_in_stays_through_a_change_of_the_gains():
    class Counting:
        asked = 0

        def answer(self, sample):
            self.asked += 1
            return AblfLaw(ARM, door.ControllerSettings().resolved(joints=2)).answer(sample)

    law = Counting()
    controller = door.Controller(ARM, law=law)
    controller.update(0.0, [0.0, 0.0], [0.0, 0.0], np.zeros(5))
    controller.retune(0.0, np.zeros(2), settings=door.ControllerSettings(k2=5.0))
    controller.update(1e-3, [0.0, 0.0], [0.0, 0.0], np.zeros(5))
    assert law.asked == 2


def test_limits_and_their_rates_hold_for_every_law(stranger):
    controller = door.Controller(ARM, law=None, torque_limit=3.0, torque_rate_limit=1000.0,
                                 **{'safety.lower': -3.0}).settings.replace(law=stranger)
    subject = door.Controller(ARM, controller)
    output = subject.update(0.0, [0.1, -0.1], [0.0, 0.0], np.zeros(5))
    np.testing.assert_allclose(output.torque, [-1.0, 1.0])  # 1 ms at 1000 N·m/s
    for k in range(1, 5):
        output = subject.update(k * 1e-3, [0.1, -0.1], [0.0, 0.0], np.zeros(5))
    np.testing.assert_allclose(output.torque, [-3.0, 3.0])
    np.testing.assert_allclose(output.wanted, [-30.0, 30.0])


@pytest.mark.parametrize('config', ['two_link', 'three_link'])
def test_gains_of_pd_are_the_linearisation_of_our_law(repository, config):
    data = load_yaml(repository / 'config' / f'{config}.yaml')
    controller, small = build_closed_loop(data).controller, 1e-5
    gains, arm = linear_gains(controller.settings), controller.arm
    point = controller.reference.at(0.0)
    for i, unit in enumerate(np.eye(arm.n)):
        for what, position, velocity in ((gains.stiffness, small * unit, 0.0 * unit),
                                         (gains.damping, 0.0 * unit, small * unit)):
            slopes = [-copy(controller).update(0.0, point.position + sign * position,
                                               point.velocity + sign * velocity,
                                               np.zeros(arm.m)).torque[i] / (sign * small)
                      for sign in (1.0, -1.0)]
            # One side of an asymmetric set is stiffer than the mean of both squares.
            assert min(slopes) * (1 - 1e-6) <= what[i] <= max(slopes) * (1 + 1e-6)


@pytest.mark.parametrize('law', ['computed_torque', 'slotine_li'])
def test_a_law_that_needs_an_inertia_refuses_an_arm_without_one(law):
    arm = door.TwoLinkArm()
    vars(arm)['nominal'] = np.zeros(5)  # closed to others
    controller = door.Controller(arm, law=law)
    with pytest.raises(door.ParameterError, match='every joint an inertia > 0'):
        controller.update(0.0, [0.0, 0.0], [0.0, 0.0], np.zeros(5))


def test_slotine_li_descends_along_its_own_error_from_the_first_estimate_on():
    controller = door.Controller(ARM, law='slotine_li', torque_rate_limit=1e12,
                                 **{'slotine_li.gamma': [3.0]})
    q, qd, theta = np.array([0.02, -0.03]), np.array([0.3, 0.1]), 0.5 * ARM.nominal
    law = controller.law
    output = controller.update(0.0, q, qd, theta)
    np.testing.assert_array_equal(law.theta, theta)
    gains = linear_gains(controller.settings)
    bandwidth = np.sqrt(gains.stiffness / joint_inertia(ARM, np.zeros(2)))
    sliding = qd + bandwidth * q
    np.testing.assert_allclose(output.e2, sliding)
    regressor = ARM.X(q, qd, qd - sliding, -bandwidth * qd)
    np.testing.assert_allclose(output.torque, regressor @ theta - gains.damping * sliding)
    controller.update(0.01, q, qd, np.full(5, np.nan))  # it does not look at any other
    np.testing.assert_allclose(law.theta, theta - 0.01 * 3.0 * sliding @ regressor)


def test_a_law_with_a_state_of_its_own_keeps_it_through_a_change_of_the_gains():
    gains = {'slotine_li.gamma': [50.0], 'k2': 10.0}
    changed, plain = (door.Controller(ARM, law='slotine_li') for _ in range(2))
    for controller in (changed, plain):
        for k in range(3):
            controller.update(k * 1e-3, [0.05, 0.0], [0.1, 0.0], ARM.nominal)
    held = changed.law.theta
    changed.retune(2e-3, np.array([0.05, 0.0]), settings=changed.settings.replace(**gains))
    np.testing.assert_array_equal(changed.law.theta, held)
    for controller in (changed, plain):
        controller.update(3e-3, [0.05, 0.0], [0.1, 0.0], ARM.nominal)
    np.testing.assert_allclose(changed.law.theta - held, (plain.law.theta - held) * 50.0 / 200.0)


def test_a_law_hears_the_measured_torque_and_nan_where_there_is_none():
    heard = []

    class Listening(door.Law):
        def answer(self, sample):
            heard.append(sample.torque)
            return door.LawAnswer(np.zeros(2), np.zeros(2), None)

    controller = door.Controller(ARM, law=Listening())
    controller.update(0.0, [0.0, 0.0], [0.0, 0.0], np.zeros(5), [1.0, 2.0])
    controller.update(1e-3, [0.0, 0.0], [0.0, 0.0], np.zeros(5))
    np.testing.assert_array_equal(heard, [[1.0, 2.0], [np.nan, np.nan]])


@pytest.mark.parametrize(('law', 'uses', 'adapts'), [
    ('ablf', True, False), ('pd', False, False), ('computed_torque', True, False),
    ('slotine_li', False, True), ('foreign_law:Spring', True, False)])
def test_a_law_says_whether_it_needs_an_estimate_and_whether_it_adapts_itself(
        stranger, law, uses, adapts):
    controller = door.Controller(ARM, law=law)
    controller.update(0.0, [0.0, 0.0], [0.0, 0.0], ARM.nominal)
    assert uses_estimate(controller.law) is uses
    assert (own_estimate(controller.law) is not None) is adapts


def test_computed_torque_with_the_true_parameters_gives_the_wanted_acceleration():
    settings = door.ControllerSettings().resolved(joints=2)
    controllers = {law: door.Controller(ARM, law=law(ARM, settings), torque_rate_limit=1e12,
                                        torque_limit=1e6)
                   for law in (ProportionalDerivative, ComputedTorque)}
    q, qd, theta = np.array([0.02, -0.03]), np.array([0.3, 0.1]), ARM.nominal
    pull = -controllers[ProportionalDerivative].update(0.0, q, qd, theta).torque
    tau = controllers[ComputedTorque].update(0.0, q, qd, theta).torque
    np.testing.assert_allclose(ARM.dynamics(theta).acceleration(q, qd, tau),
                               -pull / joint_inertia(ARM, np.zeros(2)), rtol=1e-9)


@pytest.mark.parametrize(('law', 'message'), [
    ('magic', rf"'controller\.law' is 'magic'.*{', '.join(LAWS)}, module:name"),
    ('no_such_module:Law', 'ModuleNotFoundError'),
    ('foreign_law:Nobody', 'AttributeError')])
def test_a_law_that_is_not_there_is_named(stranger, law, message):
    with pytest.raises(door.ParameterError, match=message):
        door.Controller(ARM, door.ControllerSettings(law=law))
