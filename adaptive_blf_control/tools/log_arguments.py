# SPDX-License-Identifier: Apache-2.0
"""Arguments of a command that tell how measured logs are read."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
import math

from adaptive_blf_control.bags.log_columns import given_columns
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.runs.log_options import LogOptions

__all__ = ['add_log_arguments', 'log_options']


def add_log_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that `log_options` reads."""
    group = parser.add_argument_group('reading the log')
    group.add_argument('--topic', metavar='T', help='topic of joint values of the bag')
    group.add_argument('--columns', metavar='KIND=COLUMN,...',
                       help='columns of a CSV file: t, q, qd and tau, where * stands for the '
                       'joint and numbers count columns, e.g. t=stamp[ms],q=pos_*,tau=9..15; '
                       'those that are not given are found by their names')
    group.add_argument('--degrees', action='store_true',
                       help='positions and velocities are in degrees')
    group.add_argument('--gain', action='append', default=[], metavar='JOINT:K',
                       help='multiply the effort of a joint, e.g. by the N·m/A of its drive')
    group.add_argument('--effort-delay', type=float, default=0.0, metavar='S',
                       help='the effort is this much behind the motion [s]')
    group.add_argument('--force', action='store_true',
                       help='learn also from a log that cannot be right')


def log_options(options: argparse.Namespace) -> LogOptions:
    """Return how logs are read.

    Raises:
        LogError: ``--columns`` cannot be read.
        ParameterError: another argument cannot be used.
    """
    return LogOptions(options.topic, given_columns(options.columns) if options.columns else None,
                      options.degrees, _gains(options.gain), options.effort_delay, options.force)


def _gains(given: Iterable[str]) -> dict[str, float]:
    gains = {}
    for part in (part for text in given for part in text.split(',')):
        joint, colon, value = part.rpartition(':')
        try:
            gains[joint.strip()] = float(value)
        except ValueError:
            colon = ''
        if not colon or not math.isfinite(gains[joint.strip()]):
            raise ParameterError('--gain', part, 'JOINT:K with a number K')
    return gains
