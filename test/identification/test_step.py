# SPDX-License-Identifier: Apache-2.0
"""Facts about the step: one function, whether compiled or not, in blocks or sample by sample."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.arms.regressors import arrays_of
from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.compiled import handle
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.history_stack import HistoryStack
from adaptive_blf_control.identification.identifier import Identifier
from adaptive_blf_control.identification.settings import IdentifierSettings
from adaptive_blf_control.identification.step import Running, take_sample

ARM = TwoLinkArm()
SETTINGS = IdentifierSettings(
    kt=100.0, kh=100.0, initial_estimate=[0.0, 9.0, 6.0, 0.0, 0.0],
    filter={'settle': 3.0, 'state_order': 2, 'state_time_constant': 0.002},
    history={'size': 12}, excitation={'window': 0.1})


class ArmInPython(TwoLinkArm):
    """The same arm, whose regressors are methods alone."""

    def Y12(self, q, qd):
        return super().Y12(q, qd)


class StackInPython(HistoryStack):
    """The same stack, made as a plug-in is."""

    def __init__(self, arm, settings) -> None:
        chosen = settings.history
        super().__init__(arm.n, arm.m, chosen.size, chosen.epsilon, chosen.minimum_growth)


@pytest.fixture
def log(record):
    """Return a log as arrays: with a gap, a NaN, a stamp twice, a wild value and a clock jump."""
    t, q, qd, tau = (np.array(column) for column in zip(*record(steps=500)))
    keep = np.r_[0:150, 210:500, 100:260]
    t, q, qd, tau = t[keep], q[keep], qd[keep], tau[keep]
    q[40] = np.nan
    t[60] = t[59]
    tau[90] = 1e12
    return t, q, qd, tau


def by_samples(subject: Identifier, log, learning=None) -> Identifier:
    for k, sample in enumerate(zip(*log)):
        if learning is None or learning[k]:
            subject.update(*sample)
        else:
            subject.observe(*sample)
    return subject


def assert_same(one: Identifier, other: Identifier, tolerance: float = 0.0) -> None:
    for got, wanted in ((one.theta, other.theta), (one.pair[0], other.pair[0]),
                        (one.pair[1], other.pair[1]), (one.stack.gram, other.stack.gram),
                        (one.monitor.statistic, other.monitor.statistic)):
        np.testing.assert_allclose(got, wanted, rtol=tolerance, atol=tolerance)
    assert one.excitation == pytest.approx(other.excitation, rel=tolerance, abs=tolerance)
    assert (one.dropped, one.restarts, one.changes, one.settled) == (
        other.dropped, other.restarts, other.changes, other.settled)
    assert one.stack.insertions == other.stack.insertions > 12


def test_the_log_of_these_tests_has_what_it_is_meant_to_have(log):
    subject = by_samples(Identifier(ARM, SETTINGS), log)
    assert subject.dropped == {'not finite': 1, 'too large': 1, 'stamp repeated': 1,
                               'stamp went back': 0}
    assert subject.restarts == 4  # the start, the wild value, the gap, the clock
    assert subject.rank == 5


def test_a_log_in_blocks_teaches_what_it_teaches_sample_by_sample(log):
    subject = Identifier(ARM, SETTINGS)
    theta = subject.learn(*log)
    np.testing.assert_array_equal(theta, subject.theta)
    assert_same(subject, by_samples(Identifier(ARM, SETTINGS), log))


def test_blocks_show_the_pairs_and_learn_only_where_they_are_told(log):
    learning = np.arange(len(log[0])) < 300
    subject, other = (Identifier(ARM, SETTINGS) for _ in range(2))
    blocks = list(subject.learn_in_blocks(*log, learning, size=7))
    assert_same(subject, by_samples(other, log, learning))
    assert [block.samples.start for block in blocks] == list(range(0, len(log[0]), 7))
    usable = np.concatenate([block.usable for block in blocks])
    rows = np.concatenate([block.rows for block in blocks])
    again = Identifier(ARM, SETTINGS)
    for k, sample in enumerate(zip(*log)):
        dt = again.observe(*sample)
        np.testing.assert_array_equal(rows[k], np.column_stack(again.pair))
        if k < 200:  # later a change of the arm could make the other settle again
            assert usable[k] == (dt > 0.0 and again.settled)


@pytest.mark.parametrize('changes', [{}, {'update_law': 'gradient'}, {
    'history': {'noise': 0.1}, 'update_law': 'concurrent'}])
@pytest.mark.parametrize('parts', ['arm', 'stack'])
def test_parts_in_python_learn_what_compiled_ones_learn(log, parts, changes):
    settings = SETTINGS.replace(**changes)
    plain = (Identifier(ArmInPython(), settings) if parts == 'arm' else
             Identifier(ARM, settings, history_stack=StackInPython))
    assert plain.state is None
    compiled = Identifier(ARM, settings)
    assert compiled.state is not None
    assert_same(by_samples(plain, log), by_samples(compiled, log), 1e-9)
    blocks = (Identifier(ArmInPython(), settings) if parts == 'arm' else
              Identifier(ARM, settings, history_stack=StackInPython))
    blocks.learn(*log)
    assert_same(blocks, plain)


def test_an_identifier_knows_what_a_step_did_to_its_state(log):
    subject, other, term = Identifier(ARM, SETTINGS), Identifier(ARM, SETTINGS), np.zeros(5)
    state = subject.state
    running = handle(Running(arrays_of(ARM), state))
    for t, *sample in zip(*log):
        take_sample(running, t, *sample, term)
    assert_same(subject, by_samples(other, log))
    subject.retune(subject.settings.replace(kt=1.0))
    assert subject.state is not state


def test_a_stack_that_is_resized_by_hand_is_the_one_that_is_learned_from(log):
    subject = by_samples(Identifier(ARM, SETTINGS), log)
    subject.stack.resize(40)
    count, (t, q, qd, tau) = subject.stack.count, log
    by_samples(subject, (t + 1.0, q, qd, tau))
    assert subject.stack.count > count


@pytest.mark.parametrize(('changes', 'name'), [
    ({'t': [[0.0]]}, 't'), ({'q': np.zeros((3, 1))}, 'q'), ({'tau': np.zeros((2, 2))}, 'tau')])
def test_a_log_of_another_shape_is_refused_by_name(changes, name):
    log = {'t': np.arange(3.0), **{field: np.zeros((3, 2)) for field in ('q', 'qd', 'tau')}}
    with pytest.raises(ParameterError, match=f"'{name}'"):
        Identifier(ARM).learn(**{**log, **changes})
