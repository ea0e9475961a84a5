# SPDX-License-Identifier: Apache-2.0
"""What a person gives for a log, and what a log answers."""

from __future__ import annotations

import numpy as np
import pytest

import adaptive_blf_control as door

ARM = door.TwoLinkArm()
T = np.arange(0.0, 1.0, 1e-3)
Q = np.column_stack([np.sin(3.0 * T), np.cos(2.0 * T)])
QD = np.column_stack([3.0 * np.cos(3.0 * T), -2.0 * np.sin(2.0 * T)])
LOG = {'t': T, 'q': Q, 'qd': QD, 'tau': Q}
PENDULUM = (
    '<robot name="r"><link name="base"/><link name="rod"><inertial><mass value="1"/>'
    '<origin xyz="0 0 -0.2"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/>'
    '</inertial></link><joint name="pivot" type="continuous"><parent link="base"/>'
    '<child link="rod"/><axis xyz="0 1 0"/></joint></robot>')


def test_the_length_of_a_log_is_the_number_of_its_rows():
    log = door.read_log(LOG)
    assert len(log) == len(T)
    with pytest.raises(door.LogError, match=r'cannot be unpacked: log\.t'):
        t, q, qd, tau = log


def test_a_run_is_a_log_wherever_one_is_wanted():
    swing = {joint: {'amplitude': 0.4, 'frequency': 3.0} for joint in ARM.joints}
    run = door.simulate(ARM, 1.0, reference=swing)
    for use in (lambda log: door.read_log(log).tau, lambda log: door.Identifier(ARM).learn(log),
                lambda log: door.identify(log, ARM, filter={'time_constant': 0.01}).theta):
        np.testing.assert_array_equal(use(run), use(run.log()))
    np.testing.assert_array_equal(run.log().tau, run.measured.torque)
    with pytest.raises(door.LogError, match='log is of type TwoLinkArm: .*a run of simulate'):
        door.identify(ARM, ARM)


@pytest.mark.parametrize('form', ['csv', 'arrays'])
def test_columns_without_names_are_the_joints_of_an_arm_in_their_order(tmp_path, form):
    pytest.importorskip('pinocchio')
    arm = door.load_arm(PENDULUM)
    columns = np.column_stack([T, Q[:, 0], QD[:, 0], Q[:, 1]])
    source = dict(zip(('t', 'q', 'qd', 'tau'), columns.T))
    if form == 'csv':
        source = tmp_path / 'log.csv'
        np.savetxt(source, columns, '%.17g', ',', header='t,q1,qd1,tau1', comments='')
    log = door.read_log(source)
    assert (log.joints, log.of_joints(arm.joints).joints) == (('joint1',), ('pivot',))
    options = {'filter': {'time_constant': 0.01}, 'force': True}
    np.testing.assert_array_equal(door.identify(log, arm, **options).theta,
                                  door.identify(source, arm, **options).theta)
    with pytest.raises(door.LogError, match=r'1 joints have no names .*find a, b: .*joints=\['):
        log.of_joints(['a', 'b'])


def test_a_joint_of_small_letters_is_the_one_of_capitals(tmp_path):
    path = tmp_path / 'log.csv'
    np.savetxt(path, np.column_stack([T, Q, QD, Q]), delimiter=',', comments='',
               header='t,q_Elbow,q_Hip,qd_Elbow,qd_Hip,tau_Elbow,tau_Hip')
    there = door.read_log(path, joints=['Hip', 'Elbow'])
    after = door.read_log(path).of_joints(['Hip', 'Elbow'])
    assert there.joints == after.joints == ('Hip', 'Elbow')
    np.testing.assert_array_equal(there.q, after.q)


