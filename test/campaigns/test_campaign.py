# SPDX-License-Identifier: Apache-2.0
"""Facts about campaigns: outcomes, files, ends in the middle, commands that repeat a run."""

from __future__ import annotations

from concurrent.futures import CancelledError
import json
import os
from pathlib import Path
import shlex
import signal
import subprocess
import sys
import threading
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

from adaptive_blf_control.campaigns import outcome as outcome_module
from adaptive_blf_control.campaigns.campaign import Campaign, setting_text, usual_chunk
from adaptive_blf_control.campaigns.cluster import cluster
from adaptive_blf_control.campaigns.influence import quarters
from adaptive_blf_control.campaigns.outcome import Chunk, Outcome, run_chunk
from adaptive_blf_control.campaigns.page import shares_by_bin
from adaptive_blf_control.campaigns.results import ResultFolder
from adaptive_blf_control.campaigns.summary import wilson_interval, worst_runs
from adaptive_blf_control.campaigns.workers import processes, run_chunks
from adaptive_blf_control.configuration.parameter_file import apply_settings, load_yaml
from adaptive_blf_control.errors import BlfError, ParameterError
from adaptive_blf_control.tools import campaign as command
from adaptive_blf_control.tools.simulate import main as simulate
from patience import PATIENCE, wait_until

VARY = {'vary': {
    'arm_driver.true_parameters': {'scale': {'uniform': [0.7, 1.3]}},
    'arm_driver.initial_position': {'offset': {'uniform': [-0.03, 0.03]}}}}


@pytest.fixture
def config(repository: Path) -> Path:
    return repository / 'config' / 'two_link.yaml'


@pytest.fixture
def vary(tmp_path: Path) -> Path:
    path = tmp_path / 'vary.yaml'
    path.write_text(yaml.safe_dump(VARY), encoding='utf-8')
    return path


def campaign_of(config: Path, **changes) -> Campaign:
    return Campaign(**{'config': str(config), 'data': load_yaml(config), 'given': VARY, 'runs': 6,
                       'seed': 3, 'duration': 0.05, 'chunk': 2, **changes})


def outcomes(campaign: Campaign) -> list[dict]:
    chunks = (Chunk('here', campaign.data, campaign.duration,
                    [(run, campaign.changes[run]) for run in runs]) for runs in campaign.chunks)
    return [outcome.row() for chunk in chunks for outcome in run_chunk(chunk)]


def same(first: list[dict], second: list[dict]) -> bool:
    return len(first) == len(second) and all(
        a[key] == b[key] or (a[key] != a[key] and b[key] != b[key])
        for a, b in zip(first, second) for key in a)


def run(config: Path, vary: Path, output: Path, *extra: str) -> int:
    return command.main([str(config), '--runs', '6', '--vary', str(vary), '--duration', '0.05',
                         '--chunk', '2', '--seed', '3', '--workers', '2', '--output', str(output),
                         *extra])


def test_threads_give_the_outcomes_of_one_in_one_file_per_chunk(config, vary, tmp_path,
                                                                         capsys):
    assert run(config, vary, tmp_path / 'out', '--json', '--html', str(tmp_path / 'p.html')) == 0
    figures = json.loads(capsys.readouterr().out)
    assert (figures['runs'], figures['kept'], figures['refused']) == (6, 6, 0)
    campaign = campaign_of(config)
    folder = ResultFolder(tmp_path / 'out', campaign, resume=True)
    assert folder.missing() == []
    assert same(outcomes(campaign), folder.rows())
    assert 'arm_driver.true_parameters[4]' in folder.rows()[0]
    assert 'Worst runs' in (tmp_path / 'p.html').read_text(encoding='utf-8')


def test_the_command_of_a_run_repeats_it_exactly(config, capsys):
    data = apply_settings(load_yaml(config), ['controller.k2=[40.0, 9.0]'])
    campaign = campaign_of(config, data=data, settings=('controller.k2=[40.0, 9.0]',))
    words = shlex.split(campaign.command(4))
    assert words[:4] == ['python', '-m', 'adaptive_blf_control', 'simulate']
    assert simulate([*words[4:], '--json']) == 0
    figures = json.loads(capsys.readouterr().out)
    outcome = outcomes(campaign)[4]
    assert max(figures['max_abs_error']) == outcome['largest_error']
    assert figures['theta_error_norm'] / figures['theta_true_norm'] == outcome['parameter_error']


