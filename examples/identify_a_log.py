# SPDX-License-Identifier: Apache-2.0
"""Learn the parameters of a robot from its log: ``identify_a_log.py [LOG.csv ROBOT.urdf]``.

Without arguments a log of the two-link arm is made first, as CSV with t, q1.., qd1.., tau1.. .
"""

from pathlib import Path
import sys
import tempfile

import numpy as np

import adaptive_blf_control as blf


def make_log(path: Path) -> None:
    """Swing the paper's two-link arm for 4 s and write what its sensors see."""
    arm = blf.TwoLinkArm()
    robot, q, qd = arm.dynamics(arm.nominal), np.array([0.0, 1.0]), np.zeros(2)
    rows = [[0.0, *q, *qd, 0.0, 0.0]]
    for k in range(1, 4001):  # at 1 kHz; the torque is held over each interval
        tau = np.array([8.0 * np.sin(3e-3 * k) + 4.0 * np.sin(11e-3 * k), 2.5 * np.cos(4e-3 * k)])
        q, qd = robot.advance(q, qd, tau, 1e-3, 1)
        rows.append([k * 1e-3, *q, *qd, *tau])
    header = 't,q1,q2,qd1,qd2,tau1,tau2'
    np.savetxt(path, rows, delimiter=',', header=header, comments='')


if len(sys.argv) == 3:
    result = blf.identify(sys.argv[1], urdf=sys.argv[2])
else:
    with tempfile.TemporaryDirectory() as folder:
        make_log(Path(folder) / 'log.csv')
        result = blf.identify(Path(folder) / 'log.csv', changes={
            'arm': 'two_link', 'filter.time_constant': 0.01, 'history.size': 20})

print(result)
print()
for name, value in result.theta.items():
    print(f'{name:<12}{value:10.4f}')
print('not determined by this log:', ', '.join(result.undetermined) or 'none')
