# SPDX-License-Identifier: Apache-2.0
"""Facts about ``import adaptive_blf_control``: what it offers, takes and refuses."""

from __future__ import annotations

import inspect
import subprocess
import sys

import numpy as np
import pytest

import adaptive_blf_control as door
from adaptive_blf_control.arms.inverse_dynamics import inverse_dynamics
from patience import PATIENCE

ARM = door.TwoLinkArm()
PUBLIC = [name for name in dir(door) if name != '__version__']

IMPORTED = """
import sys, time
begin = time.perf_counter()
import adaptive_blf_control
took = time.perf_counter() - begin
heavy = {'numpy', 'numba', 'rclpy', 'pinocchio', 'scipy', 'yaml'} & set(sys.modules)
assert not heavy, heavy
print(took)
"""


def test_importing_it_loads_neither_ros_nor_numpy_nor_a_compiler():
    done = subprocess.run([sys.executable, '-c', IMPORTED], capture_output=True, text=True,
                          timeout=PATIENCE, check=True)
    assert float(done.stdout) >= 0.0


def test_dir_shows_the_public_names_and_nothing_else():
    assert set(PUBLIC) == set(door.__all__)
    assert 'importlib' not in dir(door)


@pytest.mark.parametrize('name', PUBLIC)
def test_every_public_name_can_be_had_and_is_documented(name):
    public = getattr(door, name)
    text = inspect.getdoc(public) or ''
    assert len(text) > 20, name
    if inspect.isfunction(public):
        assert 'Args:' in text
        assert 'Raises:' in text


def test_an_unknown_name_is_told_what_there_is():
    with pytest.raises(AttributeError, match=r"'identifyer'.*Identifier.*simulate"):
        _ = door.identifyer


def _motion(steps: int = 1500) -> tuple[np.ndarray, ...]:
    """Return t, q, qd, tau of the two-link arm under a rich torque held over each interval."""
    dynamics, q, qd = ARM.dynamics(ARM.nominal), np.array([0.0, 1.0]), np.zeros(2)
    rows = [(0.0, q, qd, np.zeros(2))]
    for k in range(1, steps):
        tau = np.array([8.0 * np.sin(3e-3 * k) + 4.0 * np.sin(11e-3 * k), 2.5 * np.cos(4e-3 * k)])
        q, qd = dynamics.advance(q, qd, tau, 1e-3, 4)
        rows.append((k * 1e-3, q, qd, tau))
    return tuple(np.array(column) for column in zip(*rows))


def test_a_log_teaches_named_parameters_and_predicts_torques():
    t, q, qd, tau = _motion()
    identifier = door.Identifier(ARM, kt=100.0, kh=100.0)
    identifier.learn(t, q, qd, tau)
    assert identifier.rank == 5
    assert identifier.undetermined == ()
    assert identifier.estimate == pytest.approx(dict(zip(ARM.parameters, ARM.nominal)), rel=1e-3)
    qdd = ARM.dynamics(ARM.nominal).acceleration(q[700], qd[700], tau[700])
    np.testing.assert_allclose(identifier.predict(q[700], qd[700], qdd), tau[700], rtol=1e-2)


def test_lists_and_float32_teach_what_arrays_teach():
    t, q, qd, tau = (values.astype(np.float32) for values in _motion(60))
    first, second, third = (door.Identifier(ARM) for _ in range(3))
    first.learn(*(values.astype(float) for values in (t, q, qd, tau)))
    second.learn(t, q, qd, tau)
    third.learn(t.tolist(), q.tolist(), qd.tolist(), tau.tolist())
    np.testing.assert_array_equal(first.theta, second.theta)
    np.testing.assert_array_equal(first.theta, third.theta)
    assert first.stack.count > 2


def test_a_motion_of_the_last_joint_leaves_the_rest_undetermined():
    identifier = door.Identifier(ARM)
    t = np.arange(0.0, 1.0, 1e-3)
    q = np.column_stack([np.zeros_like(t), np.sin(5.0 * t)])
    qd = np.column_stack([np.zeros_like(t), 5.0 * np.cos(5.0 * t)])
    identifier.learn(t, q, qd, np.ones_like(q))
    assert 'p2' not in identifier.undetermined
    assert 'fv_joint2' not in identifier.undetermined
    assert {'p1', 'fv_joint1'} <= set(identifier.undetermined)


