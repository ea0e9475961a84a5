# SPDX-License-Identifier: Apache-2.0
"""Facts about ``import adaptive_blf_control``: what it offers, takes and refuses."""

from __future__ import annotations

import ast
import inspect
import re
import subprocess
import sys

import numpy as np
import pytest

import adaptive_blf_control as door
from adaptive_blf_control.arms.inverse_dynamics import inverse_dynamics
from patience import PATIENCE

ARM = door.TwoLinkArm()
PUBLIC = [name for name in dir(door) if name != '__version__']

ANNOTATED = re.compile(r'\[(s|rad|m|kg|N·m)|\((n|m|N|k|K)[,)]|\(N, n\)')
# Names that carry no arrays and no equation of their own.
PLAIN = {'ArmError', 'BagError', 'BlfError', 'LogError', 'MissingExtra', 'ParameterError',
         'UnknownParameter', 'list_arms', 'list_scenarios', 'load_arm', 'read_bag'}

ALONE = """
import importlib.abc, sys, time

class Refuse(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition('.')[0] in {refused}:
            raise ImportError(name + ' is refused')

sys.meta_path.insert(0, Refuse())
begin = time.process_time()  # of this process: other jobs do not count
{program}
print(time.process_time() - begin)
loaded = {refused} & {{name.partition('.')[0] for name in sys.modules}}
assert not loaded, loaded
"""
ROS = {'rclpy', 'sensor_msgs', 'std_msgs', 'rcl_interfaces'}
LEARN = """
import adaptive_blf_control as blf
arm = blf.TwoLinkArm()
identifier = blf.Identifier(arm)
identifier.learn([0.0, 0.01], [[0.0, 0.0]] * 2, [[0.0, 0.0]] * 2, [[0.0, 0.0]] * 2)
output = blf.Controller(arm).update(0.0, [0.0, 0.0], [0.0, 0.0], identifier.theta)
"""


def _alone(program: str, refused: set[str]) -> float:
    """Run a program for which some modules cannot be imported; return how long it took [s]."""
    done = subprocess.run([sys.executable, '-c', ALONE.format(program=program, refused=refused)],
                          capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 0, done.stderr
    return float(done.stdout)


def test_importing_it_needs_nothing_and_takes_no_time():
    heavy = ROS | {'numpy', 'numba', 'scipy', 'pinocchio', 'yaml', 'mcap', 'matplotlib', 'plotly'}
    assert min(_alone('import adaptive_blf_control', heavy) for _ in range(3)) < 0.2


def test_learning_and_control_need_numpy_and_yaml_alone():
    assert _alone(LEARN, ROS | {'numba', 'scipy', 'pinocchio', 'mcap', 'matplotlib'}) > 0.0


def test_an_arm_of_a_urdf_names_what_to_install_where_pinocchio_is_missing():
    program = """
import adaptive_blf_control as blf
try:
    blf.load_arm('robot.urdf')
except blf.MissingExtra as error:
    assert 'adaptive_blf_control[urdf]' in str(error), error
"""
    _alone(program, {'pinocchio'})


def test_dir_shows_the_public_names_and_nothing_else():
    assert dir(door) == sorted([*door._MODULES, '__version__'])  # private: the one list of them


def test_its_help_fits_on_two_screens_and_loads_nothing():
    program = """
import pydoc, sys
import adaptive_blf_control as blf
lines = pydoc.render_doc(blf, renderer=pydoc.plaintext).splitlines()
assert len(lines) < 80, len(lines)
assert any('simulate (a Simulation)' in line for line in lines)
"""
    _alone(program, {'rclpy'})


def test_the_page_of_the_door_names_all_it_offers_and_nothing_else(repository):
    page = (repository / 'docs/python.md').read_text(encoding='utf-8')
    tables = ''.join(line for line in page.splitlines() if line.startswith('|'))
    for name in PUBLIC:
        assert re.search(rf'`{name}\b', tables), name
    for name in re.findall(r'blf\.(\w+)', page):
        assert name in PUBLIC, name


def test_type_checkers_see_the_names_that_are_offered(repository):
    tree = ast.parse((repository / 'adaptive_blf_control/__init__.py').read_text('utf-8'))
    block, = (node for node in tree.body if isinstance(node, ast.If))
    seen = {alias.asname: node.module for node in ast.walk(block)
            if isinstance(node, ast.ImportFrom) for alias in node.names}
    assert {name: f'adaptive_blf_control.{module}'
            for name, module in door._MODULES.items()} == seen  # private: the lazy half of both


@pytest.mark.parametrize('name', PUBLIC)
def test_every_public_name_can_be_had_and_says_what_it_takes(name):
    public = getattr(door, name)
    text = inspect.getdoc(public) or ''
    assert len(text) > 20, name
    members = ([] if not inspect.isclass(public) else [
        getattr(public, key) for key in vars(public)
        if not key.startswith('_') or key == '__init__' and name not in PLAIN])
    texts = [text, *(inspect.getdoc(member) or '' for member in members)]
    if inspect.isfunction(public):
        takes = bool(inspect.signature(public).parameters)
        for part in (('Args:', 'Raises:')[:2 * takes]
                     + ('Returns:',) * (name not in PLAIN or not takes)):
            assert part in text, (name, part)
    if name not in PLAIN:
        assert ANNOTATED.search(' '.join(texts)), f'{name}: no shape and no unit'


def test_an_unknown_name_is_told_what_there_is():
    with pytest.raises(AttributeError, match=r"'identifyer': did you mean .*Identifier"):
        _ = door.identifyer
    with pytest.raises(AttributeError, match=r"'xyzzy': the nearest are (\w+, ){4}\w+; dir\(ad"):
        _ = door.xyzzy


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
     r"'q' is \[1\.0\]: expected shape \(2,\) \(one for each of joint1, joint2\), not \(1,\)"),
    (lambda: door.Identifier(ARM).update(0.0, [[0.0], [0.0]], [0.0, 0.0], [0.0, 0.0]),
     r"'q' is .*expected shape \(2,\).*, not \(2, 1\)"),
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
    (lambda: door.simulate({}, 0.01, controller={'k9': 1.0}), r'controller\.k9'),
])
def test_what_cannot_be_used_is_named_as_the_caller_wrote_it(call, message):
    with pytest.raises(door.ParameterError, match=message):
        call()


