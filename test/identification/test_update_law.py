# SPDX-License-Identifier: Apache-2.0
"""Facts about the implicit step of the update law (22), (37) and Theorem 1."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.identification.update_law import (
    advance,
    implicit_step,
    kept_history,
)

hypothesis = pytest.importorskip('hypothesis')
st = hypothesis.strategies

N, M, P = 2, 5, 7
THETA = np.array([3.473, 0.196, 0.242, 5.3, 1.1])


class Data:
    """A present pair and a history of random data, consistent with THETA."""

    def __init__(self, seed: int = 0, scale: float = 1.0, pairs: int = P) -> None:
        random = np.random.default_rng(seed)
        self.yf = scale * random.normal(size=(N, M))
        self.tf = self.yf @ THETA
        history = scale * random.normal(size=(pairs, N, M))
        self.gram = np.einsum('pni,pnj->ij', history, history)
        self.moment = np.einsum('pni,pn->i', history, history @ THETA)
        self.theta = random.normal(scale=5.0, size=M)
        self.gamma = random.uniform(0.2, 3.0, M)
        self.term = random.normal(size=M)

    def step(self, theta, dt, kt, kh, term=None):
        return implicit_step(theta, dt, self.gamma, kt, kh, self.yf, self.tf, self.gram,
                             self.moment, np.zeros(M) if term is None else term)

    def rate(self, theta, kt, kh, term):
        """Right-hand side of (37), term by term."""
        return -self.gamma * (term + kt * self.yf.T @ (self.yf @ theta - self.tf)
                              + kh * (self.gram @ theta - self.moment))

    def lyapunov(self, theta):
        """V_cl of (53)."""
        return 0.5 * np.sum((theta - THETA) ** 2 / self.gamma)


@pytest.mark.parametrize(('kt', 'kh', 'with_term'),
                         [(3.0, 0.7, True), (3.0, 0.0, False), (0.0, 0.7, False),
                          (0.0, 0.0, True)])
def test_a_step_is_implicit_euler_of_equation_37(kt, kh, with_term):
    for seed in range(20):
        data, dt = Data(seed), 0.05
        term = data.term if with_term else np.zeros(M)
        new = data.step(data.theta, dt, kt, kh, term)
        np.testing.assert_allclose(new, data.theta + dt * data.rate(new, kt, kh, term),
                                   rtol=1e-10, atol=1e-10)


def test_many_small_steps_follow_the_differential_equation():
    data, duration, errors = Data(), 0.3, []
    matrix = np.zeros((M + 1, M + 1))
    matrix[:M, M] = data.rate(np.zeros(M), 3.0, 0.7, data.term)
    matrix[:M, :M] = np.column_stack(
        [data.rate(unit, 3.0, 0.7, data.term) for unit in np.eye(M)]) - matrix[:M, M:]
    exponential = np.linalg.matrix_power(np.eye(M + 1) + matrix * duration / 2 ** 30, 2 ** 30)
    exact = (exponential @ np.append(data.theta, 1.0))[:M]
    for steps in (1000, 2000):
        theta = data.theta
        for _ in range(steps):
            theta = data.step(theta, duration / steps, 3.0, 0.7, data.term)
        errors.append(np.linalg.norm(theta - exact))
    assert errors[1] < 5e-3 * np.linalg.norm(exact - data.theta)
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.05)


def test_papers_gains_diverge_with_an_explicit_step_and_converge_with_this_one():
    data = Data(scale=5.0)
    data.gamma = np.ones(M)
    explicit = implicit = np.array([0.0, 9.0, 6.0, 0.0, 0.0])
    for _ in range(10):
        explicit = explicit + 1e-3 * data.rate(explicit, 200.0, 0.001, np.zeros(M))
        before = data.lyapunov(implicit)
        implicit = data.step(implicit, 1e-3, 200.0, 0.001)
        assert data.lyapunov(implicit) < before
    assert np.linalg.norm(explicit - THETA) > 1e3


@hypothesis.given(seed=st.integers(0, 10_000), scale=st.floats(1e-3, 1e2),
                  kt=st.floats(0.0, 1e4), kh=st.floats(0.0, 1e4), dt=st.floats(1e-6, 1.0),
                  pairs=st.integers(1, 7))
def test_consistent_data_never_let_the_lyapunov_function_of_theorem_1_grow(seed, scale, kt, kh, dt,
                                                                           pairs):
    data = Data(seed, scale, pairs)
    theta = data.theta
    size = 1.0 + dt * 3.0 * (kt * np.sum(data.yf ** 2) + kh * np.trace(data.gram))
    rounding = 100.0 * np.finfo(float).eps * size
    for _ in range(5):
        new = data.step(theta, dt, kt, kh)
        assert data.lyapunov(new) <= data.lyapunov(theta) * (1.0 + rounding) + rounding
        theta = new


@pytest.mark.parametrize('gain', [1e3, 1e9, 1e15])
def test_huge_gains_reach_the_solution_and_stay(gain):
    data = Data()
    theta = data.theta
    for _ in range(3):
        theta = data.step(theta, 1e-3, gain, gain)
    np.testing.assert_allclose(theta, THETA, rtol=1e-3 if gain > 1e3 else 0.2, atol=1e-3)
    for _ in range(100):
        theta = data.step(theta, 1e-3, gain, gain)
    np.testing.assert_allclose(theta, THETA, rtol=1e-6)


def test_true_parameters_are_a_fixed_point():
    np.testing.assert_allclose(Data().step(THETA, 0.1, 10.0, 10.0), THETA, rtol=1e-12)


def test_without_data_only_the_adaptation_term_moves_the_estimate():
    data = Data()
    np.testing.assert_allclose(data.step(data.theta, 0.1, 0.0, 0.0, data.term),
                               data.theta - 0.1 * data.gamma * data.term)


def test_directions_the_data_do_not_show_are_kept():
    data = Data()
    data.gram, data.moment, data.gamma = np.zeros((M, M)), np.zeros(M), np.ones(M)
    hidden = np.linalg.svd(data.yf)[2][N:]
    new = data.step(data.theta, 1.0, 1e4, 0.0)
    np.testing.assert_allclose(hidden @ new, hidden @ data.theta, atol=1e-9)
    np.testing.assert_allclose(data.yf @ new, data.tf, rtol=1e-3, atol=1e-2)


def test_a_step_leaves_its_arguments_alone():
    data = Data()
    before = data.theta.copy()
    new = data.step(data.theta, 0.1, 10.0, 10.0)
    np.testing.assert_array_equal(data.theta, before)
    assert new is not data.theta


def dense_step(theta, dt, gamma, kt, kh, yf, tf, gram, moment, term):
    """The same step by one solve of m equations."""
    information = kt * yf.T @ yf + kh * gram
    slope = kt * yf.T @ tf + kh * moment - term - information @ theta
    return theta + np.linalg.solve(np.diag(1.0 / gamma) + dt * information, dt * slope)


@hypothesis.given(seed=st.integers(0, 10_000), n=st.integers(1, 7), m=st.integers(1, 50),
                  rows=st.integers(0, 60), kt=st.sampled_from([0.0, 1.0, 1e3]),
                  kh=st.sampled_from([0.0, 1.0, 1e3]), decades=st.floats(0.0, 2.0))
def test_a_step_is_that_of_a_dense_solve(seed, n, m, rows, kt, kh, decades):
    random = np.random.default_rng(seed)
    history = random.normal(size=(rows, m)) * 10.0 ** random.uniform(-decades, decades, m)
    yf, truth = random.normal(size=(n, m)), random.normal(size=m)
    step = (random.normal(size=m), 1e-2, random.uniform(0.1, 10.0, m), kt, kh, yf, yf @ truth,
            history.T @ history, history.T @ (history @ truth), random.normal(size=m))
    np.testing.assert_allclose(implicit_step(*step), dense_step(*step), rtol=1e-8, atol=1e-8)


def test_what_is_kept_follows_the_history_and_gamma_and_serves_every_step_and_gain():
    kept, theta, data = kept_history(N, M), Data().theta.copy(), Data()
    for change in ('nothing', 'one element of G', 'Γ', 'dt', 'kt', 'kh', 'pair', 'all of G'):
        dt, kt, kh = 0.05, 3.0, 0.7
        if change == 'one element of G':
            data.gram[2, 2] *= 1.5
        elif change == 'Γ':
            data.gamma[1] *= 2.0
        elif change == 'dt':
            dt = 0.01
        elif change == 'kt':
            kt = 0.0
        elif change == 'kh':
            kh = 70.0
        elif change == 'pair':
            data.yf = data.yf[::-1].copy()
        elif change == 'all of G':
            data = Data(1)
        step = (dt, data.gamma, kt, kh, data.yf, data.tf, data.gram, data.moment, data.term)
        expected = implicit_step(theta, *step)
        advance(kept, theta, *step)
        np.testing.assert_array_equal(theta, expected, err_msg=change)