def test_torques_of_many_samples_are_those_of_each():
    random = np.random.default_rng(0)
    q, qd, qdd = random.normal(size=(3, 4, 2))
    rows = inverse_dynamics(ARM, ARM.nominal, q, qd, qdd)
    for row, *sample in zip(rows, q, qd, qdd):
        np.testing.assert_allclose(row, inverse_dynamics(ARM, ARM.nominal, *sample), rtol=1e-14)
        back = ARM.dynamics(ARM.nominal).acceleration(sample[0], sample[1], row)
        np.testing.assert_allclose(back, sample[2], rtol=1e-9)


@pytest.mark.parametrize(('call', 'message'), [
    (lambda: door.Identifier(ARM).update(0.0, [1.0], [0.0, 0.0], [0.0, 0.0]),
     r"'q' is .*\(1,\).*\(2,\) \(one for each of joint1, joint2"),
    (lambda: door.Identifier(ARM).update(0.0, [0.0, 0.0], None, [0.0, 0.0]), r"'qd' is None"),
    (lambda: door.Identifier(ARM).update(0.0, [0.0, 0.0], [0.0, 0.0], 'high'), r"'tau' is 'high'"),
    (lambda: door.Identifier(ARM).update(0.0, [0.0, 0.0], [[0.0, 0.0]], [0.0, 0.0]), r"'qd'"),
    (lambda: door.Identifier(ARM).update(0.0, [0.0, 0.0], [0.0, 0.0], [0.0, 0.0], [1.0]),
     r"'adaptation_term'.*\(5,\)"),
    (lambda: door.Identifier(ARM).learn([0.0, 1.0], [[0.0, 0.0]], [[0.0, 0.0]], [[0.0, 0.0]]),
     r"'q'.*\(2, 2\)"),
    (lambda: door.Identifier(ARM).predict([0.0, 0.0], [0.0], [0.0, 0.0]), r"'qd'"),
    (lambda: door.Identifier(ARM, gamma=[1.0, 2.0]), r'identifier\.gamma.*length 1 or 5'),
    (lambda: door.Identifier(ARM, gama=1.0), r'identifier\.gama.*no such parameter.*gamma'),
    (lambda: door.Identifier(ARM, **{'history.size': 0}), r'history\.size.*>= 1'),
    (lambda: door.Controller(ARM, k1=0.0), r'controller\.k1'),
    (lambda: door.Controller(ARM, k3=1.0), r'controller\.k3.*no such parameter'),
    (lambda: door.Controller(ARM).update(0.0, [0.0], [0.0, 0.0], [0.0] * 5), r"'q'"),
    (lambda: door.Controller(ARM).update(0.0, [0.0, 0.0], [0.0, 0.0], [0.0]), r"'theta'.*\(5,\)"),
    (lambda: door.simulate({}, duration=-1.0), r"'duration' is -1\.0"),
    (lambda: door.simulate({}, 0.01, {'controller.k9': 1.0}), r'controller\.k9'),
])
def test_what_cannot_be_used_is_named_as_the_caller_wrote_it(call, message):
    with pytest.raises(door.ParameterError, match=message):
        call()


def test_a_scenario_runs_in_one_call(repository):
    run = door.simulate(repository / 'config' / 'two_link.yaml', 0.2,
                        {'controller.k2': [30.0, 5.0]})
    assert run.kept
    assert run.trace.t[-1] == pytest.approx(0.2)
    assert run.loop.controller.settings.k2.tolist() == [30.0, 5.0]
    assert 'KEPT' in repr(run)


def test_reprs_name_joints_and_progress():
    assert repr(ARM) == '<TwoLinkArm: 2 joints (joint1, joint2), 5 parameters>'
    assert 'rank 0 of 5' in repr(door.Identifier(ARM))
    assert 'safety' in repr(door.Controller(ARM))
