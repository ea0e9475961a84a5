# SPDX-License-Identifier: Apache-2.0
"""Bags that lack something: the report says what, and shows the rest."""

from __future__ import annotations

from collections.abc import Callable
import json
from pathlib import Path

import pytest

from adaptive_blf_control.bags.writer import BagWriter
from adaptive_blf_control.messages.cdr import encode_float64
from adaptive_blf_control.messages.topics import (
    BARRIER,
    COMMANDS,
    HISTORY_RANK,
    HISTORY_SIGMA_MIN,
    JOINT_STATES,
    RECORDED,
    REFERENCE,
    THETA_HAT,
    TRACKING_ERROR,
)
from adaptive_blf_control.report.panels import sections
from adaptive_blf_control.runs.numbers import figures
from adaptive_blf_control.runs.recording import read_recording
from adaptive_blf_control.tools.report import main

MakeBag = Callable[..., Path]
SHOWN = (BARRIER, COMMANDS, HISTORY_RANK, HISTORY_SIGMA_MIN, JOINT_STATES, REFERENCE, THETA_HAT,
         TRACKING_ERROR)


def _report(*bags: Path, page: Path, capsys: pytest.CaptureFixture[str]) -> tuple[dict, str]:
    assert main([*map(str, bags), '--json', '-o', str(page)]) == 0
    captured = capsys.readouterr()
    return json.loads(captured.out), captured.err


def test_a_truncated_file_is_shown_up_to_the_break(bag: Path, tmp_path: Path,
                                                   capsys: pytest.CaptureFixture[str]) -> None:
    whole = next(bag.glob('*.mcap')).read_bytes()
    broken = tmp_path / 'broken.mcap'
    broken.write_bytes(whole[:len(whole) // 2])
    numbers, said = _report(broken, page=tmp_path / 'page.html', capsys=capsys)
    shown = numbers['bags'][0]
    assert shown['complete'] is False
    assert shown['problem'] in said
    assert 300 < shown['samples'] < 2001
    assert shown['sets_kept'] is True
    page = (tmp_path / 'page.html').read_text()
    assert 'Incomplete bag' in page
    assert 'id="errors"' in page


def test_an_empty_bag_and_a_missing_one_cannot_be_shown(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    writer = BagWriter(tmp_path / 'empty')
    writer.add_topic('/joint_states', RECORDED[JOINT_STATES])
    writer.close()
    for path, reason in ((tmp_path / 'empty', 'no message'), (tmp_path / 'none', 'none')):
        assert main([str(path), '-o', str(tmp_path / 'page.html')]) == 2
        assert reason in capsys.readouterr().err
    assert not (tmp_path / 'page.html').exists()


def test_an_unreadable_bag_does_not_hide_the_others(
        bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    numbers, said = _report(tmp_path / 'none', bag, page=tmp_path / 'page.html', capsys=capsys)
    assert list(numbers['unreadable']) == [str(tmp_path / 'none')]
    assert str(tmp_path / 'none') in said
    assert len(numbers['bags']) == 1
    assert 'Not readable' in (tmp_path / 'page.html').read_text()


def test_a_foreign_bag_is_named_with_what_is_missing_and_its_topics(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    writer = BagWriter(tmp_path / 'foreign')
    writer.add_topic('/temperature', 'std_msgs/msg/Float64')
    for k in range(20):
        writer.write('/temperature', encode_float64(20.0), 1_000_000_000 + k * 10_000_000)
    writer.close()
    numbers, said = _report(tmp_path / 'foreign', page=tmp_path / 'page.html', capsys=capsys)
    shown = numbers['bags'][0]
    assert shown['sets_kept'] is None
    assert shown['timing']['topics'][0]['count'] == 20
    for what in ('parameters', 'positions', 'tracking error', 'estimates', 'commands'):
        assert f'missing {what}' in said
    page = (tmp_path / 'page.html').read_text()
    assert 'Sets not known' in page
    assert '/temperature' in page


def test_joint_states_alone_give_positions_torques_and_timing(
        make_bag: MakeBag, tmp_path: Path) -> None:
    recording = read_recording(make_bag(tmp_path / 'arm', 0.5, parameters=False,
                                        topics=(JOINT_STATES,)))
    assert recording.joints == ('joint1', 'joint2')
    assert [section.key for section in sections([recording], [None])] == [
        'positions', 'torques', 'timing']


@pytest.mark.parametrize('topic', SHOWN)
def test_any_one_topic_may_be_missing(make_bag: MakeBag, tmp_path: Path, topic: str,
                                      capsys: pytest.CaptureFixture[str]) -> None:
    bag = make_bag(tmp_path / 'bag_without', 0.3, topics=set(RECORDED) - {topic})
    numbers, _ = _report(bag, page=tmp_path / 'page.html', capsys=capsys)
    missing = numbers['bags'][0]['missing']
    assert any(repr(topic) in sentence for sentence in missing), missing


def test_a_bag_without_parameters_still_tells_whether_the_sets_were_kept(
        make_bag: MakeBag, tmp_path: Path) -> None:
    for name, error, kept in (('in', 0.05, True), ('out', 0.25, False)):
        recording = read_recording(make_bag(tmp_path / name, 0.3, error=error, parameters=False))
        assert figures(recording, None)['sets_kept'] is kept
