# SPDX-License-Identifier: Apache-2.0
"""``bench step_pairs``: the steps of the nodes in turn with those of an older commit."""

from __future__ import annotations

import json
from pathlib import Path
import statistics

from adaptive_blf_control.bench import node_steps, steps_at_d8177d4
from adaptive_blf_control.bench.commit_pairs import Pairs
from adaptive_blf_control.configuration.parameter_file import load_yaml

__all__ = ['print_medians', 'STEP_PAIRS']

STEP_PAIRS = Pairs(
    'step_pairs', 'node', 'p50 [µs]',
    Path(steps_at_d8177d4.__file__).read_text(encoding='utf-8'),
    'import sys; from adaptive_blf_control.bench.step_pairs import print_medians; '
    'print_medians(sys.argv[1], float(sys.argv[2]))',
    # The smooth start is a small part of these times.
    (('two_link', 'two_link', 5.0), ('panda_ideal', 'panda', 8.0)))


def print_medians(scenario: str, duration: float) -> None:
    """Print the medians of the present steps as JSON, by node [µs]."""
    times = node_steps.times_of(load_yaml(Path(scenario)), duration)
    print(json.dumps({node: statistics.median(each) for node, each in times.items()}))
