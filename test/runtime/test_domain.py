# SPDX-License-Identifier: Apache-2.0
"""Two runs on one machine never share a DDS domain, however they end."""

from __future__ import annotations

from contextlib import ExitStack, suppress
import os
from pathlib import Path
import socket
import subprocess
import sys

import pytest

from adaptive_blf_control.errors import BlfError
from adaptive_blf_control.runtime.domain import DOMAINS, own_domain


def test_runs_side_by_side_hold_different_domains_until_none_is_left(tmp_path: Path) -> None:
    with ExitStack() as stack:
        held = {stack.enter_context(own_domain(n, folder=tmp_path)) for n in DOMAINS}
        assert held == set(DOMAINS)
        with pytest.raises(BlfError, match='no DDS domain of 1 to 101 is free'):
            stack.enter_context(own_domain(folder=tmp_path))


def test_a_wanted_domain_is_taken_unless_another_run_holds_it(tmp_path: Path) -> None:
    with own_domain(42, folder=tmp_path) as first, own_domain(42, folder=tmp_path) as second:
        assert first == 42
        assert second in DOMAINS
        assert second != 42
    with own_domain(42, folder=tmp_path) as again:
        assert again == 42


@pytest.mark.parametrize('participant', [0, 1, 7])
def test_a_domain_in_which_a_node_listens_is_passed_over(tmp_path: Path, participant: int) -> None:
    with ExitStack() as stack:
        listening = set()
        for domain in range(1, 40):
            port = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            with suppress(OSError):  # someone listens there already
                port.bind(('', 7410 + 250 * domain + 2 * participant))
            listening.add(domain)
        for _ in range(30):
            with own_domain(folder=tmp_path) as domain:
                assert domain not in listening


def test_another_process_holds_its_domain_and_loses_it_when_it_is_killed(tmp_path: Path) -> None:
    script = ('import pathlib, sys; from adaptive_blf_control.runtime.domain import own_domain\n'
              'with own_domain(7, pathlib.Path(sys.argv[1])) as domain:\n'
              '    print(domain, flush=True); sys.stdin.read()')
    with subprocess.Popen([sys.executable, '-c', script, str(tmp_path)], stdin=subprocess.PIPE,
                          stdout=subprocess.PIPE) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == b'7\n'
        with own_domain(7, folder=tmp_path) as domain:
            assert domain != 7
        other.kill()
    with own_domain(7, folder=tmp_path) as domain:
        assert domain == 7


@pytest.mark.skipif(os.geteuid() == 0, reason='root may open every file')
def test_a_lock_file_that_cannot_be_opened_counts_as_held(tmp_path: Path) -> None:
    path = tmp_path / 'adaptive_blf_control_domain_5.lock'
    path.touch(mode=0o000)
    with own_domain(5, folder=tmp_path) as domain:
        assert domain != 5
