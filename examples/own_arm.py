# SPDX-License-Identifier: Apache-2.0
"""An arm of your own, linear in its parameters: here a slider on a slope, with friction."""

import numpy as np

import adaptive_blf_control as blf


class Slider(blf.Arm):
    """One prismatic joint: m q̈ + b q̇ + g = τ, so θ = (m, b, g)."""

    joints, parameters = ('rail',), ('mass', 'friction', 'weight')
    nominal = np.array([4.0, 2.0, 6.0])  # what the simulated arm has

    def Y1(self, q, qd):  # Y1 θ = m q̇: the momentum
        return np.array([[qd[0], 0.0, 0.0]])

    def Y2(self, q, qd):  # Y2 θ = b q̇ + g: all that needs no acceleration
        return np.array([[0.0, qd[0], 1.0]])

    def X(self, q, qd, alpha, alpha_dot):  # X θ = m α̇ + b q̇ + g
        return np.array([[alpha_dot[0], qd[0], 1.0]])

    def dynamics(self, theta):  # only to simulate it
        return SliderDynamics(theta)


class SliderDynamics(blf.ForwardDynamics):
    """The true slider."""

    def __init__(self, theta):
        self.mass, self.friction, self.weight = theta

    def acceleration(self, q, qd, tau):
        return (tau - self.friction * qd - self.weight) / self.mass


arm = Slider()
run = blf.simulate(arm, 5.0, controller={
    'reference': {'rail': {'amplitude': [0.4, 0.1], 'frequency': [2.0, 5.0], 'phase': [0, 0]}}})

print(run)
for name, true in zip(arm.parameters, arm.nominal):
    print(f'{name:<10}{run.identifier.estimate[name]:8.3f}   true {true:g}')
