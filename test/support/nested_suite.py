# SPDX-License-Identifier: Apache-2.0
"""A suite within the suite: some of its tests in a process of their own."""

from __future__ import annotations

from collections.abc import Callable
import os
from pathlib import Path
import subprocess
import sys

from patience import PATIENCE

__all__ = ['run_tests']

REPOSITORY = Path(__file__).resolve().parents[2]


def run_tests(*arguments: str, before: Callable[[], None] | None = None,
              **environment: str) -> subprocess.CompletedProcess[str]:
    """Run ``pytest ARGUMENTS`` in the repository and return what came of it.

    Args:
        arguments: What to run, and options.
        before: Called in the process before pytest begins.
        environment: Variables in addition to those of this process; what tells pytest of this
            run (colcon's report file, the worker of pytest-xdist) is left out.
    """
    inherited = {name: value for name, value in os.environ.items()
                 if not name.startswith('PYTEST_')}
    return subprocess.run(
        [sys.executable, '-m', 'pytest', '-q', '-p', 'no:cacheprovider', *arguments],
        cwd=REPOSITORY, env={**inherited, **environment}, preexec_fn=before,
        stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=PATIENCE)
