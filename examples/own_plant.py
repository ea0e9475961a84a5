# SPDX-License-Identifier: Apache-2.0
"""Drive a plant of your own: anything that measures, takes a torque and moves on in time."""

import numpy as np

import adaptive_blf_control as blf
from adaptive_blf_control.simulation.sensors import Measurement


class Pendulums:
    """Two joints that do not feel each other: I q̈ = τ − b q̇. Nobody tells their parameters."""

    def __init__(self) -> None:
        self.q, self.qd, self.torque = np.zeros(2), np.zeros(2), np.zeros(2)

    def measure(self, torque: np.ndarray, dt: float) -> Measurement:
        return Measurement(self.q, self.qd, torque)

    def measured_position(self) -> np.ndarray:
        return self.q

    def apply(self, torque: np.ndarray) -> None:
        self.torque = torque

    def advance(self, dt: float) -> None:
        self.qd = self.qd + dt * (self.torque - [2.0, 1.0] * self.qd) / [3.0, 0.5]
        self.q = self.q + dt * self.qd

    def brake(self) -> None:
        self.qd, self.torque = np.zeros(2), np.zeros(2)


arm = blf.TwoLinkArm()  # what the plant is believed to be like, not its numbers
swing = {'amplitude': [0.3, 0.2], 'frequency': [1.5, 4.0], 'phase': [0.0, 0.0]}
controller = blf.Controller(arm, k2=[30.0, 10.0], reference={
    'of_joint': {'joint1': swing, 'joint2': swing}})
loop = blf.ClosedLoop(Pendulums(), controller, blf.Identifier(arm), period=1e-3,
                      initial_estimate=np.zeros(arm.m))
run = blf.simulate(loop, duration=5.0)

print(run)
print('joint 1 feels an inertia of',
      round(float((arm.Y1(np.zeros(2), np.array([1.0, 0.0])) @ run.trace.theta_hat[-1])[0]), 2))
