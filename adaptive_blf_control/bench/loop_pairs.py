# SPDX-License-Identifier: Apache-2.0
"""``bench loop_pairs``: the closed loop offline in turn with that of an older commit."""

from __future__ import annotations

from adaptive_blf_control.bench.commit_pairs import Pairs

__all__ = ['LOOP_PAIRS']

PROGRAM = """
import json, sys, time
from pathlib import Path
from adaptive_blf_control.{loading} import load_yaml
from adaptive_blf_control.{building} import build_closed_loop

data = load_yaml(Path(sys.argv[1]))
build_closed_loop(data).run(0.1)  # what is compiled is loaded
loop = build_closed_loop(data)
begin = time.process_time()
loop.run(float(sys.argv[2]))
spent = time.process_time() - begin
print(json.dumps({{'a step': 1e6 * spent * loop.period / float(sys.argv[2])}}))
"""

LOOP_PAIRS = Pairs(
    'loop_pairs', 'processor time of', '[µs]',
    PROGRAM.format(loading='parameters.yaml_file', building='simulation.closed_loop'),
    PROGRAM.format(loading='configuration.parameter_file',
                   building='configuration.build_closed_loop'),
    (('two_link', 'two_link', 10.0), ('panda_ideal', 'panda', 4.0)))
