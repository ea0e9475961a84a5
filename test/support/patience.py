# SPDX-License-Identifier: Apache-2.0
"""How long the suite waits for what has to come: one limit for all of it."""

from __future__ import annotations

from collections.abc import Callable
import os
import time
from typing import TypeVar

import pytest

__all__ = ['PATIENCE', 'wait_until']

Value = TypeVar('Value')
# Only what hangs takes this long. A machine with ten other jobs, or one that compiles everything
# for the first time, is slow and not wrong.
# Runs that expect to wait in vain, as those of test/mutation, ask for less.
PATIENCE = float(os.environ.get('ADAPTIVE_BLF_CONTROL_PATIENCE', '180'))  # s
POLL = 0.002  # s between looks


def wait_until(condition: Callable[[], Value], what: str = '') -> Value:
    """Return the first true value of ``condition``; fail where none comes within `PATIENCE`."""
    give_up = time.monotonic() + PATIENCE
    while True:
        value = condition()
        if value:
            return value
        if time.monotonic() > give_up:
            pytest.fail(f'not within {PATIENCE:g} s: {what or condition}')
        time.sleep(POLL)
