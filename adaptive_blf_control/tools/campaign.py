# SPDX-License-Identifier: Apache-2.0
"""``campaign CONFIG --runs N --vary FILE``: Monte-Carlo over any parameter of a scenario."""

from __future__ import annotations

import argparse
from contextlib import AbstractContextManager
import json
import os
from pathlib import Path
import sys
import time
from typing import Any

from adaptive_blf_control.campaigns.campaign import Campaign, usual_chunk
from adaptive_blf_control.campaigns.cluster import cluster
from adaptive_blf_control.campaigns.page import campaign_page
from adaptive_blf_control.campaigns.results import ResultFolder
from adaptive_blf_control.campaigns.summary import summarise, table
from adaptive_blf_control.campaigns.variations import read_vary_file
from adaptive_blf_control.campaigns.workers import MakeExecutor, processes, run_chunks, threads
from adaptive_blf_control.command_line import seconds
from adaptive_blf_control.compilation_notice import CompilationNotice
from adaptive_blf_control.compiled import COMPILED
from adaptive_blf_control.configuration.parameter_file import apply_settings, load_yaml
from adaptive_blf_control.errors import BlfError, MissingExtra, ParameterError
from adaptive_blf_control.report.plotly_figures import plotly_js
from adaptive_blf_control.runs.simulation import duration_of
from adaptive_blf_control.simulation.closed_loop import ClosedLoop

__all__ = ['main']

INTERRUPTED = 130


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='campaign', description=__doc__)
    parser.add_argument('config', type=Path, help='parameter file, e.g. config/two_link.yaml')
    parser.add_argument('--runs', type=int, required=True, metavar='N', help='number of runs')
    parser.add_argument('--vary', type=Path, required=True, metavar='FILE',
                        help='what varies, see docs/campaigns.md')
    parser.add_argument('--seed', type=int, default=0, metavar='S', help='default: 0')
    parser.add_argument('--duration', type=seconds, metavar='S',
                        help="length of each run [s]; default: the driver's duration, else 20")
    parser.add_argument('--set', action='append', default=[], metavar='NODE.NAME=VALUE',
                        dest='settings', help='change a parameter in every run')
    parser.add_argument('--workers', type=int, default=os.cpu_count() or 1, metavar='W',
                        help='threads or processes of this machine (default: one for each core)')
    parser.add_argument('--scheduler', metavar='ADDRESS',
                        help='a Dask scheduler to use instead, e.g. tcp://host:8786')
    parser.add_argument('--chunk', type=int, metavar='N',
                        help='runs that a worker does at a time (default: half a second of work)')
    parser.add_argument('--output', type=Path, metavar='DIR',
                        help='folder of the results (default: runs/campaign_TIME)')
    parser.add_argument('--resume', action='store_true',
                        help='go on with the results that are in the folder')
    parser.add_argument('--html', type=Path, metavar='FILE.html', help='write a page with plots')
    parser.add_argument('--json', action='store_true', help='print the figures as JSON')
    return parser


def _campaign(options: argparse.Namespace) -> Campaign:
    data = apply_settings(load_yaml(options.config, 'CONFIG'), options.settings)
    if options.workers < 1:
        raise ParameterError('--workers', options.workers, 'an integer >= 1')
    if options.resume and options.output is None:
        raise ParameterError('--resume', True, '--output, the folder to go on with')
    if options.html is not None and not options.html.parent.is_dir():
        raise ParameterError('--html', str(options.html), 'a file in a folder that exists')
    if options.html is not None:
        plotly_js()  # MissingExtra now, not after the last run
    duration = duration_of(data, options.duration)
    chunk = options.chunk
    return Campaign(str(options.config), data, read_vary_file(options.vary), options.runs,
                    options.seed, duration,
                    usual_chunk(data, options.runs, duration) if chunk is None else chunk,
                    tuple(options.settings))


def _workers(loop: ClosedLoop,
             options: argparse.Namespace) -> AbstractContextManager[MakeExecutor]:
    if options.scheduler:
        return cluster(options.scheduler)
    holds_gil = loop.in_python or not COMPILED
    return (processes if holds_gil else threads)(options.workers)


def _bar(total: int, done: int) -> Any:
    try:
        from tqdm import tqdm
    except ImportError:
        raise MissingExtra('tqdm', 'campaign', 'the progress bar of a campaign') from None
    return tqdm(total=total, initial=done, unit='run', file=sys.stderr, smoothing=0.05)


def _run(campaign: Campaign, folder: ResultFolder, make: MakeExecutor) -> None:
    """Compute what is missing; what is done stays whatever ends this."""
    missing = folder.missing()
    ahead = sum(len(campaign.chunks[number]) for number in missing)
    with _bar(campaign.runs, campaign.runs - ahead) as bar:
        for number, outcomes in run_chunks(campaign, missing, make):
            folder.add(number, outcomes)
            bar.update(len(outcomes))


def main(args: list[str] | None = None) -> int:
    """Run the command; 0 if all runs are done, whatever they showed; 2 on bad input."""
    options = _parser().parse_args(args)
    output = options.output or Path('runs') / time.strftime('campaign_%Y%m%d_%H%M%S')
    try:
        campaign = _campaign(options)
        with CompilationNotice():
            loop = campaign.check()
        try:
            with _workers(loop, options) as make:
                folder = ResultFolder(output, campaign, options.resume)
                _run(campaign, folder, make)
        except KeyboardInterrupt:
            print(f'campaign: stopped; --output {output} --resume goes on', file=sys.stderr)
            return INTERRUPTED
        rows = folder.rows()
        if options.html is not None:
            options.html.write_text(campaign_page(rows, campaign), encoding='utf-8')
    except (BlfError, OSError) as error:
        print(f'campaign: {error}', file=sys.stderr)
        return 2
    print(json.dumps(summarise(rows), indent=2) if options.json else table(rows, campaign))
    print(f'\nresults: {output}' + (f', page: {options.html}' if options.html else ''),
          file=sys.stderr)
    return 0


if __name__ == '__main__':
    sys.exit(main())
