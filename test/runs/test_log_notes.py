# SPDX-License-Identifier: Apache-2.0
"""Facts about what is said of standard deviations that are not to be trusted."""

from __future__ import annotations

import functools

import pytest

import adaptive_blf_control as door

ENCODER = {'model': 'encoder', 'torque_noise': 0.1}


@functools.cache
def learned(duration: float, noisy: bool) -> door.Identification:
    changes = {'sensors': ENCODER} if noisy else {}
    run = door.simulate('two_link', duration, **changes)
    return door.identify(run, run.arm)


def largest_error(result: door.Identification) -> float:
    """Return the largest error of a parameter, as part of it."""
    truth = door.simulate('two_link', 0.001).plant.truth(result.arm.parameters)[0][1]
    return abs(result.theta / truth - 1.0).max()


@pytest.mark.parametrize(('duration', 'noisy', 'words'), [
    (2.0, False, ('has not converged', 'count as 5 independent equations for 5 parameters')),
    (2.0, True, ('count as 5 independent equations for 5 parameters',)),
    (5.0, True, ('of the tested torques of joint1 are inside their 95 % intervals',))])
def test_a_short_log_that_says_determined_of_what_is_far_off_is_noted(duration, noisy, words):
    result = learned(duration, noisy)
    assert set(result.figures['confidence'].values()) == {'determined'}
    assert largest_error(result) > 0.18
    assert len(result.notes) == len(words)
    for note, said in zip(result.notes, words):
        assert said in note
        assert f'note: {note}' in repr(result)


def test_a_log_whose_effort_has_the_opposite_sign_is_noted():
    run = door.simulate('two_link', 20.0)
    log = run.log()
    turned = door.identify({'t': log.t, 'q': log.q, 'qd': log.qd, 'tau': -log.tau}, arm=run.arm)
    assert 'θ̂ is that of no robot: M(q) > 0 at none of 1000 postures' in ''.join(turned.notes)


def test_a_log_that_is_long_enough_has_no_note():
    for noisy in (False, True):
        result = learned(20.0, noisy)
        assert largest_error(result) < 0.06
        assert result.notes == ()
        assert 'note:' not in repr(result)


@pytest.mark.parametrize(('log', 'urdf'), [
    ('panda_gaz2019/panda_exciting_traj.csv', 'panda_gaz2019/panda_gaz2019.urdf'),
    ('ur10_unisa2025/ur10_exciting.csv', 'ur10_unisa2025/ur10_dh.urdf')])
def test_the_logs_of_real_robots_have_no_note(realdata, log, urdf):
    pytest.importorskip('pinocchio')
    assert door.identify(realdata / log, realdata / urdf).notes == ()