def test_a_scenario_runs_in_one_call(repository):
    run = door.simulate(repository / 'config' / 'two_link.yaml', 0.2,
                        controller={'k2': [30.0, 5.0]})
    assert run.kept
    assert run.t[-1] == pytest.approx(0.2)
    assert run.loop.controller.settings.k2.tolist() == [30.0, 5.0]
    assert 'KEPT' in repr(run)


def test_reprs_name_joints_and_progress():
    assert repr(ARM) == '<TwoLinkArm: 2 joints (joint1, joint2), 5 parameters>'
    assert 'rank 0 of 5' in repr(door.Identifier(ARM))
    assert 'safety' in repr(door.Controller(ARM))


def test_a_run_is_arrays_with_what_was_learned():
    run = door.simulate(ARM, 0.05, controller={'k2': 20}, identifier={'history': {'size': 9}})
    assert run.t.shape == (51,)
    assert run.q.shape == run.e1.shape == run.torque.shape == (51, 2)
    assert run.identifier.stack.size == 9
    assert list(run.identifier.estimate) == list(ARM.parameters)
    assert run.figures['samples'] == 51
    np.testing.assert_array_equal(run.theta_hat[-1], run.identifier.theta)


@pytest.mark.parametrize('given', [20, 20.0, np.float32(20.0), [20], [20.0, 20.0],
                                   np.array([20, 20]), (20.0, 20.0)])
def test_numbers_mean_the_same_however_a_program_writes_them(given):
    assert door.ControllerSettings(k2=given).resolved(joints=2).k2.tolist() == [20.0, 20.0]
    nested = door.simulate(ARM, 1e-3, controller={'k2': given})
    dotted = door.simulate(ARM, 1e-3, **{'controller.k2': given})
    for controller in (door.Controller(ARM, k2=given), nested.loop.controller,
                       dotted.loop.controller):
        assert controller.settings.k2.tolist() == [20.0, 20.0]


@pytest.mark.parametrize('changes', [
    {'history.size': 30}, {'history': {'size': 30}},
    {'history': door.IdentifierSettings(history={'size': 30}).history}])
def test_a_nested_setting_is_named_in_three_ways(changes):
    assert door.Identifier(ARM, **changes).settings.history.size == 30
    assert door.IdentifierSettings().replace(**changes).history.size == 30


