# SPDX-License-Identifier: Apache-2.0
"""What every test may rely on, wherever the suite was started from."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest

from adaptive_blf_control.runtime.domain import own_domain
from nested_suite import run_tests
from patience import PATIENCE

IGNORED = 'import signal; print([n for n in (1, 2, 15) if signal.getsignal(n) == signal.SIG_IGN])'


def test_what_a_test_starts_ignores_no_signal_that_ends_it() -> None:
    child = subprocess.run([sys.executable, '-c', IGNORED], capture_output=True, text=True,
                           timeout=PATIENCE, check=True)
    assert child.stdout == '[]\n'


@pytest.mark.parametrize('workers', [0, 1])
def test_signals_that_the_suite_was_started_to_ignore_are_not_passed_on(workers: int) -> None:
    pytest.importorskip('xdist')

    def ignore() -> None:  # as a shell does for what it starts in the background, and nohup
        for number in (signal.SIGINT, signal.SIGHUP):
            signal.signal(number, signal.SIG_IGN)

    suite = run_tests('-n', str(workers), 'test/test_suite.py', '-k', 'ignores_no_signal',
                      before=ignore)
    assert suite.returncode == 0, suite.stdout
    assert '1 passed' in suite.stdout


def test_the_domain_of_a_suite_is_held_for_it_alone() -> None:
    mine = int(os.environ['ROS_DOMAIN_ID'])
    with own_domain(mine) as others:  # what another suite, or a demo, would get
        assert others != mine