def test_the_joints_of_a_saved_run_are_those_of_its_log(tmp_path):
    run = door.simulate(ARM, 0.05)
    saved = dict(np.load(run.save(tmp_path / 'run.npz')), q=Q[:51])
    for stored in (saved['joints'], np.array(['hip', 'knee'])):
        np.savez(tmp_path / 'other.npz', **{**saved, 'joints': stored})
        for source in (tmp_path / 'other.npz', {**saved, 'joints': stored}):
            assert door.read_log(source).joints == tuple(stored)
            turned = door.read_log(source, joints=stored[::-1].tolist())
            np.testing.assert_array_equal(turned.q, Q[:51, ::-1])
            with pytest.raises(door.LogError, match=f"no joint 'a': it has {', '.join(stored)}"):
                door.read_log(source, joints=['a', 'b'])
    theta = door.Identifier(ARM).learn(saved)
    turned = {**saved, **{name: saved[name][:, ::-1] for name in ('q', 'qd', 'tau')},
              'joints': ARM.joints[::-1]}
    np.testing.assert_array_equal(door.Identifier(ARM).learn(turned), theta)
    with pytest.raises(door.LogError, match='of a, b, the arm has joint1, joint2'):
        door.Identifier(ARM).learn({**saved, 'joints': ['a', 'b']})
    with pytest.raises(door.LogError, match=r"'joints' is \['a'\]: expected 2 different names"):
        door.read_log({**saved, 'joints': ['a']})


@pytest.mark.parametrize(('unit', 'refused'), [(1.0, False), (180.0 / np.pi, True)])
def test_a_log_in_degrees_of_an_arm_with_limits_is_not_learned_without_a_word(unit, refused):
    arm = door.TwoLinkArm()
    arm.position_lower, arm.position_upper = np.full(2, -2.0), np.full(2, 2.0)
    learn = door.Identifier(arm).learn
    q = unit * (Q + [1.5, 0.0])  # one beyond its limit at some time, all of them in degrees
    if not refused:
        learn(T, q, QD, Q)
        return
    with pytest.raises(door.ParameterError, match=r'no sample is within the limits.*deg2rad'):
        learn(T, q + 10.0, unit * QD, Q)


MIXED = np.random.default_rng(0).permutation(len(T))
TAU = np.full_like(Q, np.nan)


@pytest.mark.parametrize(('log', 'message'), [
    ((T[MIXED], Q[MIXED], QD[MIXED], Q[MIXED]), r"'t' is .*not in the order of time: t goes back "
     r'in \d+ of \d+ rows.*argsort'),
    ((1e3 * T, Q, QD, Q), r'times in ms \(.*t / 1000 are'),
    ((1e9 * T, Q, QD, Q), r'times in ns \(.*t / 1e\+09 are'),
    ((1e9 * (1.7e9 + T), Q, QD, Q), r'times in ns \(.*t / 1e\+09 are'),
    ((T, Q, QD, TAU), r"'tau' is .*finite numbers: in none of its \d+ rows"),
    ((T[:1], Q[:1], QD[:1], Q[:1]), r"'t' is .*two samples, not 1; update"),
    ((T[:0], Q[:0], QD[:0], Q[:0]), r"'t' is .*two samples, not 0; update")])
def test_what_cannot_be_learned_from_is_told_why(log, message):
    with pytest.raises(door.ParameterError, match=message):
        door.Identifier(ARM).learn(*log)


def test_rows_that_are_not_in_order_are_not_read():
    log = {'t': T[MIXED], 'q': Q[MIXED], 'qd': QD[MIXED], 'tau': Q[MIXED]}
    with pytest.raises(door.LogError, match=r'log: the rows are not in the order of time: t goes'):
        door.read_log(log)
    late = T.copy()
    late[[100, 200]] = late[[99, 190]]  # two late messages are no disorder
    assert len(door.read_log({**log, 't': late, 'q': Q, 'qd': QD, 'tau': Q})) == len(T) - 2


ROWS = np.arange(0.0, 8.0, 2e-3)
RATES = np.array([1.1, 1.7, 2.5, 3.9])
MOVED = 0.6 * np.sin(np.outer(ROWS, RATES[:2])) + 0.3 * np.sin(np.outer(ROWS, RATES[2:]))
SPEED = (0.6 * RATES[:2] * np.cos(np.outer(ROWS, RATES[:2]))
         + 0.3 * RATES[2:] * np.cos(np.outer(ROWS, RATES[2:])))
PUSH = np.gradient(SPEED, ROWS, axis=0)
SETTINGS = {'filter': {'time_constant': 0.05, 'effort': 'instant'}}


