# SPDX-License-Identifier: Apache-2.0
"""Drive a plant of your own: a simulator, or a robot behind your own driver.

In a parameter file the same class is named by ``arm_driver.plant: own_plant:Pendulums``.
"""

import numpy as np

import adaptive_blf_control as blf


class Pendulums(blf.Plant):
    """Two joints that do not feel each other: I q̈ = τ − b q̇. Nobody tells their parameters."""

    def __init__(self, settings=None, arm=None):
        self.q, self.qd, self.torque = np.zeros(2), np.zeros(2), np.zeros(2)

    def advance(self, dt):  # move on by dt [s] under self.torque [N·m]
        self.qd = self.qd + dt * (self.torque - [2.0, 1.0] * self.qd) / [3.0, 0.5]
        self.q = self.q + dt * self.qd

    # Its sensors are perfect. Others: def measure(self, torque, dt) -> blf.Measurement.


if __name__ == '__main__':
    arm = blf.TwoLinkArm()  # what the plant is believed to be like, not its numbers
    swing = {'amplitude': [0.3, 0.2], 'frequency': [1.5, 4.0], 'phase': [0.0, 0.0]}
    run = blf.simulate(arm, 5.0, plant=Pendulums(), controller={
        'k2': [30.0, 10.0], 'reference': {'joint1': swing, 'joint2': swing}})

    print(run)
    inertia = arm.Y1([0.0, 0.0], [1.0, 0.0]) @ run.identifier.theta
    print(f'joint 1 feels an inertia of {inertia[0]:.2f} kg·m²')
