# SPDX-License-Identifier: Apache-2.0
"""Numbers of a report against the closed form of the run in the bag."""

from __future__ import annotations

from collections.abc import Callable
import importlib
import json
from pathlib import Path
import struct
import sys

import numpy as np
import pytest

from adaptive_blf_control.configuration.build_closed_loop import build_closed_loop
from adaptive_blf_control.configuration.parameter_file import apply_settings, load_yaml
from adaptive_blf_control.control.controller import Controller
from adaptive_blf_control.messages.cdr_cursor import encode_string
from adaptive_blf_control.messages.diagnostics import drop_counters
from adaptive_blf_control.runs.bag_observer import BagObserver
from adaptive_blf_control.runs.lyapunov import guarantee_of_recording
from adaptive_blf_control.runs.numbers import figures, verdict
from adaptive_blf_control.runs.recording import read_recording
from adaptive_blf_control.runs.summary import run_of_trace, summarise, table
from adaptive_blf_control.tools.report import main

MakeBag = Callable[..., Path]


def _figures(bag: Path) -> dict:
    recording = read_recording(bag)
    return figures(recording, guarantee_of_recording(recording))


def test_margins_errors_and_settling_are_those_of_the_motion(bag: Path) -> None:
    numbers = _figures(bag)
    assert numbers['missing'] == []
    assert numbers['sets_kept'] is True
    assert numbers['samples'] == 2001
    assert numbers['max_abs_error'] == pytest.approx([0.05, 0.025])
    assert numbers['min_margin'] == pytest.approx([0.15, 0.175])
    assert numbers['closest'] == {'joint': 'joint1', 'set': 'performance',
                                  'margin': pytest.approx(0.15), 't': 0.0}
    # 2^(−10 t) < 1 % from t = log2(100)/10 on.
    assert numbers['theta_settling_time_s'] == pytest.approx(np.log2(100.0) / 10.0, abs=2e-3)
    assert numbers['history_rank'] == 5
    assert numbers['torque_max_abs'] == pytest.approx([3.0, 1.5])


def test_theorem_2_starts_at_v_of_the_first_sample(bag: Path) -> None:
    recording = read_recording(bag)
    guaranteed = guarantee_of_recording(recording)
    assert guaranteed is not None
    arm_theta = np.array([3.473, 0.196, 0.242, 5.3, 1.1])
    e1, e2 = np.array([0.05, 0.025]), np.array([-0.1, -0.05])
    q2 = 0.025
    p1, p2, p3 = arm_theta[:3]
    mass = np.array([[p1 + 2 * p3 * np.cos(q2), p2 + p3 * np.cos(q2)],
                     [p2 + p3 * np.cos(q2), p2]])
    v0 = 0.5 * np.sum(e1 ** 2 / (0.2 ** 2 - e1 ** 2)) + 0.5 * e2 @ mass @ e2 \
        + 0.5 * arm_theta @ arm_theta
    assert guaranteed.v[0] == pytest.approx(v0)
    assert guaranteed.upper == pytest.approx(0.2 * np.sqrt(2 * v0 / (1 + 2 * v0)) * np.ones(2))
    assert (guaranteed.bound == guaranteed.v[0]).all()


def test_before_the_first_estimate_v_uses_what_the_controller_used(
        make_bag: MakeBag, tmp_path: Path, bag: Path) -> None:
    recording, late = (read_recording(path) for path in (
        bag, make_bag(tmp_path / 'late', 1.0, first_estimate=0.4)))
    assert late.theta_hat is not None
    assert late.theta_hat.t[0] == pytest.approx(0.4)
    guaranteed, whole = guarantee_of_recording(late), guarantee_of_recording(recording)
    assert guaranteed is not None
    assert whole is not None
    assert (guaranteed.t[0], guaranteed.v[0]) == (0.0, pytest.approx(whole.v[0]))


def test_a_run_that_leaves_its_set_is_called_so(other_bag: Path) -> None:
    numbers = _figures(other_bag)
    # 0.25 e^(−2t) > 0.2 until t = ln(1.25)/2
    assert numbers['set_violations'] == int(np.log(1.25) / 2.0 * 1000.0) + 1
    kind, head, sentences = verdict(numbers)
    assert (kind, head) == ('bad', 'Sets left')
    assert '0.05 rad from the performance bound, joint1 at 0.00 s' in ' '.join(sentences)


VELOCITY = 'foreign_constraints:VelocityLimit'


