# SPDX-License-Identifier: Apache-2.0
"""Close the loop: an unknown arm stays inside its sets while its parameters are learned."""

from pathlib import Path

import adaptive_blf_control as blf

scenario = Path(__file__).parents[1] / 'config' / 'two_link.yaml'

# The same objects as in the nodes, in lockstep and without ROS. Every parameter of the scenario
# can be changed; docs/parameters.md lists them all.
run = blf.simulate(scenario, duration=3.0,
                   controller={'k2': [30.0, 5.0]},      # N·m·s/rad
                   arm_driver={'torque_limit': 150.0})  # N·m, for both joints

print(run)
# The run as arrays over its samples: t, q, qd, e1, torque, theta_hat, rank, sigma_min.
print(f'largest error: {abs(run.e1).max():.4f} rad, sets kept: {run.kept}')
print('learned:', {name: round(value, 3) for name, value in run.identifier.estimate.items()})