@pytest.mark.parametrize(('runs', 'duration', 'expected'), [
    (1000, 20.0, 10), (1000, 3000.0, 1), (64, 0.05, 4), (3, 0.05, 1)])
def test_a_chunk_is_half_a_second_of_work_as_far_as_there_are_runs(config, runs, duration,
                                                                   expected):
    assert usual_chunk(load_yaml(config), runs, duration) == expected


@pytest.mark.parametrize('value', [1e-5, 1.5e-7, 1e22, -2e-300, 0.1, [1e-5, 2.0], True, 'ablf', 3])
def test_a_setting_is_read_back_exactly(value):
    assert yaml.safe_load(setting_text(value)) == value


def test_a_start_outside_a_set_is_an_outcome_with_its_reason(config):
    campaign = campaign_of(config, given={'vary': {
        'arm_driver.initial_position': {'choice': [[9.0, 9.0]]}}})
    for row in outcomes(campaign):
        assert 'joint1' in row['problem']
        assert not row['kept']


def test_a_campaign_that_was_stopped_goes_on_where_it_was(config, vary, tmp_path, monkeypatch,
                                                         capsys):
    def stopped(campaign, missing, make):
        for number, outcomes in run_chunks(campaign, missing, make):
            yield number, outcomes
            raise KeyboardInterrupt

    monkeypatch.setattr(command, 'run_chunks', stopped)
    assert run(config, vary, tmp_path / 'out') == 130
    assert '--resume goes on' in capsys.readouterr().err
    campaign = campaign_of(config)
    done = set(range(3)) - set(ResultFolder(tmp_path / 'out', campaign, resume=True).missing())
    assert len(done) == 1
    kept, = (tmp_path / 'out' / 'results').iterdir()
    before = kept.stat().st_mtime_ns
    monkeypatch.undo()
    assert run(config, vary, tmp_path / 'out', '--resume') == 0
    assert kept.stat().st_mtime_ns == before
    assert same(outcomes(campaign), ResultFolder(tmp_path / 'out', campaign, True).rows())


def test_ctrl_c_ends_a_campaign_between_two_runs_and_keeps_what_is_done(config, vary, tmp_path):
    output = tmp_path / 'out'
    arguments = ['campaign', str(config), '--runs', '400', '--vary', str(vary), '--duration', '10',
                 '--chunk', '1', '--workers', '2', '--output', str(output)]
    with subprocess.Popen([sys.executable, '-m', 'adaptive_blf_control', *arguments],
                          stderr=subprocess.PIPE, text=True) as process:
        wait_until(lambda: list(output.glob('results/part-*')) or process.poll() is not None)
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=PATIENCE)
    assert process.returncode == 130, errors
    assert '--resume goes on' in errors
    assert 'Traceback' not in errors
    assert 0 < len(list(output.glob('results/part-*'))) < 400
    assert not list(output.glob('results/.*'))


def test_a_thread_whose_outcomes_are_not_wanted_ends_before_its_next_run(config):
    campaign, ended = campaign_of(config), threading.Event()
    ended.set()
    with pytest.raises(CancelledError):
        run_chunk(Chunk('here', campaign.data, campaign.duration, [(0, {})]), ended)


def test_threads_keep_the_arms_of_a_campaign_from_chunk_to_chunk(config):
    campaign, built = campaign_of(config), []
    for name in ('one', 'one', 'another'):
        run_chunk(Chunk(name, campaign.data, campaign.duration, [(0, {})]))
        built.append(outcome_module._OWN.arms)
    assert built[0] is built[1] is not built[2]


def test_results_that_are_there_are_never_overwritten(config, vary, tmp_path, capsys):
    assert run(config, vary, tmp_path / 'out') == 0
    for extra, words in (((), '--resume'), (('--seed', '4', '--resume'), 'another campaign')):
        assert run(config, vary, tmp_path / 'out', *extra) == 2
        assert words in capsys.readouterr().err
    (tmp_path / 'other').mkdir()
    (tmp_path / 'other' / 'thesis.tex').write_text('mine')
    assert run(config, vary, tmp_path / 'other') == 2
    assert 'a new or empty folder' in capsys.readouterr().err
    (tmp_path / 'torn').mkdir()
    (tmp_path / 'torn' / 'campaign.json').write_text('{')
    assert run(config, vary, tmp_path / 'torn') == 2
    assert 'campaign.json can be read' in capsys.readouterr().err


