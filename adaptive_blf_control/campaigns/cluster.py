# SPDX-License-Identifier: Apache-2.0
"""A Dask cluster that computes a campaign.

A worker that dies costs its chunk, which Dask gives to another one. A task costs Dask 2 to 3 ms:
see `campaign.usual_chunk`.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from adaptive_blf_control import __version__
from adaptive_blf_control.campaigns.workers import ATTEMPTS, MakeExecutor
from adaptive_blf_control.errors import BlfError, MissingExtra

__all__ = ['cluster']

CONNECT_TIMEOUT = 10.0  # s


def _version() -> str:
    import adaptive_blf_control
    return adaptive_blf_control.__version__


@contextmanager
def cluster(scheduler: str) -> Iterator[MakeExecutor]:
    """Yield what makes an executor on the Dask cluster of ``scheduler``, e.g. tcp://host:8786.

    Raises:
        MissingExtra: Dask's distributed is not installed.
        BlfError: the scheduler does not answer or has no workers, a worker has another version of
            this package or none, or a chunk ended worker after worker.
    """
    try:
        from distributed import Client, KilledWorker
    except ImportError:
        raise MissingExtra('distributed', 'campaign', 'a campaign on a cluster') from None
    try:
        client = Client(scheduler, timeout=CONNECT_TIMEOUT, set_as_default=False)
    except (OSError, ValueError, asyncio.TimeoutError) as error:
        raise BlfError(f'--scheduler {scheduler}: does not answer within {CONNECT_TIMEOUT:g} s '
                       f'({" ".join(str(error).split())})') from None
    with client:
        _check_workers(scheduler, client)
        try:
            yield lambda: client.get_executor(pure=False, retries=ATTEMPTS)
        except KilledWorker as error:
            raise BlfError(f'--scheduler {scheduler}: a chunk ended worker after worker; what is '
                           f'done is kept ({" ".join(str(error).split())})') from None


def _check_workers(scheduler: str, client: Any) -> None:
    """Refuse a cluster whose outcomes would not be those of this machine."""
    try:
        client.wait_for_workers(1, timeout=CONNECT_TIMEOUT)
    except asyncio.TimeoutError:  # Python 3.10 knows it as another TimeoutError
        raise BlfError(f'--scheduler {scheduler}: has no workers after {CONNECT_TIMEOUT:g} s: '
                       f'start some, dask worker {scheduler}') from None
    for worker, version in client.run(_version, on_error='return').items():
        if version != __version__:
            raise BlfError(f'worker {worker} of --scheduler {scheduler} has adaptive_blf_control '
                           f'{version!s}: expected {__version__}, as here')
