# SPDX-License-Identifier: Apache-2.0
"""Measure the simulated arm with a sensor of your own: here one that shows what was a while ago.

In a parameter file the same class is named by ``arm_driver.sensors.model: own_sensor:Late``.
"""

from collections import deque

import adaptive_blf_control as blf

SAMPLES = 3  # that a measurement is late


class Late(blf.Sensor):
    """Positions and velocities of three samples ago, as behind a slow bus."""

    def __init__(self, settings=None, arm=None):
        self.seen = deque(maxlen=SAMPLES + 1)

    def measure(self, q, qd, torque, dt):  # once a sample; q [rad], qd [rad/s], torque [N·m]
        self.seen.append((q, qd))
        return blf.Measurement(*self.seen[0], torque)


if __name__ == '__main__':
    swing = {'amplitude': 0.3, 'frequency': 2.0}
    for sensor in (None, Late):  # None: the scenario's, which is perfect
        run = blf.simulate(blf.TwoLinkArm(), 10.0, sensor=sensor, controller={
            'k2': [30.0, 10.0], 'reference': {'joint1': swing, 'joint2': swing}})
        name = 'perfect' if sensor is None else sensor.__name__
        print(f'{name:<8} sets kept: {run.kept}, largest error {abs(run.e1).max():.4f} rad, '
              f'friction of joint 1: {run.identifier.estimate["fv_joint1"]:.2f} N·m·s/rad')