def test_a_file_that_cannot_be_written_ends_the_campaign_with_its_name(config, tmp_path):
    folder = ResultFolder(tmp_path / 'out', campaign_of(config), resume=False)
    parts = tmp_path / 'out' / 'results'
    parts.rmdir()
    parts.write_text('no folder')
    with pytest.raises(BlfError, match='part-000001.*is kept'):
        folder.add(1, [Outcome(2)])


@pytest.mark.parametrize('pyarrow', [True, False])
def test_a_disk_that_gets_full_ends_the_campaign_and_what_is_done_stays(config, tmp_path,
                                                                        monkeypatch, pyarrow):
    if pyarrow:
        pytest.importorskip('pyarrow')
    else:
        monkeypatch.setattr('adaptive_blf_control.campaigns.results.util.find_spec',
                            lambda _: None)
    folder = ResultFolder(tmp_path / 'out', campaign_of(config), resume=False)
    folder.add(0, [Outcome(0), Outcome(1)])
    kind = 'parquet' if pyarrow else 'csv'
    aside = tmp_path / 'out' / 'results' / f'.part-000001.{kind}.{os.getpid()}'
    aside.symlink_to('/dev/full')
    with pytest.raises(BlfError, match=r'part-000001.*No space left.*--resume'):
        folder.add(1, [Outcome(2), Outcome(3)])
    assert [row['run'] for row in folder.rows()] == [0, 1]
    assert folder.missing() == [1, 2]


def test_a_disk_without_room_for_the_results_is_refused_before_the_first_run(
        config, vary, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr('adaptive_blf_control.campaigns.results.shutil.disk_usage',
                        lambda _: SimpleNamespace(free=1000))
    assert run(config, vary, tmp_path / 'out') == 2
    assert 'are free on this disk' in capsys.readouterr().err
    assert not (tmp_path / 'out').exists()


def test_results_without_pyarrow_are_csv_and_say_the_same(config, tmp_path, monkeypatch):
    campaign = campaign_of(config)
    monkeypatch.setattr('adaptive_blf_control.campaigns.results.util.find_spec', lambda _: None)
    folder = ResultFolder(tmp_path / 'out', campaign, resume=False)
    rows = outcomes(campaign)
    for number, runs in enumerate(campaign.chunks):
        folder.add(number, [Outcome(**rows[run]) for run in runs])
    assert {part.suffix for part in (tmp_path / 'out' / 'results').iterdir()} == {'.csv'}
    assert same(rows, folder.rows())


@pytest.mark.parametrize(('extra', 'words'), [
    (('--runs', '0'), '--runs'), (('--chunk', '0'), '--chunk'), (('--seed', '-1'), '--seed'),
    (('--workers', '0'), '--workers'), (('--html', 'nowhere/p.html'), '--html'),
    (('--vary', 'nowhere.yaml'), 'nowhere.yaml'), (('--set', 'controller.k9=1.0'), 'k9'),
    (('--scheduler', 'tcp://127.0.0.1:9'), 'does not answer'),
])
def test_bad_input_is_named_and_no_result_is_written(config, vary, tmp_path, capsys, monkeypatch,
                                                     extra, words):
    monkeypatch.setattr('adaptive_blf_control.campaigns.cluster.CONNECT_TIMEOUT', 1.0)
    assert run(config, vary, tmp_path / 'out', *extra) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / 'out').exists()


def test_a_chunk_whose_worker_dies_is_run_again(config):
    campaign = campaign_of(config, runs=8, chunk=1)
    found = {}
    with processes(2) as make:
        for number, rows in run_chunks(campaign, list(range(8)), kill_one(make)):
            found[number] = rows
    assert same([outcome.row() for number in sorted(found) for outcome in found[number]],
                outcomes(campaign))


def kill_one(make):
    """Return what makes executors, the first of which loses a process at its first chunk."""
    made = []

    def wrapped():
        executor = make()
        if not made:
            executor.submit(abort)
        made.append(executor)
        return executor
    return wrapped


def abort() -> None:
    """End this process as a crash does."""
    os._exit(9)


