# SPDX-License-Identifier: Apache-2.0
"""A control law of your own: sets, torque limits and learning stay with the controller.

In a parameter file the same class is named with ``controller.law: own_law:Gravity``.
"""

import numpy as np

import adaptive_blf_control as blf
from adaptive_blf_control.control.laws import LawAnswer


class Gravity:
    """Feed-forward of the model that is being learned, and a spring with damping on top."""

    def __init__(self, arm, settings):
        self.arm, self.damping = arm, settings.k2

    def answer(self, sample):
        error = sample.q - sample.reference.position
        rate = sample.qd - sample.reference.velocity
        model = self.arm.X(sample.q, sample.qd, sample.reference.velocity,
                           sample.reference.acceleration) @ sample.theta
        return LawAnswer(torque=model - 10.0 * self.damping * error - self.damping * rate,
                         e2=rate, regressor=None)  # no adaptation term


arm = blf.TwoLinkArm()
plant = arm.dynamics(arm.nominal)
swing = {'amplitude': [0.3], 'frequency': [2.0], 'phase': [0.0]}
reference = {'of_joint': {'joint1': swing, 'joint2': swing}}
settings = blf.ControllerSettings(k2=[30.0, 10.0], reference=reference).resolved(joints=arm.n)
controller = blf.Controller(arm, settings, law=Gravity(arm, settings))
identifier = blf.Identifier(arm, update_law='concurrent')

q, qd, held, worst = np.zeros(2), np.zeros(2), np.zeros(2), []
for k in range(5000):
    theta = identifier.update(k * 1e-3, q, qd, held)
    output = controller.update(k * 1e-3, q, qd, theta)
    worst.append(np.abs(output.e1).max())
    held = output.torque
    q, qd = plant.advance(q, qd, held, 1e-3, 1)

print(f'largest error in the first second {max(worst[:1000]):.4f} rad, '
      f'in the last {max(worst[-1000:]):.4f} rad')
print(identifier)
