# SPDX-License-Identifier: Apache-2.0
"""Facts about the times of the nodes' steps: they are those of the loop, one for each sample."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.bench import node_steps
from adaptive_blf_control.configuration.build_closed_loop import build_closed_loop
from adaptive_blf_control.configuration.parameter_file import load_yaml


def test_each_sample_of_both_nodes_is_timed_and_gives_what_the_loop_gives(
        repository, monkeypatch):
    data = load_yaml(repository / 'config' / 'two_link.yaml')
    loops = [build_closed_loop(data) for _ in range(2)]
    monkeypatch.setattr(node_steps, 'build_closed_loop', lambda _: loops[0])
    times = node_steps.times_of(data, 0.2)
    assert [values.shape for values in times.values()] == [(200,), (200,)]
    assert all((values > 0.0).all() for values in times.values())
    samples = list(loops[1].samples(0.199))
    np.testing.assert_array_equal(loops[0].identifier.theta, samples[-1].theta_hat)
