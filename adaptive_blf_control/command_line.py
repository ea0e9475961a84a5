# SPDX-License-Identifier: Apache-2.0
"""Types of command-line arguments that several commands share."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
import math
import os
import signal
import sys

__all__ = ['joint_names', 'quiet_when_unread', 'seconds']


def joint_names(words: Sequence[str] | None) -> list[str] | None:
    """Return the names in words that may be lists with commas; None where nothing is given."""
    if words is None:
        return None
    return [name.strip() for word in words for name in word.split(',') if name.strip()]


@contextmanager
def quiet_when_unread() -> Iterator[None]:
    """End quietly, as other programs do, where nobody reads standard output any more.

    Raises:
        SystemExit: with the status of a program that SIGPIPE ended.
    """
    try:
        yield
        sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # for the flush at exit
        raise SystemExit(128 + signal.SIGPIPE) from None


def seconds(text: str) -> float:
    """Read a time > 0 s from the command line."""
    value = float(text)
    if not (math.isfinite(value) and value > 0.0):
        raise argparse.ArgumentTypeError(f'{text}: expected a time > 0 s')
    return value