def measured(arm):
    return {'t': ROWS, 'q': MOVED, 'qd': SPEED,
            'tau': door.inverse_dynamics(arm, arm.nominal, MOVED, SPEED, PUSH)}


def test_what_identify_says_of_a_log_is_noted_by_learn():
    log = measured(ARM)
    swapped = {**log, 'q': log['qd'], 'qd': log['q']}
    with pytest.raises(door.LogError, match='sign opposite to that of dq/dt') as refused:
        door.identify(swapped, arm=ARM, **SETTINGS)
    identifier = door.Identifier(ARM, **SETTINGS)
    with pytest.warns(UserWarning, match='cannot be right: .*sign opposite to that') as caught:
        identifier.learn(swapped)
    assert caught[0].filename == __file__
    assert identifier.notes
    assert all(note in str(refused.value) for note in identifier.notes)
    assert repr(identifier).endswith('see its notes>')
    identifier.learn(log)
    assert identifier.notes == ()


@pytest.fixture(scope='module')
def two_rods():
    """Return an arm of two rods from a URDF."""
    pytest.importorskip('pinocchio')
    return door.load_arm(PENDULUM.replace('</robot>', (
        '<link name="tip"><inertial><mass value="2"/><origin xyz="0.3 0 0"/><inertia ixx="0.1" '
        'ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link><joint name="wrist" '
        'type="continuous"><parent link="rod"/><child link="tip"/><origin xyz="0 0 -0.4"/><axis '
        'xyz="0 1 0"/></joint></robot>')))


def test_what_takes_a_model_is_noted_by_learn_as_well(two_rods, recwarn):
    arm = two_rods
    for sign in (1.0, -1.0):
        log = measured(arm)
        identifier = door.Identifier(arm, **SETTINGS)
        identifier.learn({**log, 'tau': sign * log['tau']})
        findings = door.identify({**log, 'tau': sign * log['tau']}, arm=arm, **SETTINGS).findings
        assert identifier.notes == tuple(map(str, findings))
        assert any('the effort has the sign opposite' in note for note in identifier.notes) == (
            sign < 0.0)
    assert not recwarn.list


def test_efforts_that_are_exchanged_are_noted_by_learn_and_by_identify(two_rods):
    log = measured(two_rods)
    exchanged = {**log, 'tau': log['tau'][:, ::-1]}
    identifier = door.Identifier(two_rods, **SETTINGS)
    identifier.learn(exchanged)
    findings = door.identify(exchanged, arm=two_rods, **SETTINGS).findings
    for said in (identifier.notes, tuple(map(str, findings))):
        assert any('columns 1 and 2 of the effort may be exchanged' in each for each in said)


WHOLE = door.read_log(LOG)


@pytest.mark.parametrize(('changes', 'message'), [
    ({'q': Q[:10]}, r"'q' is .*expected shape \(1000, 2\) .*joint1, joint2.*not \(10, 2\)"),
    ({'tau': Q[:, :1]}, r"'tau' is .*expected shape \(1000, 2\)"),
    ({'qd': None}, r"'qd' is None: expected numbers of shape \(1000, 2\)"),
    ({'t': T[:5]}, r"'q' is left with the shape \(1000, 2\): expected to be given as well"),
    ({'t': T[::-1]}, r"'t' is .*that rise, not t\[1\] = 0\.998 after 0\.999"),
    ({'t': T * np.nan}, r"'t' is .*finite numbers, not t\[0\] = nan"),
    ({'q': np.where(Q > 0.9, np.inf, Q)}, r"'q' is .*finite numbers, not q\[0, 1\] = inf"),
    ({'joints': ('a',)}, r"'q' is left with the shape \(1000, 2\): .*\(1000, 1\)"),
    ({'joints': ('a', 'a')}, r"'joints' is .*different names"),
    ({'joints': 3}, r"'joints' is 3.*different names"),
    ({'joints': 'ab'}, r"'joints' is 'ab'.*different names")])
def test_a_log_takes_no_values_that_do_not_fit_the_rest(changes, message):
    with pytest.raises(door.ParameterError, match=message):
        WHOLE.replace(**changes)


