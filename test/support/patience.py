# SPDX-License-Identifier: Apache-2.0
"""How long the suite waits for what has to come: one limit for all of it."""

from __future__ import annotations

from collections.abc import Callable
import os
import time
from typing import TypeVar

import pytest

__all__ = ['MEANT_TO_FAIL', 'PATIENCE', 'wait_until']

Value = TypeVar('Value')
# Only what hangs takes this long. A machine with ten other jobs, or one that compiles everything
# for the first time, is slow and not wrong.
# A run whose tests are meant to fail (test/mutation) does not wait for what was taken away.
MEANT_TO_FAIL = bool(os.environ.get('ADAPTIVE_BLF_CONTROL_MEANT_TO_FAIL'))
PATIENCE = 30.0 if MEANT_TO_FAIL else 180.0  # s
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
