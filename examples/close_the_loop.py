# SPDX-License-Identifier: Apache-2.0
"""Close the loop: an unknown arm stays inside its sets while its parameters are learned."""

from pathlib import Path

import adaptive_blf_control as blf

scenario = Path(__file__).parents[1] / 'config' / 'two_link.yaml'

# The same objects as in the nodes, in lockstep and without ROS. Every parameter can be changed.
run = blf.simulate(scenario, duration=3.0, changes={
    'controller.k2': [30.0, 5.0],         # N·m·s/rad
    'arm_driver.torque_limit': [150.0],   # N·m
})

print(run)
print(f'largest error: {abs(run.trace.e1).max():.4f} rad, sets kept: {run.kept}')
print('learned:', {name: round(value, 3) for name, value in run.loop.identifier.estimate.items()})
