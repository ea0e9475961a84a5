# SPDX-License-Identifier: Apache-2.0
"""What the nodes without control work are told by ``bench rates``."""

from __future__ import annotations

import argparse
from collections.abc import Collection
from pathlib import Path

__all__ = ['plain_options']


def plain_options(args: list[str] | None, prog: str, description: str | None,
                  nodes: Collection[str]) -> argparse.Namespace:
    """Return which of ``nodes`` runs, at which rate [Hz], for how long [s], and with what."""
    parser = argparse.ArgumentParser(prog=prog, description=description)
    parser.add_argument('node', choices=tuple(nodes))
    parser.add_argument('--rate', type=float, default=1000.0, help='of the states [Hz]')
    parser.add_argument('--seconds', type=float, default=30.0, help='how long the driver runs')
    parser.add_argument('--joints', type=int, default=2, help='of the states')
    parser.add_argument('--parameters', type=int, default=5, help='of the vector, if there is one')
    parser.add_argument('--output', type=Path, required=True, help='file for the times, .npz')
    return parser.parse_args(args)