def test_a_change_of_one_setting_of_a_group_leaves_the_others():
    settings = door.IdentifierSettings(history={'size': 30, 'epsilon': 0.2})
    history = door.Identifier(ARM, settings, history={'size': 40}).settings.history
    assert (history.size, history.epsilon) == (40, 0.2)


def test_a_reference_is_given_joint_by_joint_as_in_yaml():
    controller = door.Controller(ARM, reference={'joint2': {'amplitude': 0.5, 'frequency': 2.0}})
    assert controller.reference.at(0.0).velocity.tolist() == [0.0, 1.0]
    with pytest.raises(door.ParameterError, match=r"reference\.joint3'.*joint1, joint2"):
        door.Controller(ARM, reference={'joint3': {'amplitude': 0.5}})


def test_a_motion_begins_in_the_posture_that_is_given():
    controller = door.Controller(ARM, start=[0.5, -0.5])
    output = controller.update(0.0, [0.5, -0.5], [0.0, 0.0], np.zeros(5))
    np.testing.assert_array_equal(output.e1, 0.0)
    np.testing.assert_allclose(controller.reference.at(5.0).position, 0.0)
    with pytest.raises(door.SetViolation, match='joint1.*start position outside'):
        door.Controller(ARM, start=[4.0, 0.0])


def test_an_array_that_is_filled_again_counts_as_it_was():
    t, *states = _motion(300)
    first, second = (door.Identifier(ARM, filter={
        'state_order': 2, 'state_time_constant': 0.005}) for _ in range(2))
    first.learn(t, *states)
    buffers = [np.empty(2) for _ in states]
    for k, time in enumerate(t):
        for buffer, state in zip(buffers, states):
            buffer[:] = state[k]
        second.update(time, *buffers)
    np.testing.assert_array_equal(first.theta, second.theta)
    assert first.stack.count > 2


def test_a_log_of_arrays_is_read_from_a_mapping_or_a_file(tmp_path):
    t, q, qd, tau = _motion(50)
    log = door.read_log({'t': t.tolist(), 'q': q, 'qd': qd.astype(np.float32), 'tau': tau},
                        joints=['a', 'b'])
    assert log.joints == ('a', 'b')
    np.testing.assert_array_equal(log.tau, tau)
    np.savez(tmp_path / 'log.npz', t=t, q=q, qd=qd, tau=tau)
    again = door.read_log(tmp_path / 'log.npz')
    assert again.joints == ('joint1', 'joint2')
    np.testing.assert_array_equal(again.qd, qd)
    swapped = door.read_log(log, joints=['b', 'a'])
    np.testing.assert_array_equal(swapped.q, q[:, ::-1])


@pytest.mark.parametrize(('log', 'message'), [
    ({}, r"no array 't'"), ({'t': [0.0], 'q': [[0.0]], 'qd': [[0.0]]}, r"no array 'tau'"),
    ({'t': [0.0, 1.0], 'q': [[0.0]], 'qd': [[0.0]], 'tau': [[0.0]]}, r"'q'.*\(2, N\).*\(1, 1\)"),
    ({'t': [0.0, 1.0], 'q': [[0.0, 0.0]] * 2, 'qd': [0.0, 0.0], 'tau': [[0.0, 0.0]] * 2},
     r"'qd'.*\(2, 2\)"),
    ({'t': [0.0, 0.0], 'q': [[0.0]] * 2, 'qd': [[0.0]] * 2, 'tau': [[0.0]] * 2}, '1 usable rows')])
def test_arrays_that_are_no_log_are_named(log, message):
    with pytest.raises(door.LogError, match=message):
        door.read_log(log)


def test_an_identification_tells_names_and_predicts_what_it_never_saw():
    t, q, qd, tau = _motion(3000)
    result = door.identify({'t': t, 'q': q, 'qd': qd, 'tau': tau}, arm=ARM, train=(0.1, 1.5),
                           test=(2.0, None), filter={'time_constant': 0.01})
    assert result.estimate == pytest.approx(dict(zip(ARM.parameters, ARM.nominal)), rel=1e-3)
    assert (result.rank, result.undetermined) == (5, ())
    assert result.prediction.t[0] == pytest.approx(2.0)
    assert result.prediction.t[-1] == pytest.approx(2.999)
    np.testing.assert_allclose(result.prediction.predicted, result.prediction.measured, atol=1e-2)
    error = np.sqrt(np.mean((result.prediction.predicted - result.prediction.measured) ** 2, 0))
    np.testing.assert_allclose(result.test_rmse, error, rtol=1e-6, atol=1e-9)
    assert 'rank 5 of 5' in repr(result)
    same = door.identify(door.read_log({'t': t, 'q': q, 'qd': qd, 'tau': tau}), arm='two_link',
                         train='0.1:1.5', test='2:', **{'filter.time_constant': 0.01})
    np.testing.assert_array_equal(same.theta, result.theta)


