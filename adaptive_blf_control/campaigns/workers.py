# SPDX-License-Identifier: Apache-2.0
"""Where the runs of a campaign are computed: on this machine, or on a Dask cluster.

All of them are executors of `concurrent.futures`, so that a chunk goes the same way everywhere.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import (
    as_completed,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
)
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
import multiprocessing
import signal
import threading
from typing import Any
from uuid import uuid4

from adaptive_blf_control.campaigns.campaign import Campaign
from adaptive_blf_control.campaigns.outcome import Chunk, Outcome, run_chunk
from adaptive_blf_control.errors import BlfError

__all__ = ['ATTEMPTS', 'MakeExecutor', 'processes', 'run_chunks', 'threads']

ATTEMPTS = 3  # a chunk that ends its worker so often is to blame itself
MakeExecutor = Callable[[], Executor]


class _Threads(ThreadPoolExecutor):
    """Threads that compute chunks, and can be asked to end before their next run."""

    def __init__(self, workers: int) -> None:
        super().__init__(workers)
        self.ended = threading.Event()

    def submit(self, function: Callable[..., Any], /, *arguments: Any,
               **named: Any) -> Future[Any]:
        return super().submit(function, *arguments, ended=self.ended, **named)


@contextmanager
def threads(workers: int) -> Iterator[MakeExecutor]:
    """Yield what makes an executor of ``workers`` threads.

    For loops whose samples run as compiled blocks: those do not hold Python's interpreter. Threads
    begin at once and share machine code and memory.
    """
    pool = _Threads(workers)
    try:
        yield lambda: pool
    finally:
        pool.ended.set()
        pool.shutdown(wait=True, cancel_futures=True)


def _leave_the_end_to_the_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)


@contextmanager
def processes(workers: int) -> Iterator[MakeExecutor]:
    """Yield what makes an executor of ``workers`` processes on this machine.

    For loops in which some part is asked sample by sample in Python. They are started afresh, not
    forked: numba and OpenBLAS do not survive a fork with threads.
    """
    made: list[ProcessPoolExecutor] = []

    def make() -> Executor:
        made.append(ProcessPoolExecutor(workers, multiprocessing.get_context('spawn'),
                                        _leave_the_end_to_the_parent))
        return made[-1]

    try:
        yield make
    finally:
        for pool in made:
            for process in list((pool._processes or {}).values()):  # no public way before 3.14
                process.terminate()
            pool.shutdown(wait=True, cancel_futures=True)


def run_chunks(campaign: Campaign, missing: list[int], make: MakeExecutor,
               ) -> Iterator[tuple[int, list[Outcome]]]:
    """Compute chunks; yield the number of each and its outcomes as it is done.

    A process that dies costs the chunks that were under way: they are run again.

    Args:
        campaign: What is run.
        missing: Numbers of the chunks.
        make: Makes an executor; called again where one broke because a worker died.

    Raises:
        BlfError: a chunk ended its worker again and again.
    """
    ahead, name = dict.fromkeys(missing, 0), uuid4().hex
    while ahead:
        executor = make()
        futures = {executor.submit(run_chunk, _chunk(campaign, number, name)): number
                   for number in ahead}
        try:
            for future in as_completed(futures):
                number = futures[future]
                outcomes = future.result()
                del ahead[number]
                yield number, outcomes
        except BrokenProcessPool:
            _count_attempts(ahead, futures)


def _chunk(campaign: Campaign, number: int, name: str) -> Chunk:
    changes = [(run, campaign.changes[run]) for run in campaign.chunks[number]]
    return Chunk(name, campaign.data, campaign.duration, changes)


def _count_attempts(ahead: dict[int, int], futures: dict[Future[Any], int]) -> None:
    """Blame the first chunk that was not done: the pool does not say which of them broke it."""
    first = min(ahead, key=list(futures.values()).index)
    ahead[first] += 1
    if ahead[first] >= ATTEMPTS:
        raise BlfError(f'chunk {first} ended its worker {ATTEMPTS} times; what is done is kept')
