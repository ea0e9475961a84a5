# SPDX-License-Identifier: Apache-2.0
"""What a campaign costs, and what a second worker brings: threads, processes, a Dask cluster.

The ways take turns, so that what disturbs the machine disturbs all of them; medians count.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import wait
from contextlib import AbstractContextManager, contextmanager
from functools import partial
import resource
import statistics
import time
from typing import NamedTuple

from adaptive_blf_control.campaigns.campaign import Campaign, usual_chunk
from adaptive_blf_control.campaigns.cluster import cluster
from adaptive_blf_control.campaigns.outcome import Chunk, run_chunk
from adaptive_blf_control.campaigns.workers import MakeExecutor, processes, run_chunks, threads
from adaptive_blf_control.compiled import COMPILED
from adaptive_blf_control.configuration.parameter_file import load_yaml

__all__ = ['Cost', 'Way', 'add_options', 'measure', 'overhead', 'run', 'table']

SCENARIOS = {'two_link': 20.0, 'panda_ideal': 10.0, 'panda': 10.0}  # s
REPEATS = 3
VARIED = {'vary': {'arm_driver.true_parameters': {'scale': {'uniform': [0.9, 1.1]},
                                                  'together': True}}}
Way = Callable[[], AbstractContextManager[MakeExecutor]]


class Cost(NamedTuple):
    """What some runs cost.

    Attributes:
        wall: From making the workers to the last outcome [s].
        first: To the first chunk [s].
        processor: Time of all processors, that of processes which were started included [s].
    """

    wall: float
    first: float
    processor: float


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this part."""
    parser.add_argument('--campaign-runs', type=int, default=64, metavar='N',
                        help='runs of each campaign that is measured (default: 64)')
    parser.add_argument('--campaign-scenarios', nargs='+', default=list(SCENARIOS),
                        choices=list(SCENARIOS), help='scenarios of campaigns (default: all)')


def run(options: argparse.Namespace) -> None:
    """Print one table for each scenario."""
    for name in options.campaign_scenarios:
        duration = SCENARIOS[name]
        data, runs = load_yaml(options.config / f'{name}.yaml'), options.campaign_runs
        campaign = Campaign(name, data, VARIED, runs, 0, duration,
                            usual_chunk(data, runs, duration))
        ways = _ways(with_threads=COMPILED and not campaign.check().in_python)
        costs: dict[str, list[Cost]] = {way: [] for way in ways}
        for way in list(ways) * REPEATS:
            costs[way].append(measure(campaign, ways[way]))
        print(f'{name}, {runs} runs of {duration:g} s in chunks of {campaign.chunk}; this process '
              f'and the largest that it started: {_peak(resource.RUSAGE_SELF):.0f} and '
              f'{_peak(resource.RUSAGE_CHILDREN):.0f} MB.\n')
        print(table(costs, {way: overhead(campaign, make) for way, make in ways.items()}, runs),
              flush=True)


def _ways(with_threads: bool) -> dict[str, Way]:
    ways: dict[str, Way] = {}
    if with_threads:
        ways = {'1 thread': partial(threads, 1), '2 threads': partial(threads, 2)}
    return {**ways, '1 process': partial(processes, 1), '2 processes': partial(processes, 2),
            'Dask, 2 workers': _local_cluster}


@contextmanager
def _local_cluster() -> Iterator[MakeExecutor]:
    from distributed import LocalCluster
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as workers, \
            cluster(workers.scheduler_address) as make:
        yield make


def measure(campaign: Campaign, way: Way) -> Cost:
    """Run a campaign one way, its results thrown away."""
    begin, before, first = time.perf_counter(), _processor(), 0.0
    with way() as make:
        for _ in run_chunks(campaign, list(range(len(campaign.chunks))), make):
            first = first or time.perf_counter() - begin
        wall = time.perf_counter() - begin
    return Cost(wall, first, _processor() - before)


def overhead(campaign: Campaign, way: Way, chunks: int = 200) -> float:
    """Return the time that handing out a chunk and taking its outcomes back takes [s].

    It is that of chunks without runs, once the workers are there.
    """
    empty = Chunk('empty', campaign.data, campaign.duration, [])
    with way() as make:
        executor = make()
        wait([executor.submit(run_chunk, empty) for _ in range(4)])
        begin = time.perf_counter()
        wait([executor.submit(run_chunk, empty) for _ in range(chunks)])
        return (time.perf_counter() - begin) / chunks


def _processor() -> float:
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)


def _peak(who: int) -> float:
    return resource.getrusage(who).ru_maxrss / 1024.0


def table(costs: Mapping[str, Sequence[Cost]], overheads: Mapping[str, float], runs: int) -> str:
    """Return medians of the costs as Markdown; the first way is what others are compared with."""
    lines = ['| way | runs a second | x the first | until the first chunk [s] | '
             'a chunk costs [ms] | processor time of 1000 runs [s] |',
             '|---|---|---|---|---|---|']
    base = next(iter(costs.values()))
    for way, found in costs.items():
        gain = statistics.median(one.wall / each.wall for one, each in zip(base, found))
        wall, first, processor = (statistics.median(values) for values in zip(*found))
        lines.append(f'| {way} | {runs / wall:.1f} | {gain:.2f} | {first:.1f} | '
                     f'{1000.0 * overheads[way]:.2f} | {1000.0 * processor / runs:.0f} |')
    return '\n'.join(lines) + '\n'
