# SPDX-License-Identifier: Apache-2.0
"""Where the runs of a campaign are computed: processes of this machine, or a Dask cluster.

Both are executors of `concurrent.futures`, so that a chunk goes the same way everywhere. A worker
that dies costs its chunk: Dask gives it to another worker, here it is run again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import as_completed, Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
import multiprocessing
import signal
from typing import Any

from adaptive_blf_control.campaigns.campaign import Campaign
from adaptive_blf_control.campaigns.outcome import Outcome, run_chunk
from adaptive_blf_control.errors import BlfError, MissingExtra

__all__ = ['cluster', 'local', 'run_chunks']

ATTEMPTS = 3  # a chunk that ends its worker so often is to blame itself
CONNECT_TIMEOUT = 10.0  # s


def _leave_the_end_to_the_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)


@contextmanager
def local(workers: int) -> Iterator[Callable[[], Executor]]:
    """Yield what makes an executor of ``workers`` processes on this machine.

    They are started afresh, not forked: numba and OpenBLAS do not survive a fork with threads.
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


@contextmanager
def cluster(scheduler: str) -> Iterator[Callable[[], Executor]]:
    """Yield what makes an executor on the Dask cluster of ``scheduler``, e.g. tcp://host:8786.

    Raises:
        MissingExtra: Dask's distributed is not installed.
        BlfError: the scheduler does not answer.
    """
    try:
        from distributed import Client
    except ImportError:
        raise MissingExtra('distributed', 'campaign', 'a campaign on a cluster') from None
    try:
        client = Client(scheduler, timeout=CONNECT_TIMEOUT, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise BlfError(f'--scheduler {scheduler}: does not answer within {CONNECT_TIMEOUT:g} s '
                       f'({" ".join(str(error).split())})') from None
    with client:
        yield lambda: client.get_executor(pure=False, retries=ATTEMPTS)


def run_chunks(campaign: Campaign, missing: list[int], make: Callable[[], Executor],
               ) -> Iterator[tuple[int, list[Outcome]]]:
    """Compute chunks; yield the number of each and its outcomes as it is done.

    Args:
        campaign: What is run.
        missing: Numbers of the chunks.
        make: Makes an executor; called again where one broke because a worker died.

    Raises:
        BlfError: a chunk ended its worker again and again.
    """
    ahead = dict.fromkeys(missing, 0)
    while ahead:
        executor = make()
        futures = {_submit(executor, campaign, number): number for number in ahead}
        try:
            for future in as_completed(futures):
                number = futures[future]
                outcomes = future.result()
                del ahead[number]
                yield number, outcomes
        except BrokenProcessPool:
            _count_attempts(ahead, futures)


def _submit(executor: Executor, campaign: Campaign, number: int) -> Future[Any]:
    changes = [(run, campaign.changes[run]) for run in campaign.chunks[number]]
    return executor.submit(run_chunk, campaign.data, campaign.duration, changes)


def _count_attempts(ahead: dict[int, int], futures: dict[Future[Any], int]) -> None:
    """Blame the first chunk that was not done: the pool does not say which of them broke it."""
    first = min(ahead, key=list(futures.values()).index)
    ahead[first] += 1
    if ahead[first] >= ATTEMPTS:
        raise BlfError(f'chunk {first} ended its worker {ATTEMPTS} times; what is done is kept')
