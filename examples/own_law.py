# SPDX-License-Identifier: Apache-2.0
"""A control law of your own: reference, sets, torque limits and learning stay as they are.

In a parameter file the same class is named by ``controller.law: own_law:ModelAndSpring``.
"""

import adaptive_blf_control as blf


class ModelAndSpring(blf.Law):
    """The torque of the model that is being learned, and a spring with damping on top."""

    def __init__(self, arm, settings):
        self.arm, self.damping = arm, settings.k2

    def answer(self, sample):
        wanted, theta = sample.reference, sample.theta
        error, rate = sample.q - wanted.position, sample.qd - wanted.velocity
        model = blf.inverse_dynamics(self.arm, theta, sample.q, wanted.velocity,
                                     wanted.acceleration)
        torque = model - 10.0 * self.damping * error - self.damping * rate
        return blf.LawAnswer(torque, e2=rate)  # no regressor: it sends no adaptation term


if __name__ == '__main__':
    swing = {'amplitude': 0.3, 'frequency': 2.0}
    run = blf.simulate(
        blf.TwoLinkArm(), 5.0, law=ModelAndSpring, update_law='concurrent',
        controller={'k2': [30.0, 10.0], 'reference': {'joint1': swing, 'joint2': swing}})

    print(run)
    error = abs(run.e1).max(axis=1)
    print(f'largest error in the first second {error[run.t < 1.0].max():.4f} rad, '
          f'in the last {error[run.t > 4.0].max():.6f} rad')
