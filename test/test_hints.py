# SPDX-License-Identifier: Apache-2.0
"""What is not there is refused with what to write instead: attributes, classes, items, topics."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
import pytest

import adaptive_blf_control as door

ARM = door.TwoLinkArm()
T = np.arange(0.0, 0.1, 1e-3)
Q = np.column_stack([np.sin(3.0 * T), np.cos(2.0 * T)])
LOG = {'t': T, 'q': Q, 'qd': Q, 'tau': Q}
SWING = door.SumOfSinusoids([0.0, 1.0], [0.1, 0.2], 2.0)

PENDULUM = (
    '<robot name="r"><link name="base"/><link name="rod"><inertial><mass value="1"/>'
    '<origin xyz="0 0 -0.2"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/>'
    '</inertial></link><joint name="pivot" type="continuous"><parent link="base"/>'
    '<child link="rod"/><axis xyz="0 1 0"/></joint></robot>')


class Halves(door.Constraint):
    """A constraint that was only begun."""

    def margin(self, q):
        return 1.0 - q


class Answerless(door.Constraint):
    """A constraint that forgets to answer."""

    name = quantity = 'half'
    unit, recovery, bodies = 'rad', 'go back', ('joint1',)

    def bounded(self, state):
        pass


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    path = tmp_path_factory.mktemp('hints') / 'run'
    door.simulate(ARM, 0.02, bag=path)
    return door.read_bag(path)


@functools.cache
def run():
    return door.simulate(ARM, 0.01)


@functools.cache
def learned():
    t = np.arange(0.0, 0.5, 1e-3)
    q = np.column_stack([np.sin(3.0 * t), np.cos(2.0 * t)])
    qd = np.column_stack([3.0 * np.cos(3.0 * t), -2.0 * np.sin(2.0 * t)])
    return door.identify({'t': t, 'q': q, 'qd': qd, 'tau': q}, ARM,
                         filter={'time_constant': 0.01})


@pytest.mark.parametrize(('subject', 'name', 'hint'), [
    (lambda: door.Identifier, 'load', "initial_estimate='theta.yaml'"),
    (lambda: door.Identifier, 'from_yaml', r'simulate\(file, 0\.001\)\.identifier'),
    (lambda: door.Identifier, 'fit', r'did you mean learn\?'),
    (lambda: door.Identifier, 'kt', r'settings\.kt has it'),
    (lambda: door.Controller, 'from_yaml', r'simulate\(file, 0\.001\)\.controller'),
    (lambda: door.ControllerSettings, 'from_yaml', r'from_values\(values\)'),
    (lambda: door.Simulation, 'load', r'numpy\.load'),
    (lambda: door.Identification, 'load', 'initial_estimate=path'),
    (lambda: door.Identification, 'theta_hat', 'theta is the estimate'),
    (lambda: door.Arm, 'from_urdf', r'load_arm\(urdf\) returns the arm'),
    (lambda: door.UrdfArm, 'from_file', r'load_arm\(urdf\) returns the arm'),
    (lambda: door.TwoLinkArm, 'M', r'Y1\(q, e\) @ theta')])
def test_a_class_says_what_its_objects_would(subject, name, hint):
    with pytest.raises(AttributeError, match=f"has no attribute '{name}': .*{hint}"):
        getattr(subject(), name)


def test_what_an_object_of_a_class_will_have_is_plainly_missing_in_the_class():
    with pytest.raises(AttributeError, match=r"^Identification has no attribute 'identifier'$"):
        _ = door.Identification.identifier


@pytest.mark.parametrize(('subject', 'name', 'hint'), [
    (lambda: ARM, 'M', r'Y1\(q, e\) @ theta'), (lambda: ARM, 'G', 'inverse_dynamics'),
    (lambda: ARM, 'coriolis', r'C qd \+ G \+ F qd'), (lambda: ARM, 'friction', 'nominal'),
    (lambda: door.Identifier(ARM), 'is_converged', r'rank == arm\.m'),
    (lambda: door.Identifier(ARM), 'condition_number', "figures\\['condition'\\]"),
    (lambda: door.Identifier(ARM), 'covariance', 'identify.*uncertainty'),
    (lambda: door.Identifier(ARM), 'learning_rate', r'did you mean settings\.gamma\?'),
    (lambda: door.Identifier(ARM), 'set_parameters', r'did you mean retune\?'),
    (lambda: door.Identifier(ARM), 'theta_dict', r'did you mean estimate\?'),
    (lambda: door.Controller(ARM), 'reset', r'begin\(q, qd\) begins another motion'),
    (lambda: door.Controller(ARM), 'kp', r'did you mean settings\.k1\?'),
    (lambda: door.IdentifierSettings(), 'to_dict', r'values\(\)'),
    (lambda: door.read_log(LOG), 'duration', r't\[-1\] - t\[0\]'),
    (lambda: door.read_log(LOG), 'to_csv', r'numpy\.savez'),
    (lambda: SWING, 'y_d', r'at\(t\) has position'), (lambda: SWING, 'bounds', r'range\(\)'),
    (run, 'true_parameters', r'plant\.truth\(run\.parameters\)'),
    (run, 'q_desired', r'did you mean reference\?'), (run, 'energy', r'controller\.lyapunov'),
    (lambda: ARM, 'torque', r'inverse_dynamics\(arm'),
    (lambda: ARM, 'kinematics', r'did you mean link_points\?'),
    (lambda: ARM, 'theta0', r'did you mean nominal\?'),
    (lambda: door.Controller(ARM), 'is_safe', r'did you mean margins\?'),
    (lambda: door.Controller(ARM), 'barrier', r'did you mean lyapunov\?'),
    (lambda: learned(), 'confidence_interval', r'1\.96 std'),
    (lambda: learned(), 'identifiable', 'undetermined names the others'),
    (lambda: learned().prediction, 'residual', 'measured - predicted'),
    (lambda: door.LawSample(*[None] * 7), 'e1', r'q - reference\.position'),
    (run, 'theta_tilde', r'theta_hat - plant\.truth'),
    (run, 'k2', r'controller\.settings\.k2'), (run, 'to_bag', r"bag='run'\) writes one"),
    (run, 'truth', r'plant\.truth\(\) has'), (lambda: run().plant, 'theta', r'truth\(\) has'),
    (lambda: learned(), 'weakly', r"figures\['confidence'\]"),
    (lambda: door.Identifier(ARM), 'rmse', r'test_rmse and prediction'),
    (lambda: door.Identifier(ARM), 'history', r'stack has the recorded pairs'),
    (lambda: door.Identifier(ARM), 'pairs', r'stack\.regressors'),
    (lambda: learned(), 'report', 'html'),
    (lambda: door.read_log(LOG), 'between', r'train=\(1\.0, 5\.0\)'),
    (run, 'least_margin', r"figures\['margins'\]"), (run, 'largest_error', 'max_abs_error'),
    (lambda: door.Controller(ARM).update(0.0, [0.0] * 2, [0.0] * 2, [0.0] * 5), 'margin',
     r'controller\.margins\(output\)'),
    (lambda: door.Controller(ARM).update(0.0, [0.0] * 2, [0.0] * 2, [0.0] * 5), 'q', r'state\.q'),
    (lambda: door.Controller(ARM), 'save', r'settings\.values\(\)'),
    (lambda: door.Identifier(ARM), 'copy', r'copy\.deepcopy\(identifier\)'),
    (lambda: door.Identifier(ARM), 'standard_deviations', 'its result has std'),
    (lambda: ARM, 'gravload', r'inverse_dynamics\(arm, theta, q, 0'),
    (lambda: ARM, 'rne', r'inverse_dynamics\(arm, theta, q, qd, qdd\)'),
    (lambda: ARM, 'to_urdf', r'identify\(log, urdf\)\.urdf\(path\)'),
    (lambda: ARM.dynamics(ARM.nominal), 'gravity', 'is the torque at rest'),
    (lambda: ARM.dynamics(ARM.nominal), 'inverse_dynamics', 'of the package'),
    (learned, 'score', r'test_rmse.*identify\(log, \.\.\., validate=other\)'),
    (learned, 'rms', 'validate=other'), (learned, 'validate', 'validate=other'),
    (learned, 'to_frame', r'pandas\.Series\(result\.estimate\)'),
    (lambda: door.Evidence(*[None] * 6), 'Y', 'regressor is the present Y_f'),
    (lambda: door.Evidence(*[None] * 6), 'pairs', 'gram and moment')])
def test_words_of_other_programs_are_told_ours(subject, name, hint):
    with pytest.raises(AttributeError, match=f"has no attribute '{name}': .*{hint}"):
        getattr(subject(), name)


def test_the_hint_for_the_true_parameters_gives_them():
    (begin, theta), = run().plant.truth(run().parameters)
    assert begin == 0.0
    np.testing.assert_array_equal(theta, ARM.nominal)
    np.testing.assert_array_equal(run().plant.truth()[0][1], ARM.nominal)


def test_an_arm_of_a_urdf_has_hints_of_its_own():
    pytest.importorskip('pinocchio')
    arm = door.load_arm(PENDULUM)
    for name, hint in (('M', r'mass_matrix\(q\)'), ('gravity', r'load_arm\(urdf, gravity='),
                       ('gravity', 'is the torque at rest'), ('to_urdf', 'xml is its text'),
                       ('jacobian', 'link_points'), ('theta', 'nominal has'),
                       ('effort_limits', r'did you mean torque_limit\?')):
        with pytest.raises(AttributeError, match=f"has no attribute '{name}': .*{hint}"):
            getattr(arm, name)


@pytest.mark.parametrize(('name', 'hint'), [
    ('compare', 'python -m adaptive_blf_control compare` is a command'),
    ('regressor', r'arm\.X\(q, qd, qd, qdd\)'), ('load_config', r'simulate\(file\)'),
    ('PD', r"law='pd'"), ('load', r'load_arm\(urdf\), read_log'),
    ('gravity', r'inverse_dynamics\(arm, theta, q, 0 \* q, 0 \* q\)'),
    ('Panda', r'load_arm\(urdf\)'), ('scenarios', r'list_scenarios\(\)'),
    ('robots', r'list_arms\(\)')])
def test_what_is_not_at_the_door_is_told_where_it_is(name, hint):
    with pytest.raises(AttributeError, match=f"has no attribute '{name}': .*{hint}"):
        getattr(door, name)


@pytest.mark.parametrize(('subject', 'hint'), [
    (lambda: ARM.dynamics(ARM.nominal), r'acceleration\(q, qd, tau\) returns qdd'),
    (lambda: door.Controller(ARM), r'update\(t, q, qd, theta\)'),
    (lambda: door.Identifier(ARM), r'learn\(t, q, qd, tau\)')])
def test_an_object_that_is_called_says_which_method_is_meant(subject, hint):
    with pytest.raises(TypeError, match=f"' object is not callable: .*{hint}"):
        subject()([0.0, 0.0], [0.0, 0.0], [0.0, 0.0])
    assert not callable(learned())


def test_the_theta_of_an_arm_cannot_be_set_without_effect():
    with pytest.raises(AttributeError, match="'theta': nominal has the nominal parameters"):
        ARM.theta = ARM.nominal


def test_an_estimate_cannot_be_set():
    with pytest.raises(AttributeError, match=r'theta cannot be set: .*initial_estimate='):
        door.Identifier(ARM).theta = np.zeros(5)


@pytest.mark.parametrize('result', [run, learned])
def test_a_result_is_read_by_attribute(result):
    with pytest.raises(TypeError, match=r"has no \['theta'\]: its arrays and names are attr"):
        result()['theta']


def test_a_nominal_that_is_no_array_is_refused():
    class Own(door.TwoLinkArm):
        """An arm of a user: it stays open."""

    arm = Own()
    arm.nominal = [3.0, 0.2, 0.2, 5.0, 1.0]
    with pytest.raises(door.ParameterError, match=r"'nominal' is .*a numpy array of shape \(5,\)"):
        door.simulate(arm, 0.01)


def test_a_setting_that_is_set_is_told_what_changes_it():
    settings = door.IdentifierSettings()
    with pytest.raises(dataclasses.FrozenInstanceError, match=r"replace\(history={'size': \.\.\.}"
                       r'\) of the settings.*retune'):
        settings.history.size = 5
    with pytest.raises(AttributeError, match=r'did you mean gamma\?'):
        settings.gammas = 5


@pytest.mark.parametrize(('call', 'message'), [
    (lambda: door.Controller(ARM, params_file='x.yaml'), r'did you mean settings\?'),
    (lambda: door.Controller(ARM, 'x.yaml'), r'a mapping; .*simulate\(file, 0\.001\)'),
    (lambda: door.simulate(ARM, 0.01, theta=[1.0] * 5), r'mean initial_estimate or arm_driver'),
    (lambda: door.simulate(ARM, 0.01, noise=0.1), r'did you mean arm_driver\.sensors\.torque_no'),
    (lambda: door.simulate(ARM, 0.01, encoder_counts=9), 'mean arm_driver.sensors.encoder_counts'),
    (lambda: door.simulate('nothere'), 'a scenario that is shipped: .*two_link, '),
    (lambda: door.simulate('two_lnik'), r'did you mean two_link\?'),
    (lambda: ARM.X([0, 0], [0, 0], [0, 0]), r"'alpha_dot' is missing: expected X\(q, qd, alpha"),
    (lambda: door.identify(LOG), "'urdf' is None: expected a file"),
    (lambda: door.identify(T, Q, Q, Q, ARM), r'identify\(log, urdf=..., .*\*, \.\.\.\), log'),
    (lambda: door.simulate(ARM, 0.01, encoder=9), r'mean arm_driver\.sensors\.encoder_co'),
    (lambda: door.simulate(ARM, 0.01, payload_mass=1.0), r'did you mean arm_driver\.payload'),
    (lambda: door.Identifier(ARM, P=9), r'did you mean history\.size\?'),
    (lambda: door.Identifier(ARM, law='gradient'), r'did you mean update_law\?'),
    (lambda: door.Identifier(ARM, 'theta.yaml'), r'is given as initial_estimate='),
    (lambda: door.Controller(ARM).margins(), r"'output' is missing"),
    (lambda: door.load_arm('x', friction_coulomb=True), r'did you mean coulomb\?'),
    (lambda: door.load_arm(robot_description='x'), r'did you mean urdf\?'),
    (lambda: door.ClosedLoop(ARM, door.Controller(ARM)), r'simulate\(arm\) drives a simulated'),
    (lambda: door.ClosedLoop(ARM.dynamics(ARM.nominal), door.Controller(ARM)), 'from Plant'),
    (lambda: door.simulate(ARM, 0.01, law=lambda sample: 0.0),
     r'with answer\(sample\) -> LawAnswer\(torque, e2, regressor\); .*inherits from Law'),
    (lambda: door.simulate(ARM, 0.01, constraints=[lambda state: 0.0]), 'from Constraint'),
    (lambda: door.simulate(ARM, 0.01, plant={'payload': 2}), r'payload=2\.0, or as arm_driver='),
    (lambda: door.simulate(ARM, 0.01, constraints=[Halves()]), 'no name, .*bodies, bounded$'),
    (lambda: door.simulate(ARM, 0.01, constraints=[Answerless()]), 'bounded.* is None: .*Bounded'),
    (lambda: door.simulate('two_link', 0.01, friction={'coulomb': True}), 'true_parameters sets'),
    (lambda: door.simulate(ARM, 0.01, viscous=[8, 3]), r'mean .*arm_driver\.true_parameters'),
    (lambda: door.simulate(ARM, 0.01, start=[0.1, 0.0]), r'mean arm_driver\.initial_position'),
    (lambda: door.Controller(ARM, initial_position=[0.1, 0.0]), r'did you mean start\?'),
    (lambda: door.load_arm('two_link'), r'TwoLinkArm\(\)'),
    (lambda: door.load_arm('x', payload=2.0), r'simulate\(arm, payload=2\.0\)'),
    (lambda: door.TwoLinkArm(l1=0.5), r'lengths and masses are in theta; .*load_arm\(urdf\)'),
    (lambda: door.ThreeLinkArm(joint_names='abc'), r'did you mean joints\?'),
    (lambda: door.Identifier(ARM).learn(1e3 * T, Q, Q, Q), 't / 1000 are seconds')])
def test_a_wrong_argument_is_told_what_is_meant(call, message):
    with pytest.raises(door.ParameterError, match=message):
        call()


def test_an_own_law_is_named_as_it_is_called():
    class Limp(door.Law):
        def answer(self, sample):
            return door.LawAnswer(np.zeros(2), np.zeros(2), None)

    assert 'controller with Limp of TwoLinkArm' in repr(door.simulate(ARM, 0.01, law=Limp()))


def test_a_shipped_scenario_is_found_from_everywhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    torques = [door.simulate(name, 0.01).torque for name in (
        'two_link', 'two_link.yaml', 'config/two_link.yaml')]
    for torque in torques:
        np.testing.assert_array_equal(torque, torques[0])
    with pytest.raises(door.ParameterError, match='readable YAML'):
        door.simulate('sub/two_link.yaml')


def test_times_in_milliseconds_are_asked_about_without_warnings(recwarn):
    t = np.arange(0.0, 2000.0)
    q = np.column_stack([np.sin(3e-3 * t), np.cos(2e-3 * t)])
    qd = np.column_stack([3.0 * np.cos(3e-3 * t), -2.0 * np.sin(2e-3 * t)])
    with pytest.raises(door.LogError, match=r'1 Hz.*in ms \(the velocities say so.* t / 1000'):
        door.identify({'t': t, 'q': q, 'qd': qd, 'tau': q}, ARM)
    assert not recwarn.list


def test_a_urdf_of_a_result_is_written_where_it_is_wanted(tmp_path):
    pytest.importorskip('pinocchio')
    t = np.arange(0.0, 2.0, 1e-3)
    q, qd, qdd = np.sin(3.0 * t), 3.0 * np.cos(3.0 * t), -9.0 * np.sin(3.0 * t)
    arm = door.load_arm(PENDULUM)
    tau = door.inverse_dynamics(arm, arm.nominal, q[:, None], qd[:, None], qdd[:, None])
    result = door.identify({'t': t, 'q': q, 'qd': qd, 'tau': tau}, arm,
                           filter={'time_constant': 0.01})
    exported = result.urdf(tmp_path / 'out.urdf')
    assert (tmp_path / 'out.urdf').read_text(encoding='utf-8') == exported.xml
    with pytest.raises(AttributeError, match=r'xml is the text; .*urdf\(path\) writes it'):
        _ = exported.text
    for path in (tmp_path / 'out', tmp_path / 'none' / 'out.urdf', 3):
        with pytest.raises(door.ParameterError, match="'path' is"):
            result.urdf(path)


def test_a_reference_may_be_called_at_one_time_or_at_many():
    np.testing.assert_array_equal(SWING(0.3), SWING.at(0.3))
    np.testing.assert_array_equal(SWING(T), SWING.along(T))
    np.testing.assert_array_equal(SWING.at(np.float32(0.5)), SWING.at(0.5))
    started = door.Controller(ARM, reference=SWING, start=[0.0, 1.0]).reference
    np.testing.assert_array_equal(started([0.1, 0.2]).position[1], started(0.2).position)
    for call in (SWING, SWING.at):
        with pytest.raises(door.ParameterError, match="'t' is 'now'"):
            call('now')
    with pytest.raises(door.ParameterError, match="'t' is .*expected a number"):
        SWING.at(T)


@pytest.mark.parametrize('key', ['q', slice(10, 20)])
def test_a_log_is_not_cut_into_its_fields_without_a_word(key):
    log = door.read_log(LOG)
    with pytest.raises(door.LogError, match=r'log\.q\[100:200\]'):
        log[key]
    assert log.replace(dropped=2).dropped == 2
    with pytest.raises(door.ParameterError, match="'drop' is 2.*did you mean dropped"):
        log.replace(drop=2)


@pytest.mark.parametrize(('name', 'hint'), [
    ('log.mat', r"scipy\.io\.loadmat\('log\.mat'"), ('log.xlsx', r'pandas\.read_excel'),
    ('log.parquet', r'pandas\.read_parquet')])
def test_a_file_of_another_program_is_told_what_reads_it(tmp_path, name, hint):
    (tmp_path / name).write_bytes(b'1234567890')
    with pytest.raises(door.LogError, match=hint):
        door.read_log(tmp_path / name)


@pytest.mark.parametrize(('name', 'hint'), [
    ('theta_hat', r'doubles\(topic\)'), ('parameters', r"custom_data\['ros__parameters'\]"),
    ('plot', 'report BAG'), ('df', r'pandas\.DataFrame\(series\.position'),
    ('q', r'joint_states\(topic\)')])
def test_what_a_bag_does_not_have_is_named_with_what_returns_it(bag, name, hint):
    with pytest.raises(AttributeError, match=hint):
        getattr(bag, name)
    assert 'controller' in bag.custom_data['ros__parameters']
    series = bag.joint_states('/joint_states')
    for wrong, right in (('q', 'position'), ('tau', 'effort'), ('t', r'stamp_ns - stamp_ns\[0\]')):
        with pytest.raises(AttributeError, match=right):
            getattr(series, wrong)


def test_a_bag_shows_what_it_is_and_what_reads_a_topic(bag):
    assert repr(bag).startswith(f'<Bag {bag.path}: ')
    assert f'{sum(info.count for info in bag.topics.values())} messages' in repr(bag)
    for topic, hint in (('/joint_states', r"joint_states\('/joint_states'\)"),
                        ('effort_controller/commands', r"doubles\('/effort_controller/comm"),
                        ('/robot_description', r"messages\(\['/robot_description'\]\)"),
                        ('/nothing', r"no topic '/nothing'"), (3, r'no \[3\]')):
        with pytest.raises(door.BagError, match=hint):
            bag[topic]
    with pytest.raises(AttributeError, match='topics has name, type and count'):
        _ = bag.topic_names
    with pytest.raises(door.BagError, match=r'joint_states\(topic\) reads it'):
        bag.doubles('/joint_states')
    with pytest.raises(door.ParameterError, match="'topic' is missing.*topics"):
        bag.joint_states()


def test_one_topic_of_a_bag_is_named_with_or_without_its_slash(bag):
    expected = list(bag.messages(['/joint_states']))
    assert len(expected) == 21
    for given in ('/joint_states', 'joint_states'):
        assert list(bag.messages(given)) == expected
        assert list(bag.in_time_order(given)) == expected
    assert not list(bag.messages(['/nothing']))
    with pytest.raises(door.BagError, match="no topic '/joint_state'"):
        bag.messages('/joint_state')


def test_the_history_shows_what_it_holds():
    identifier = door.Identifier(ARM)
    assert repr(identifier.stack) == '<HistoryStack: 0 of 20 pairs, rank 0, sigma_min 0>'


@pytest.mark.parametrize(('name', 'route'), [
    ('true_parameters', r'simulate\(arm, true_model=.given., true_parameters='),
    ('payload', r'simulate\(arm, payload='),
    ('obstacles', "safety_filter='limits'"), ('SafetyFilter', "safety_filter='limits'")])
def test_the_door_leads_to_what_a_plant_and_a_safety_filter_take(name, route):
    with pytest.raises(AttributeError, match=route):
        getattr(door, name)


def test_help_of_a_controller_and_of_simulate_names_safety_filter_and_payload():
    assert "safety_filter='limits'" in door.Controller.__doc__
    assert '``payload=2.0``' in door.simulate.__doc__
    assert '``true_parameters=[...]``' in door.simulate.__doc__


def test_the_way_that_help_shows_to_another_true_arm_is_one():
    with pytest.raises(AttributeError, match="true_model='given', true_parameters="):
        _ = door.true_parameters
    theta = [3.0, 0.2, 0.25, 5.0, 1.0]
    run = door.simulate(door.TwoLinkArm(), 0.01, true_model='given', true_parameters=theta)
    assert run.plant.truth()[0][1].tolist() == theta
