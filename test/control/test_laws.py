# SPDX-License-Identifier: Apache-2.0
"""Facts about laws as parts: named in a parameter, passed in, or a stranger's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import adaptive_blf_control as door
from adaptive_blf_control.control.laws import AblfLaw, ComputedTorque, ProportionalDerivative
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


def test_computed_torque_with_the_true_parameters_gives_the_wanted_acceleration():
    settings = door.ControllerSettings().resolved(joints=2)
    controllers = {law: door.Controller(ARM, law=law(ARM, settings), torque_rate_limit=1e12,
                                        torque_limit=1e6)
                   for law in (ProportionalDerivative, ComputedTorque)}
    q, qd, theta = np.array([0.02, -0.03]), np.array([0.3, 0.1]), ARM.nominal
    pull = -controllers[ProportionalDerivative].update(0.0, q, qd, theta).torque
    tau = controllers[ComputedTorque].update(0.0, q, qd, theta).torque
    mass = np.column_stack([ARM.Y1(q, unit) @ theta for unit in np.eye(2)])
    np.testing.assert_allclose(ARM.dynamics(theta).acceleration(q, qd, tau),
                               -pull / np.diag(mass), rtol=1e-9)


@pytest.mark.parametrize(('law', 'message'), [
    ('magic', r"'controller\.law' is 'magic'.*ablf, pd, computed_torque, module:name"),
    ('no_such_module:Law', 'ModuleNotFoundError'),
    ('foreign_law:Nobody', 'AttributeError')])
def test_a_law_that_is_not_there_is_named(stranger, law, message):
    with pytest.raises(door.ParameterError, match=message):
        door.Controller(ARM, door.ControllerSettings(law=law))
