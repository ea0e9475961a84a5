# SPDX-License-Identifier: Apache-2.0
"""Facts about the file a run writes θ̂ to and a later run starts from."""

from __future__ import annotations

from pathlib import Path
import threading
import time

import numpy as np
import pytest
import yaml

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.estimate_file import (
    estimate_path,
    recent_estimate,
    write_estimate,
)
from adaptive_blf_control.identification.given_parameters import read_estimate
from adaptive_blf_control.identification.identifier import Identifier, IdentifierSettings
from adaptive_blf_control.identification.knowledge import Snapshot
from disk import synced_files

ARM = TwoLinkArm()
NOON = '2026-03-01T12:00:00.250000+00:00'


@pytest.fixture
def learned(record) -> Identifier:
    result = Identifier(ARM, IdentifierSettings.from_values({
        'filter.settle': 0.0, 'history.size': 7, 'change.window': 0.0, 'excitation.window': 0.0}))
    for sample in record(steps=50):
        result.update(*sample)
    return result


def test_an_estimate_comes_back_to_the_last_bit(learned, tmp_path):
    path = tmp_path / 'theta.yaml'
    write_estimate(path, learned.snapshot())
    np.testing.assert_array_equal(read_estimate(path, ARM.parameters), learned.theta)
    content = yaml.safe_load(path.read_text())
    assert content['history_rank'] == learned.stack.rank
    assert content['history_sigma_min'] == learned.stack.sigma_min
    assert content['insertions'] == learned.stack.insertions


def test_values_are_matched_by_name(learned, tmp_path):
    path = tmp_path / 'theta.yaml'
    write_estimate(path, learned.snapshot())
    np.testing.assert_array_equal(read_estimate(path, ARM.parameters[::-1]), learned.theta[::-1])


def test_a_file_is_replaced_and_nothing_is_left_beside_it(learned, tmp_path):
    path = tmp_path / 'theta.yaml'
    path.write_text('theta_hat: {p1: 1.0}')
    write_estimate(path, learned.snapshot())
    assert [entry.name for entry in tmp_path.iterdir()] == ['theta.yaml']
    assert 'history_rank' in path.read_text()


def test_what_is_no_estimate_is_not_replaced(learned, tmp_path):
    path = tmp_path / 'thesis.tex'
    path.write_text('years of work, theta_hat: among them')
    with pytest.raises(OSError, match='no estimate'):
        write_estimate(path, learned.snapshot())
    with pytest.raises(OSError, match='not a regular file'):
        write_estimate(Path('/dev/null'), learned.snapshot())
    assert 'years of work' in path.read_text()
    assert list(tmp_path.iterdir()) == [path]


def test_a_folder_that_does_not_exist_is_an_os_error(learned, tmp_path):
    with pytest.raises(OSError, match='No such file'):
        write_estimate(tmp_path / 'nowhere' / 'theta.yaml', learned.snapshot())


@pytest.mark.parametrize(('text', 'expected'), [
    (None, r'a readable file \(No such file'),
    ('theta_hat: {p1: 1.0, p2: 2.0}', "an entry 'p3'"),
    ('theta: {p1: 1.0}', "an entry 'theta_hat'"),
    ('theta_hat: {p1: heavy}', 'numbers'),
    ('theta_hat: {p1: [1.0]}', 'numbers'),
    ('theta_hat: {p1: .nan, p2: 1.0, p3: 1.0, fv_joint1: 1.0, fv_joint2: 1.0}', 'finite values'),
    ('theta_hat: 3.0', 'a mapping theta_hat'),
    ('[1.0, 2.0]', 'a mapping theta_hat'),
    ('', 'a mapping theta_hat'),
    ('{theta_hat: ', 'a mapping theta_hat'),
])
def test_an_unusable_file_is_named_with_what_is_expected(tmp_path, text, expected):
    path = tmp_path / 'theta.yaml'
    if text is not None:
        path.write_text(text)
    with pytest.raises(ParameterError, match=expected) as caught:
        read_estimate(path, ARM.parameters)
    assert str(path) in str(caught.value)
    assert caught.value.name == 'identifier.initial_estimate_file'


def test_a_parameter_that_the_arm_does_not_have_is_not_dropped_without_a_word(tmp_path):
    path = tmp_path / 'theta.yaml'
    values = ', '.join(f'{name}: 1.0' for name in (*ARM.parameters, 'Ia_joint1', 'fs_joint2'))
    path.write_text(f'theta_hat: {{{values}}}')
    with pytest.raises(ParameterError, match=r'5 parameters of the arm and no more: it also has '
                       r'Ia_joint1, fs_joint2: .*square_root=True, rotor_inertia=True\)'):
        Identifier(ARM, initial_estimate=str(path))
    path.write_text(f'theta_hat: {{{values.partition(", Ia")[0]}}}')
    assert Identifier(ARM, initial_estimate=str(path)).theta.tolist() == [1.0] * 5