def test_a_dask_cluster_that_loses_a_worker_gives_the_same_outcomes(config):
    distributed = pytest.importorskip('distributed')
    campaign = campaign_of(config, runs=12, chunk=1, duration=0.3)
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True,
                                  dashboard_address=None) as workers:
        found = {}
        with cluster(workers.scheduler_address) as make:
            for number, rows in run_chunks(campaign, list(range(12)), make):
                if not found:
                    next(iter(workers.workers.values())).process.process.kill()
                found[number] = rows
    assert sorted(found) == list(range(12))
    assert same([outcome.row() for number in sorted(found) for outcome in found[number]],
                outcomes(campaign))


@pytest.mark.parametrize(('kept', 'runs', 'expected'), [
    (0, 10, (0.0, 0.2775)), (10, 10, (0.7225, 1.0)), (5, 10, (0.2366, 0.7634)),
    (81, 263, (0.2553, 0.3662))])  # the last one: Newcombe, Statistics in Medicine 17, 1998
def test_the_interval_of_a_share_is_wilsons(kept, runs, expected):
    np.testing.assert_allclose(wilson_interval(kept, runs), expected, atol=1e-4)


def test_the_worst_runs_are_refused_ones_then_the_first_to_leave_then_the_closest():
    def row(run, kept=True, problem='', first=np.nan, margin=0.1):
        return {'run': run, 'kept': kept, 'problem': problem, 'first_violation_s': first,
                'least_margin': margin}

    rows = [row(0), row(1, margin=0.05), row(2, False, first=3.0, margin=-9.0),
            row(3, False, first=1.0, margin=-1.0), row(4, False, 'refused', margin=np.nan)]
    assert [each['run'] for each in worst_runs(rows)] == [4, 3, 2, 1, 0]


def test_shares_are_counted_where_the_parameter_is():
    values = np.array([0.0, 0.0, 1.0, 1.0, 1.0, 1.0])
    kept = np.array([True, False, True, True, True, False])
    assert shares_by_bin(values, kept)['shares'] == [0.5, 0.75]
    spread = np.linspace(0.0, 1.0, 800)
    shares = shares_by_bin(spread, spread < 0.5)['shares']
    assert shares == [1.0] * 4 + [0.0] * 4


def test_quarters_of_a_parameter_have_the_outcomes_of_their_runs():
    values = np.array([3.0, 0.0, 1.0, 2.0, 2.0])
    rows = [{'kept': value < 2.0, 'least_margin': 1.0 - value, 'torque_error': np.nan}
            for value in values]
    low, middle, high = quarters(values, rows, count=3)
    assert (low.low, low.high, low.runs, low.kept, low.least_margin) == (0.0, 1.0, 2, 1.0, 0.0)
    assert (middle.runs, middle.kept, middle.usual_margin) == (2, 0.0, -1.0)
    assert (high.low, high.runs, high.least_margin) == (3.0, 1, -2.0)
    assert np.isnan(high.torque_error)


def test_what_decides_over_the_outcomes_is_part_of_the_identity(config):
    first = campaign_of(config).identity
    assert first == campaign_of(config).identity
    for changed in ({'seed': 4}, {'runs': 7}, {'duration': 0.06}, {'chunk': 3}):
        assert campaign_of(config, **changed).identity != first


def test_a_bound_beyond_what_is_accepted_is_refused(config):
    with pytest.raises(ParameterError, match='--runs'):
        campaign_of(config, runs=10**9)


def test_a_change_after_the_end_of_the_runs_does_not_count(repository):
    config = repository / 'config' / 'two_link_payload_step.yaml'  # its parameters jump at 50 s
    plain = campaign_of(config, runs=1, given={'vary': {
        'arm_driver.sensors.seed': {'integers': [0, 9]}}})
    row, = outcomes(plain)
    assert 0.0 < row['parameter_error'] < 2.0


def test_an_arm_in_mujoco_is_varied_as_any(repository):
    pytest.importorskip('mujoco', reason='MuJoCo is not installed: the extra mujoco')
    varied = campaign_of(repository / 'config' / 'panda_mujoco.yaml', runs=2, given={'vary': {
        'arm_driver.payload': {'uniform': [0.5, 2.0]},
        'arm_driver.actuator.delay': {'uniform': [0.0, 0.004]}}})
    first, second = outcomes(varied)
    assert first['kept']
    assert second['kept']
    assert first['torque_error'] != second['torque_error']
