# SPDX-License-Identifier: Apache-2.0
"""Facts that tell the update laws (20), (22) and (37) apart, and about Remark 3."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import adaptive_blf_control as door
from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.artificial_noise import NoisyHistory, offer_with_noise
from adaptive_blf_control.identification.identifier import Identifier
from adaptive_blf_control.identification.rank_condition import rank_warning
from adaptive_blf_control.identification.settings import IdentifierSettings


def named(**values):
    """Return values by parameter name; ``__`` stands for a dot."""
    return {name.replace('__', '.'): value for name, value in values.items()}


ARM, DT = TwoLinkArm(), 1e-3
SETTINGS = IdentifierSettings.from_values(named(
    initial_estimate=np.zeros(5), gamma=np.ones(5), kt=1.0, kh=1.0,
    filter__time_constant=0.01, filter__gap=0.1, filter__settle=0.0, history__size=10,
    history__epsilon=0.1, change__window=0.0, excitation__window=0.0))


def swing(t: float) -> np.ndarray:
    """Return a torque that moves both joints."""
    return np.array([20.0 * np.sin(9.0 * t), 3.0 * np.cos(17.0 * t)])


def learn(identifier: Identifier, duration: float, torque=swing, start: float = 0.0,
          term: np.ndarray | None = None) -> np.ndarray:
    """Feed the two-link arm under ``torque`` from rest."""
    plant = ARM.dynamics(ARM.nominal)
    q, qd, tau = np.zeros(2), np.zeros(2), np.zeros(2)
    for k in range(round(duration / DT)):
        identifier.update(start + k * DT, q, qd, tau, term)
        tau = torque(k * DT)
        q, qd = plant.advance(q, qd, tau, DT, 1)
    return identifier.theta


def identifier(**changes) -> Identifier:
    return Identifier(ARM, SETTINGS.replace(**named(**changes)))


def error(theta: np.ndarray) -> float:
    return float(np.linalg.norm(theta - ARM.nominal))


def test_after_the_motion_has_stopped_only_recorded_data_go_on_teaching():
    def short(t: float) -> np.ndarray:
        return swing(t) if t < 0.5 else np.zeros(2)

    errors = {}
    for law in ('gradient', 'concurrent'):
        errors[law] = [error(learn(identifier(update_law=law, kh=0.1), duration, short))
                       for duration in (2.0, 20.0)]
    assert errors['gradient'][1] == pytest.approx(errors['gradient'][0], rel=1e-3)
    assert errors['gradient'][1] > 1.0
    assert errors['concurrent'][1] < 0.05 * errors['concurrent'][0]


def test_excitation_index_falls_to_zero_when_the_motion_stops_while_the_rank_stays():
    subject = identifier(excitation__window=0.5)
    learn(subject, 1.0)
    assert subject.excitation > 1e-3
    moved, rank = subject.excitation, subject.stack.rank
    still = np.zeros(2)
    for k in range(1000, 3000):
        subject.update(k * DT, still, still, still)
    assert subject.excitation < 1e-9 * moved
    assert subject.stack.rank == rank == 5


def test_gradient_law_does_not_use_the_recorded_pairs():
    np.testing.assert_array_equal(learn(identifier(update_law='gradient'), 0.5),
                                  learn(identifier(update_law='gradient', kh=1e4), 0.5))
    assert not np.array_equal(learn(identifier(update_law='concurrent'), 0.5),
                              learn(identifier(update_law='concurrent', kh=1e4), 0.5))


@pytest.mark.parametrize('law', ['gradient', 'concurrent'])
def test_only_the_law_with_the_barrier_hears_the_adaptation_term(law):
    term = np.array([0.1, -0.2, 0.3, 0.0, 0.5])
    np.testing.assert_array_equal(learn(identifier(update_law=law), 0.3, term=term),
                                  learn(identifier(update_law=law), 0.3))


def test_without_data_theta_follows_the_adaptation_term_alone():
    term = np.array([0.1, -0.2, 0.3, 0.0, 0.5])
    gamma = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    subject = identifier(kt=0.0, kh=0.0, gamma=gamma)
    np.testing.assert_allclose(learn(subject, 0.3, term=term), -0.299 * gamma * term, rtol=1e-12,
                               atol=1e-14)


def test_concurrent_law_is_the_barrier_law_without_its_term():
    np.testing.assert_array_equal(learn(identifier(update_law='concurrent'), 0.3),
                                  learn(identifier(update_law='ablf_concurrent'), 0.3))


def test_an_unknown_law_is_refused_by_name():
    with pytest.raises(ParameterError, match='update_law'):
        identifier(update_law='newton')


# -- Remark 3 -----------------------------------------------------------------------------------


def poor_samples(subject: Identifier, count: int, start: int = 0) -> None:
    """Feed what no two-link arm learns its five parameters from: joint 1 alone, q2 = 0."""
    p1, _, p3, f1, _ = ARM.nominal
    inertia = p1 + 2.0 * p3
    for k in range(start, start + count):
        t = k * DT
        qd, qdd = np.sin(3.0 * t), 3.0 * np.cos(3.0 * (t - 0.5 * DT))
        mean_qd = np.sin(3.0 * (t - 0.5 * DT))
        tau = np.array([inertia * qdd + f1 * mean_qd, (ARM.nominal[1] + p3) * qdd])
        subject.update(t, np.array([-np.cos(3.0 * t) / 3.0, 0.0]), np.array([qd, 0.0]), tau)


def test_noise_lends_full_rank_to_a_motion_that_lacks_it_and_says_so():
    subject = identifier(history__noise=0.1, update_law='concurrent')
    poor_samples(subject, 2000)
    assert subject.stack.rank < 5
    assert subject.artificial_noise
    plain = identifier(update_law='concurrent')
    poor_samples(plain, 2000)
    assert not plain.artificial_noise
    assert subject.theta[4] != 0.0  # friction of a joint that never moved: made up
    assert abs(plain.theta[4]) < 1e-12


def test_pairs_with_artificial_noise_are_gone_once_measured_pairs_have_full_rank():
    subject = identifier(history__noise=0.3, update_law='concurrent', kt=100.0, kh=100.0)
    poor_samples(subject, 1000)
    assert error(subject.theta) > 1.0
    subject.restart()
    learn(subject, 2.0, start=1.1)
    assert subject.stack.rank == 5
    assert not subject.artificial_noise
    assert error(subject.theta) < 1e-2


def test_measured_stack_is_the_same_with_and_without_noise():
    with_noise, without = identifier(history__noise=0.3), identifier()
    for subject in (with_noise, without):
        poor_samples(subject, 500)
    np.testing.assert_array_equal(with_noise.stack.regressors, without.stack.regressors)


def test_equal_seeds_give_equal_noise_and_other_seeds_other():
    def theta(seed: int) -> np.ndarray:
        subject = identifier(history__noise=0.1, history__noise_seed=seed)
        poor_samples(subject, 500)
        return subject.theta

    np.testing.assert_array_equal(theta(1), theta(1))
    assert not np.array_equal(theta(1), theta(2))


def test_noise_ends_when_its_own_stack_has_full_rank():
    history = NoisyHistory(2, 5, size=8, epsilon=0.1, deviation=0.1, seed=0)
    random = np.random.default_rng(1)
    for _ in range(50):
        regressor = np.zeros((2, 5))
        regressor[0, 0] = random.normal()
        offer_with_noise(history.arrays, regressor, np.zeros(2), 0)
    assert history.stack.rank == 5
    assert history.noisy == 3  # two rows each


def test_a_reset_history_begins_with_noise_again():
    subject = identifier(history__noise=0.1)
    learn(subject, 0.5)
    assert not subject.artificial_noise
    subject.reset_history()
    poor_samples(subject, 100, start=600)
    assert subject.artificial_noise


@pytest.mark.parametrize('noise', [-0.1, np.nan, np.inf])
def test_unusable_noise_is_refused_by_name(noise):
    with pytest.raises(ParameterError, match='history.noise'):
        identifier(history__noise=noise)


# -- P against m ---------------------------------------------------------------------------------


def test_as_many_pairs_as_parameters_raise_no_warning():
    assert rank_warning(SETTINGS, 2, 10) is None


def test_fewer_pairs_than_parameters_are_warned_of_with_the_numbers():
    warning = rank_warning(SETTINGS, 2, 11)
    assert 'P = 10' in warning
    assert 'm = 11' in warning
    assert 'possible with its 20 rows' in warning


def test_fewer_rows_than_parameters_are_told_to_be_hopeless():
    assert 'cannot exceed 20 of 43' in rank_warning(SETTINGS, 2, 43)


@pytest.fixture
def stranger(monkeypatch):
    """Return the name of an update law outside the package."""
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    return 'foreign_update_law:LeastSquares'


def test_a_strangers_law_that_is_named_moves_the_estimate(stranger):
    subject = identifier(update_law=stranger)
    assert error(learn(subject, 2.0)) < 1e-3 * np.linalg.norm(ARM.nominal)


def test_a_strangers_law_learns_in_the_closed_loop(repository, stranger):
    run = door.simulate(repository / 'config' / 'two_link.yaml', 3.0,
                        identifier={'update_law': stranger})
    assert run.kept
    assert error(run.theta_hat[-1]) < 0.01 * np.linalg.norm(ARM.nominal)


def test_a_law_that_is_passed_in_is_asked_once_a_sample_through_a_change_of_the_settings():
    class Still:
        asked = 0

        def step(self, theta, dt, evidence):
            self.asked += 1
            return theta

    law = Still()
    subject = Identifier(ARM, SETTINGS, law)
    learn(subject, 0.05)
    subject.retune(subject.settings.replace(kt=3.0))
    learn(subject, 0.05, start=1.0)
    assert law.asked == 2 * 49
    np.testing.assert_array_equal(subject.theta, np.zeros(5))


@pytest.mark.parametrize(('law', 'message'), [
    ('guess', r"update_law' is 'guess'.*ablf_concurrent, module:name"),
    ('foreign_update_law:NoLaw', 'NoLaw has no step'),
    ('no_such_module:Law', 'ModuleNotFoundError')])
def test_an_update_law_that_is_not_there_is_named(stranger, law, message):
    with pytest.raises(ParameterError, match=message):
        identifier(update_law=law)