def test_bytes_that_are_not_text_are_refused(tmp_path):
    path = tmp_path / 'theta.yaml'
    path.write_bytes(b'\xff\xfe\x00')
    with pytest.raises(ParameterError, match='a mapping theta_hat'):
        read_estimate(path, ARM.parameters)


# -- what is written ---------------------------------------------------------------------------


def snapshot(**values: float) -> Snapshot:
    return Snapshot(tuple(values), np.array(list(values.values())), 2, 1e-7, 9)


def listing(folder: Path) -> list[str]:
    return sorted(entry.name for entry in folder.iterdir())


@pytest.mark.parametrize('value', [1e-5, 1e16, -1e300, 5e-324, 0.1 + 0.2, -0.0, 3.0, 1e22 / 3.0,
                                   1.7976931348623157e308])
def test_every_number_is_a_yaml_number_and_comes_back_to_the_last_bit(tmp_path, value):
    path = tmp_path / 'theta.yaml'
    write_estimate(path, snapshot(p1=value))
    read = yaml.safe_load(path.read_text())
    assert type(read['theta_hat']['p1']) is type(read['history_sigma_min']) is float
    assert read['theta_hat']['p1'].hex() == value.hex()
    assert read['history_sigma_min'] == 1e-7


@pytest.mark.parametrize('name', ['p1', 'fv_joint1', 'left/link:mass', 'on', 'Null', 'y', '7',
                                  '1e3', 'a b', '- x', "it's", 'say "x"', 'Trägheit', '#1', '~',
                                  ''])
def test_every_parameter_name_comes_back(tmp_path, name):
    path = tmp_path / 'theta.yaml'
    write_estimate(path, snapshot(**{name: 4.5, 'last': 1.5}))
    read = yaml.safe_load(path.read_text(encoding='utf-8'))
    assert read['theta_hat'] == {name: 4.5, 'last': 1.5}


def test_where_writing_fails_the_old_file_stays_and_nothing_beside_it(learned, tmp_path):
    path = tmp_path / 'theta.yaml'
    path.mkdir()  # cannot be replaced by a file
    (path / 'kept').write_text('old')
    with pytest.raises(OSError, match='directory'):
        write_estimate(path, learned.snapshot())
    assert listing(tmp_path) == ['theta.yaml']
    assert listing(path) == ['kept']


def test_what_cannot_be_encoded_leaves_no_file_behind(tmp_path):
    path = tmp_path / 'theta.yaml'
    path.write_text('theta_hat: old')
    with pytest.raises(UnicodeEncodeError):
        write_estimate(path, snapshot(p1=1.0), written_at='\ud800')
    assert listing(tmp_path) == ['theta.yaml']
    assert path.read_text() == 'theta_hat: old'


def test_folders_are_made_where_asked_for(learned, tmp_path):
    path = tmp_path / 'a' / 'b' / 'theta.yaml'
    write_estimate(path, learned.snapshot(), make_folder=True)
    write_estimate(path, learned.snapshot(), make_folder=True)
    assert listing(path.parent) == ['theta.yaml']


def test_a_reader_never_sees_half_a_file_while_threads_write(learned, tmp_path):
    path, failures, done = tmp_path / 'theta.yaml', [], threading.Event()
    state = learned.snapshot()
    write_estimate(path, state, NOON)

    def write() -> None:
        try:
            for _ in range(40):
                write_estimate(path, state, NOON)
        except BaseException as error:
            failures.append(error)

    writers = [threading.Thread(target=write) for _ in range(3)]
    for writer in writers:
        writer.start()
    while not done.is_set():
        np.testing.assert_array_equal(read_estimate(path, ARM.parameters), state.theta)
        if not any(writer.is_alive() for writer in writers):
            done.set()
    assert failures == []
    assert listing(tmp_path) == ['theta.yaml']


def test_a_snapshot_does_not_change_while_learning_goes_on(record):
    subject = Identifier(ARM, IdentifierSettings.from_values({
        'filter.settle': 0.0, 'history.size': 7, 'change.window': 0.0, 'excitation.window': 0.0}))
    samples = record(steps=100)
    for sample in samples[:50]:
        subject.update(*sample)
    taken = subject.snapshot()
    theta, numbers = taken.theta.copy(), taken[2:]
    for sample in samples[50:]:
        subject.update(*sample)
    np.testing.assert_array_equal(taken.theta, theta)
    assert taken[2:] == numbers
    assert not np.array_equal(subject.theta, theta)


# -- where it is written -----------------------------------------------------------------------