def test_a_log_takes_other_rows_and_names_where_all_of_them_fit():
    rows = {name: getattr(WHOLE, name)[::2] for name in ('t', 'q', 'qd', 'tau')}
    half = WHOLE.replace(joints=['a', 'b'], breaks=(3,)).replace(**rows)
    assert (half.joints, half.breaks, len(half)) == (('a', 'b'), (), 500)
    np.testing.assert_array_equal(WHOLE.replace(q=Q.tolist()).q, Q)


class Frame:
    """A table with names of its columns, as a data frame of pandas has them."""

    def __init__(self, values, columns):
        """Take both."""
        self.values, self.columns = np.asarray(values), list(columns)
        self.ndim, self.shape = 2, self.values.shape

    def __array__(self, dtype=None, copy=None):
        """Return the numbers."""
        return np.array(self.values, dtype)

    def __getitem__(self, name):
        """Return a column."""
        return self.values[:, self.columns.index(name)]

    def __len__(self):
        """Return the number of rows."""
        return len(self.values)


LEVELS = [('arm', joint) for joint in ARM.joints[::-1]]


@pytest.mark.parametrize('columns', [ARM.joints[::-1], ('q2', 'q1'), LEVELS])
def test_names_of_the_columns_of_one_array_are_heeded(columns):
    turned = {name: Frame(LOG[name][:, ::-1], columns) for name in ('q', 'qd', 'tau')}
    mixed = {**LOG, 'q': turned['q']}
    for log in ({'t': T, **turned}, mixed):
        read = door.read_log(log, joints=ARM.joints)
        for name in ('q', 'qd', 'tau'):
            np.testing.assert_array_equal(getattr(read, name), LOG[name])
    expected = door.Identifier(ARM).learn(LOG)
    np.testing.assert_array_equal(door.Identifier(ARM).learn({'t': T, **turned}), expected)
    known = door.Identifier(ARM, initial_estimate=ARM.nominal)
    np.testing.assert_array_equal(known.predict(turned['q'], QD, Q), known.predict(Q, QD, Q))


@pytest.mark.parametrize('columns', [('a', 'b'), ('q1_deg', 'q2_deg'), ('joint1', 'b')])
def test_names_of_columns_that_are_none_of_the_joints_are_refused(columns):
    other = Frame(Q, columns)
    with pytest.raises(door.LogError, match=f'{columns[1]}'):
        door.read_log({**LOG, 'q': other}, joints=ARM.joints)
    with pytest.raises(door.ParameterError, match=f"'q' is .*{columns[1]}.*joint1, joint2"):
        door.Identifier(ARM).predict(other, QD, Q)


def test_columns_on_two_levels_and_with_a_unit_in_their_names_are_columns_of_a_table():
    kinds = {'q': Q, 'qd': QD, 'tau': Q}
    names = [(kind, joint) for kind in kinds for joint in ARM.joints]
    table = Frame(np.column_stack([T, *kinds.values()]), [('t', ''), *names])
    assert door.read_log(table).joints == ARM.joints
    degrees = {'t': T, **{f'{kind}{k + 1}{unit}': factor * kinds[kind][:, k] for kind, unit, factor
                          in (('q', '_deg', 180.0 / np.pi), ('qd', '_deg_s', 180.0 / np.pi),
                              ('tau', '', 1.0)) for k in range(2)}}
    read = door.read_log(degrees)
    np.testing.assert_allclose(read.q, Q)
    np.testing.assert_allclose(read.qd, QD)


def test_filters_restart_where_the_clock_of_a_log_was_set_back():
    log = measured(ARM)
    rows = np.arange(len(ROWS))
    swapped = np.roll(rows, len(rows) // 3)
    together = door.read_log({name: log[name][swapped] for name in ('t', 'q', 'qd', 'tau')})
    assert together.breaks == (len(rows) // 3,)
    identifier, other = (door.Identifier(ARM, **SETTINGS) for _ in range(2))
    theta = identifier.learn(together)
    for part in np.split(np.arange(len(rows)), together.breaks):
        other.restart()
        expected = other.learn(*(each[part] for each in (
            together.t, together.q, together.qd, together.tau)))
    np.testing.assert_array_equal(theta, expected)
    assert not [note for note in identifier.notes if 'derivative' in note]
