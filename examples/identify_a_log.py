# SPDX-License-Identifier: Apache-2.0
"""Learn the parameters of a robot from its log: ``identify_a_log.py [LOG ROBOT.urdf]``.

LOG is a bag, or CSV with t, q1.., qd1.., tau1.. . Without arguments a log is made first.
"""

import sys

import numpy as np

import adaptive_blf_control as blf


def made_log() -> dict[str, np.ndarray]:
    """Swing the paper's two-link arm for 4 s and return what its sensors see."""
    arm = blf.TwoLinkArm()
    robot, q, qd = arm.dynamics(arm.nominal), [0.0, 1.0], [0.0, 0.0]
    rows = [(0.0, q, qd, [0.0, 0.0])]
    for k in range(1, 4001):  # at 1 kHz; the torque is held over each interval
        tau = [8.0 * np.sin(3e-3 * k) + 4.0 * np.sin(11e-3 * k), 2.5 * np.cos(4e-3 * k)]
        q, qd = robot.advance(q, qd, tau, 1e-3)
        rows.append((k * 1e-3, q, qd, tau))
    return dict(zip(('t', 'q', 'qd', 'tau'), map(np.array, zip(*rows))))


if len(sys.argv) == 3:
    result = blf.identify(sys.argv[1], urdf=sys.argv[2])
else:
    result = blf.identify(made_log(), arm=blf.TwoLinkArm(), filter={'time_constant': 0.01})

print(result)  # the first half of the log has taught, the second is predicted
print()
for name, value in result.estimate.items():
    print(f'{name:<12}{value:10.4f}')
print('not determined by this log:', ', '.join(result.undetermined) or 'none')
worst = np.abs(result.prediction.predicted - result.prediction.measured).max(axis=0)
print('largest error of the predicted torque:', worst.round(4), 'N·m')