@pytest.mark.parametrize(('text', 'namespace', 'environment', 'expected'), [
    ('', '/', {'HOME': '/home/me'}, '/home/me/.ros/adaptive_blf_control/theta_hat.yaml'),
    ('', '/left/arm', {'HOME': '/home/me'},
     '/home/me/.ros/adaptive_blf_control/left/arm/theta_hat.yaml'),
    ('', '/left', {'HOME': '/home/me', 'ROS_HOME': '/data/ros'},
     '/data/ros/adaptive_blf_control/left/theta_hat.yaml'),
    ('', '', {'HOME': '/home/me', 'ROS_HOME': '~/robot'},
     '/home/me/robot/adaptive_blf_control/theta_hat.yaml'),
    ('', '/', {'HOME': '/home/me', 'ROS_HOME': ''},
     '/home/me/.ros/adaptive_blf_control/theta_hat.yaml'),
    ('theta.yaml', '/left', {}, 'theta.yaml'),
    ('/data/theta.yaml', '/left', {'ROS_HOME': '/x'}, '/data/theta.yaml'),
    ('~/theta.yaml', '/left', {'HOME': '/home/me'}, '/home/me/theta.yaml'),
    ('~other/theta.yaml', '/', {'HOME': '/home/me'}, '~other/theta.yaml'),
])
def test_an_estimate_has_a_place_of_its_own_below_ros_home(text, namespace, environment, expected):
    assert estimate_path(text, namespace, environment) == Path(expected)


@pytest.mark.parametrize('text', ['', '~/theta.yaml'])
def test_a_home_that_is_not_known_is_said(text):
    with pytest.raises(ParameterError, match=r'identifier\.estimate_file.*HOME'):
        estimate_path(text, '/', {})


# -- going on from it --------------------------------------------------------------------------


def recent(path: Path, now: str, within: float) -> np.ndarray | None:
    return recent_estimate(path, ('p1', 'p2'), now, within)


@pytest.fixture
def written(tmp_path) -> Path:
    path = tmp_path / 'theta.yaml'
    write_estimate(path, snapshot(p1=3.0, p2=4.0), NOON)
    return path


@pytest.mark.parametrize(('now', 'within', 'recent_enough'), [
    ('2026-03-01T12:00:10.250000+00:00', 10.0, True),
    ('2026-03-01T12:00:10.250001+00:00', 10.0, False),
    ('2026-03-01T14:00:10+02:00', 10.0, True),
    ('2026-03-01T12:00:10', 10.0, True),  # without an offset it is UTC
    ('2026-03-01T12:00:00+00:00', 1.0, True),  # the clock was set back a little
    ('2026-03-01T11:00:00+00:00', 10.0, False),
    ('2026-03-01T12:00:00.250000+00:00', 0.0, False),
])
def test_only_an_estimate_of_a_moment_ago_is_gone_on_from(written, now, within, recent_enough):
    theta = recent(written, now, within)
    if recent_enough:
        np.testing.assert_array_equal(theta, [3.0, 4.0])
    else:
        assert theta is None


def test_without_a_file_there_is_nothing_to_go_on_from(tmp_path):
    assert recent(tmp_path / 'theta.yaml', NOON, 1e9) is None


def test_another_arms_estimate_is_refused_while_it_is_recent(written):
    parameters = ('p1', 'p9')
    with pytest.raises(ParameterError, match="an entry 'p9'") as caught:
        recent_estimate(written, parameters, NOON, 10.0)
    assert caught.value.name == 'identifier.estimate_file'
    assert recent_estimate(written, parameters, '2027-01-01T00:00:00+00:00', 10.0) is None


@pytest.mark.parametrize('line', ['', 'written_at: 5', 'written_at: yesterday', 'written_at:'])
def test_a_file_that_does_not_tell_its_time_is_refused(tmp_path, line):
    path = tmp_path / 'theta.yaml'
    path.write_text(f'{line}\ntheta_hat: {{p1: 1.0, p2: 2.0}}\n')
    with pytest.raises(ParameterError, match='written_at'):
        recent(path, NOON, 10.0)


def test_a_time_that_yaml_reads_as_such_is_understood(tmp_path):
    path = tmp_path / 'theta.yaml'
    path.write_text(f'written_at: {NOON}\ntheta_hat: {{p1: 1.0, p2: 2.0}}\n')
    np.testing.assert_array_equal(recent(path, NOON, 1.0), [1.0, 2.0])
    assert recent(path, '2026-03-01T12:00:05+00:00', 1.0) is None


def test_a_time_without_an_offset_is_utc_wherever_the_machine_stands(written, monkeypatch):
    monkeypatch.setenv('TZ', 'Asia/Tokyo')
    time.tzset()
    try:
        np.testing.assert_array_equal(recent(written, '2026-03-01T12:00:05', 10.0), [3.0, 4.0])
        assert recent(written, '2026-03-01T21:00:05', 10.0) is None
    finally:
        monkeypatch.undo()
        time.tzset()


def test_an_estimate_is_on_the_disk_when_the_call_returns(tmp_path, monkeypatch):
    synced = synced_files(monkeypatch)
    write_estimate(tmp_path / 'theta.yaml', snapshot(p1=3.0), NOON)
    data, folder = synced  # first what is in it, then that it is there
    assert data.startswith('.theta.yaml.')
    assert folder == tmp_path.name