def test_the_log_of_a_run_teaches_what_a_driver_s_log_would():
    swing = {'joint1': {'amplitude': 0.3, 'frequency': 2.0},
             'joint2': {'amplitude': 0.3, 'frequency': 3.1}}
    run = door.simulate(ARM, 3.0, reference=swing, controller={'k2': [30.0, 10.0]})
    log = run.log()
    assert (log.joints, log.dropped) == (ARM.joints, 0)
    np.testing.assert_array_equal(log.q, run.q)
    np.testing.assert_array_equal(log.tau[1:], run.torque[:-1])  # held over the interval before
    result = door.identify(log, ARM, filter={'time_constant': 0.02})
    np.testing.assert_allclose(result.theta, ARM.nominal, rtol=1e-4)
    assert result.notes == ()
    slow = door.identify(log, ARM, filter={'time_constant': 0.02}, gamma=1e-3)
    assert any('has not converged' in note for note in slow.notes)  # though all is determined
    noisy = door.simulate(ARM, 0.01, arm_driver={'sensors': {'torque_noise': 0.1}})
    np.testing.assert_array_equal(noisy.log().tau, noisy.measured.torque)
    assert abs(noisy.log().tau[1:] - noisy.torque[:-1]).max() > 0.01


@pytest.mark.parametrize(('given', 'name'), [
    ({'train': (8.0, 9.0)}, 'train'), ({'train': (0.0, 9.0)}, 'test'),
    ({'train': (0.2,)}, 'train'),
    ({'test': [None, 0.1]}, 'test'), ({'train': 'early'}, 'train')])
def test_a_span_that_cannot_be_used_is_named(given, name):
    t, q, qd, tau = _motion(1000)
    with pytest.raises(door.ParameterError, match=f"parameter '{name}' is .*the log goes from 0"):
        door.identify({'t': t, 'q': q, 'qd': qd, 'tau': tau}, arm=ARM,
                      filter={'time_constant': 0.01}, **given)


def test_a_log_teaches_an_arm_whose_joints_stand_in_another_order():
    t, q, qd, tau = _motion(300)
    log = door.read_log({'t': t, 'q': q, 'qd': qd, 'tau': tau}, joints=ARM.joints)
    theta = door.Identifier(ARM).learn(log)
    np.testing.assert_array_equal(
        door.Identifier(ARM).learn(log.of_joints(ARM.joints[::-1])), theta)
    with pytest.raises(door.LogError, match="no joint 'joint1': it has a, b; read_log.*=arm"):
        door.Identifier(ARM).learn(log.replace(joints=('a', 'b')))


def test_a_training_without_end_needs_no_log_to_be_refused():
    for train in (':', (0.5, None)):
        with pytest.raises(door.ParameterError, match="'test' is None: .*test='none' learns with"):
            door.identify('no such log', ARM, train=train)


def test_what_an_encoder_alone_looks_at_is_refused_without_one():
    for changes in ({'sensors': {'encoder_counts': 4096}}, {'arm_driver.sensors.gear_ratio': 1.0}):
        with pytest.raises(door.ParameterError, match="nothing where .*sensor='encoder'"):
            door.simulate(ARM, 0.01, **changes)
    said = 'arm_driver.sensors.encoder_counts is without effect'
    for model, notes in (('perfect', 1), ('encoder', 0)):
        in_file = {'/**/arm_driver': {'ros__parameters': {
            'sensors': {'model': model, 'encoder_counts': 4000}}}}
        run = door.simulate(in_file, 0.01)
        assert sum(note.startswith(said) for note in run.notes) == notes


@pytest.mark.parametrize(('q', 'theta', 'torque'), [
    ([np.nan, 0.0], ARM.nominal, [0.0, 0.0]), ([0.0, 0.0], [np.nan] * 5, [0.0, 0.0]),
    ([5.0, 0.0], ARM.nominal, [-10.0, 0.0])])
