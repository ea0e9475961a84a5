# SPDX-License-Identifier: Apache-2.0
"""``python -m adaptive_blf_control EXECUTABLE ...``: every executable without ROS's own CLI."""

from __future__ import annotations

import importlib
import sys

from adaptive_blf_control import __version__
from adaptive_blf_control.command_line import quiet_when_unread
from adaptive_blf_control.executables import (
    BENCHES,
    COMPOSED,
    entry_of,
    EXECUTABLES,
    NODES,
    TOOLS,
)

__all__ = ['main', 'usage']

PROGRAM = 'python -m adaptive_blf_control'


def usage() -> str:
    """Return the help text with every executable and what it does."""
    def rows(table: dict[str, str]) -> str:
        return '\n'.join(f'  {name:<12}{summary}' for name, summary in table.items())

    return (f'usage: {PROGRAM} EXECUTABLE [ARGUMENTS]\n\n'
            f'nodes (take --ros-args --params-file FILE):\n{rows({**NODES, **COMPOSED})}\n\n'
            f'tools (each has --help):\n{rows(TOOLS)}\n\n'
            f'benchmarks and studies (each has --help):\n{rows(BENCHES)}')


def main(args: list[str] | None = None) -> int:
    """Run the executable named by the first argument with the arguments that follow.

    Args:
        args: Arguments without the program name; ``sys.argv[1:]`` if None.

    Returns:
        The executable's exit status; 0 after ``--help`` or ``--version``; 2 where the first
        argument names no executable, as argparse does.
    """
    args = sys.argv[1:] if args is None else args
    if not args:
        print(usage(), file=sys.stderr)
        return 2
    name, *rest = args
    if name in ('-h', '--help'):
        print(usage())
        return 0
    if name == '--version':
        print(__version__)
        return 0
    if name not in EXECUTABLES:
        print(f'no executable {name!r}: expected one of {", ".join(EXECUTABLES)}',
              file=sys.stderr)
        return 2
    # What reads sys.argv by itself (argparse's program name, rclpy.init) sees what ros2 run gives.
    sys.argv = [f'{PROGRAM} {name}', *rest]
    module, function = entry_of(name)
    with quiet_when_unread():
        status: int = getattr(importlib.import_module(module), function)(rest)
    return status


if __name__ == '__main__':
    sys.exit(main())
