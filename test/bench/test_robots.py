# SPDX-License-Identifier: Apache-2.0
"""Facts about a row of ``bench robots``."""

from __future__ import annotations

import json

import pytest

pytest.importorskip('mujoco', reason='the extra mujoco is not installed')

from adaptive_blf_control.bench import robots

KNOWN = robots.Run(3, 2, 0.5, 0.25, {'no θ': (1e-12, 0.001), 'end': (0.01, 0.2)}, (),
                   float('nan'), 0, {'alarms': 1, 'contacts': 0, 'loads': 0, 'changes': 0}, 9.0,
                   'joint1 oscillates')


def test_a_run_that_ends_with_an_error_is_said_beside_the_others_and_costs_no_row(tmp_path):
    results = tmp_path / 'runs.jsonl'
    known = robots.Case('ideal', 'Panda', 1, 0.01, None)
    results.write_text(json.dumps({'case': known, 'run': KNOWN._asdict()}) + '\n')
    refused = robots.Case('ideal', 'Panda', 0, 0.01, 1e6)  # a suspicion beyond the threshold
    row = robots._row_of('ideal', 'Panda', [refused, known], results)  # what the command prints
    assert '| ideal | Panda | 1 | 3 | 2 | 0.50 | 25 | 1 / 20 | 0 / 0.1 |' in row
    assert 'alarms 1' in row
    assert 'joint1 oscillates; 1 of 2 ended: ' in row
    assert 'identifier.change.suspicion' in row
    alone = robots._row_of('ideal', 'Panda', [refused], results)
    assert alone.startswith('| ideal | Panda | refused: ')