def test_a_controller_answers_a_state_that_cannot_be_used_as_its_help_says(q, theta, torque):
    controller = door.Controller(ARM, torque_limit=10.0)
    output = controller.update(0.0, q, [0.0, 0.0], theta)
    assert output.torque.tolist() == torque
    assert not min(controller.margins(output)) > 0.0 or not np.isfinite(theta).all()


class Massless(door.Arm):
    """An arm without anything to simulate it."""

    joints, parameters = ('a',), ('b',)

    def Y1(self, q, qd):
        return np.zeros((1, 1))

    Y2 = Y1

    def X(self, q, qd, alpha, alpha_dot):
        return qd.reshape(1, 1)


def test_an_own_arm_that_lacks_something_is_told_what():
    assert (Massless().n, Massless().m) == (1, 1)
    assert door.Identifier(Massless()).rank == 0
    with pytest.raises(door.ParameterError, match='Massless has no nominal'):
        door.simulate(Massless(), 0.1)
    with pytest.raises(door.ArmError, match='Massless has no link_points'):
        Massless().link_points([0.0])
    with pytest.raises(door.ParameterError, match="'arm' is <class.*expected a part with joints"):
        door.Identifier(int)


@pytest.mark.parametrize('method', ['Y1', 'Y2', 'X'])
def test_a_regressor_of_another_shape_is_refused_where_an_arm_is_taken(method):
    flat = type('Flat', (Massless,), {method: lambda self, *state: np.zeros(1)})()
    for call in (door.Identifier, door.Controller, door.simulate):
        with pytest.raises(door.ArmError, match=rf'Flat.{method} gives shape \(1,\): .*\(1, 1\)'):
            call(flat)
    listed = type('Flat', (Massless,), {method: lambda self, *state: [[0.0]]})()
    with pytest.raises(door.ArmError, match=rf'Flat.{method} gives \[\[0.0\]\]: expected a num'):
        door.Identifier(listed)


class Falling(door.ForwardDynamics):
    """q̈ = τ − 9.81."""

    def acceleration(self, q, qd, tau):
        return tau - 9.81


def test_own_dynamics_are_integrated_with_runge_kutta():
    q, qd = Falling().advance(np.array([1.0]), np.array([0.5]), np.array([0.81]), 0.2, 3)
    np.testing.assert_allclose(q, 1.0 + 0.5 * 0.2 - 4.5 * 0.2 ** 2, rtol=1e-13)
    np.testing.assert_allclose(qd, 0.5 - 9.0 * 0.2, rtol=1e-13)


@pytest.mark.parametrize(('answer', 'message'), [
    (None, "'Bad.answer' is None: expected a LawAnswer"),
    (door.LawAnswer([1.0], [0.0, 0.0], None), r"'torque' is \[1\.0\].*\(2,\).*joint1, joint2"),
    (door.LawAnswer([1.0, 0.0], 'fast', None), "'e2' is 'fast'"),
    (door.LawAnswer([1.0, 0.0], [0.0, 0.0], np.eye(2)), r"'regressor'.*\(2, 5\).*\(2, 2\)")])
def test_what_an_own_law_answers_wrongly_is_named(answer, message):
    class Bad(door.Law):
        def answer(self, sample):
            return answer

    with pytest.raises(door.ParameterError, match=message):
        door.simulate(ARM, 0.01, law=Bad())


def test_what_an_own_update_law_returns_wrongly_is_named():
    class Bad(door.UpdateLaw):
        def step(self, theta, dt, evidence):
            return theta[:2]

    with pytest.raises(door.ParameterError, match=r"'Bad\.step'.*\(5,\).*\(2,\)"):
        door.simulate(ARM, 0.01, update_law=Bad())


def test_own_parts_stand_beside_no_loop_that_was_joined_by_hand():
    loop = door.simulate(ARM, 1e-3).loop
    assert door.simulate(loop, 1e-3).t.size == 2
    with pytest.raises(door.ParameterError, match="'law' is 'pd': expected nothing"):
        door.simulate(loop, 1e-3, law='pd')


def test_theorem_2_is_said_of_its_own_law_alone():
    run = door.simulate(ARM, 0.01, law='pd')
    assert run.figures['guarantee'] is None
    assert 'is not about this law' in repr(run)
    assert 'V(0)' in repr(door.simulate(ARM, 0.01))
