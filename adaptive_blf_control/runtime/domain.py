# SPDX-License-Identifier: Apache-2.0
"""A DDS domain for one run alone, so that two runs on one machine do not meet."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import fcntl
import os
from pathlib import Path
import random
import socket
import tempfile

from adaptive_blf_control.errors import BlfError

__all__ = ['DOMAINS', 'own_domain']

# On Linux the ports of these domains are no ephemeral ones; 0 is the default of every ROS graph.
DOMAINS = range(1, 102)
PARTICIPANTS = 20  # whose ports are tried: the first may have ended before the others


@contextmanager
def own_domain(wanted: int | None = None, folder: Path | None = None) -> Iterator[int]:
    """Hold a domain id that no other run of this package on this machine holds.

    The claim is an advisory lock on a file per domain, which the system releases when the process
    ends, however it ends. A domain in which a node of another program listens is not taken.

    Args:
        wanted: The domain to take if no other run holds it, also if other programs listen in it.
        folder: Where the lock files lie; the system's folder for temporary files where None.

    Yields:
        The domain id: `wanted`, or another one where that is held or not given.

    Raises:
        BlfError: no domain is free.
    """
    folder = Path(tempfile.gettempdir()) if folder is None else folder
    candidates = random.sample(DOMAINS, len(DOMAINS))
    if wanted is not None:
        candidates.insert(0, wanted)
    for domain in candidates:
        lock = _lock(folder / f'adaptive_blf_control_domain_{domain}.lock')
        if lock is None:
            continue
        try:
            if domain == wanted or _is_silent(domain):
                yield domain
                return
        finally:
            os.close(lock)
    raise BlfError(f'no DDS domain of {DOMAINS.start} to {DOMAINS.stop - 1} is free: '
                   'name one with ROS_DOMAIN_ID')


def _lock(path: Path) -> int | None:
    """Return the locked file, or None where another process holds it or it cannot be opened."""
    try:
        # With O_CREAT, a file of another user in a sticky folder cannot be opened.
        flags = os.O_RDONLY | os.O_CLOEXEC | (0 if path.exists() else os.O_CREAT)
        file = os.open(path, flags, 0o644)
    except OSError:
        return None
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(file)
        return None
    return file


def _is_silent(domain: int) -> bool:
    """Whether the discovery ports of the domain's first participants are free."""
    for participant in range(PARTICIPANTS):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind(('', 7410 + 250 * domain + 2 * participant))
            except OSError:
                return False
    return True