@pytest.mark.parametrize('how', ['named', 'named, and not here any longer', 'passed in'])
def test_a_constraint_of_a_stranger_is_in_the_numbers_of_its_bag(
        repository: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, how: str) -> None:
    data = load_yaml(repository / 'config' / 'two_link.yaml')
    with monkeypatch.context() as context:
        context.syspath_prepend(str(repository / 'test' / 'control'))
        foreign = importlib.import_module('foreign_constraints')
        if how != 'passed in':
            data = apply_settings(data, [f'controller.constraints=["{VELOCITY}"]'])
        loop = build_closed_loop(data)
        if how == 'passed in':
            law = loop.controller
            loop.controller = Controller(
                law.arm, law.settings, law.safety, law.performance, law.reference,
                constraints=[foreign.VelocityLimit(law.arm, law.settings)])
        with BagObserver(tmp_path / 'bag', loop, data) as observer:
            trace = loop.run(1.0, observer)
        expected = 2.0 - np.abs(trace.qd).max(axis=0)
        summary = summarise(run_of_trace(loop, trace))
        if how == 'named':
            numbers = _figures(tmp_path / 'bag')
    if how != 'named':
        monkeypatch.delitem(sys.modules, 'foreign_constraints')
        numbers = _figures(tmp_path / 'bag')
    for figures_ in (summary, numbers):
        [velocity] = [each for each in figures_['margins'] if each['constraint'] == 'velocity']
        assert velocity['unit'] == 'rad/s'
        assert list(velocity['least'].values()) == pytest.approx(expected, abs=1e-9)
        assert velocity['margin'] == pytest.approx(expected.min(), abs=1e-9)
        assert figures_['set_violations'] == 0
    sentences = ' '.join(verdict(numbers)[2])
    assert 'inside its safety, performance and velocity set' in sentences
    assert f'{expected.min():.4g} rad/s from the velocity bound, {velocity["body"]}' in sentences
    assert f'velocity             least margin {expected.min():.4g} rad/s' in table(
        summary, run_of_trace(loop, trace))


def test_a_violation_that_was_only_published_counts(
        repository: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(repository / 'test' / 'control'))
    foreign = importlib.import_module('foreign_constraints')
    monkeypatch.setattr(foreign.VelocityLimit, 'limit', 0.4)  # reached at times
    data = load_yaml(repository / 'config' / 'two_link.yaml')
    loop = build_closed_loop(apply_settings(data, [
        f'controller.constraints=["{VELOCITY}"]', 'arm_driver.initial_velocity=[0.0, 0.0]']))
    with BagObserver(tmp_path / 'bag', loop, data) as observer:
        trace = loop.run(1.0, observer)
    left = summarise(run_of_trace(loop, trace))['set_violations']
    assert left == np.count_nonzero((np.abs(trace.qd) >= 0.4).any(axis=1)) > 0
    # One message in ten samples: at least one sample of the ten was outside.
    assert left / 10 <= _figures(tmp_path / 'bag')['set_violations'] <= left


def test_gaps_and_missed_periods_are_counted(make_bag: MakeBag, tmp_path: Path) -> None:
    timing = _figures(make_bag(tmp_path / 'gaps', 1.0, skip={100, 500, 501, 502}))['timing']
    assert timing['period_ms'] == 1.0
    assert (timing['missed_periods'], timing['gaps'], timing['out_of_order']) == (4, 2, 0)
    assert timing['interval_ms']['max'] == pytest.approx(4.0)


def test_command_delay_is_what_the_recorder_heard(bag: Path) -> None:
    timing = _figures(bag)['timing']
    assert timing['command_delay_ms'] == pytest.approx(
        {'min': 0.3, 'p50': 0.3, 'p99': 0.3, 'max': 0.3})
    counts = {topic['name']: topic['count'] for topic in timing['topics']}
    assert counts['/joint_states'] == 2001
    assert counts['/identifier/history_rank'] == 21


def test_json_alone_writes_no_page(bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                   capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    assert main([str(bag), '--json']) == 0
    assert json.loads(capsys.readouterr().out)['bags'][0]['sets_kept'] is True
    assert list(tmp_path.iterdir()) == []


def _diagnostics(node: str, values: dict[str, str]) -> bytes:
    data = bytearray(b'\x00\x01\x00\x00' + struct.pack('<iI', 1, 0))

    def text(word: str) -> None:
        data.extend(bytes(-(len(data) - 4) % 4) + encode_string(word, 'text'))

    def count(number: int) -> None:
        data.extend(bytes(-(len(data) - 4) % 4) + struct.pack('<I', number))

    text('')
    count(1)
    data.extend(b'\x00')
    text(f'{node}: kind')
    text('running')
    text('arm')
    count(len(values))
    for key, value in values.items():
        text(key)
        text(value)
    return bytes(data)


def test_the_last_counters_of_dropped_messages_are_found() -> None:
    messages = [_diagnostics('controller', {'rate': '1000', 'dropped: stale': '1'}), b'\x00\x01',
                _diagnostics('recorder', {'/joint_states lost': '3', '/joint_states written': '9',
                                          '/theta_hat lost': '0'}),
                _diagnostics('controller', {'rate': '1000', 'dropped: stale': '2'})]
    assert drop_counters(messages) == [
        {'node': 'controller', 'what': 'dropped: stale', 'count': 2},
        {'node': 'recorder', 'what': '/joint_states lost', 'count': 3}]
