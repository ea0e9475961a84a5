# SPDX-License-Identifier: Apache-2.0
"""Types of command-line arguments that several commands share."""

from __future__ import annotations

import argparse
import math

__all__ = ['seconds']


def seconds(text: str) -> float:
    """Read a time > 0 s from the command line."""
    value = float(text)
    if not (math.isfinite(value) and value > 0.0):
        raise argparse.ArgumentTypeError(f'{text}: expected a time > 0 s')
    return value
