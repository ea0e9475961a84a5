# SPDX-License-Identifier: Apache-2.0
"""An arm of your own, linear in its parameters: here a slider with a pendulum's friction."""

import numpy as np

import adaptive_blf_control as blf


class Slider:
    """One prismatic joint on a slope: m q̈ + b q̇ + g = τ, θ = (m, b, g)."""

    joints, parameters = ('rail',), ('mass', 'friction', 'weight')
    nominal, payload_direction, n, m = np.array([4.0, 2.0, 6.0]), None, 1, 3

    def Y1(self, q, qd):  # Y1 θ = m q̇, the momentum
        return np.array([[qd[0], 0.0, 0.0]])

    def Y2(self, q, qd):  # Y2 θ = b q̇ + g, the rest without an acceleration
        return np.array([[0.0, qd[0], 1.0]])

    def Y12(self, q, qd):
        return self.Y1(q, qd), self.Y2(q, qd)

    def X(self, q, qd, alpha, alpha_dot):  # X θ = m α̇ + b q̇ + g
        return np.array([[alpha_dot[0], qd[0], 1.0]])


arm = Slider()
identifier = blf.Identifier(arm)

# A log of 2 s at 1 kHz: the rail is pushed, its motion is integrated.
q, qd, dt = np.zeros(1), np.zeros(1), 1e-3
held = np.zeros(1)  # torque over the interval that ends with the sample
for k in range(2000):
    tau = np.array([6.0 + 20.0 * np.sin(0.01 * k)])
    identifier.update(k * dt, q, qd, held)
    mass, friction, weight = arm.nominal
    acceleration = (tau - friction * qd - weight) / mass
    q, qd, held = q + dt * qd + 0.5 * dt**2 * acceleration, qd + dt * acceleration, tau

print(identifier)
for name, true in zip(arm.parameters, arm.nominal):
    print(f'{name:<10}{identifier.estimate[name]:8.3f}   true {true:g}')
