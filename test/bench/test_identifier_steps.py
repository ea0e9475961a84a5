# SPDX-License-Identifier: Apache-2.0
"""Facts about the times of the identifier's steps: every step of a run is counted once."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.bench.identifier_steps import table, times_of
from adaptive_blf_control.configuration.build_closed_loop import build_closed_loop
from adaptive_blf_control.configuration.parameter_file import load_yaml


def test_every_update_and_every_candidate_of_a_full_history_is_timed(repository):
    data = load_yaml(repository / 'config' / 'two_link.yaml')
    times = times_of(data, 2.0)
    loop = build_closed_loop(data)
    loop.run(2.0)
    assert len(times['update of θ̂']) == 2000
    stack = loop.identifier.stack
    assert 0 < len(times['candidate taken']) <= stack.insertions - stack.size
    assert len(times['candidate refused']) > 0
    assert all((values > 0.0).all() for values in times.values())


def test_a_step_that_did_not_occur_has_no_percentiles():
    lines = table({'taken': np.array([1.0, 2.0, 3.0]), 'refused': np.zeros(0)}).splitlines()
    assert lines[2:] == ['| taken | 3 | 2.0 | 3.0 |', '| refused | 0 | nan | nan |']
