# SPDX-License-Identifier: Apache-2.0
"""Learn with an update law of your own: here one that goes straight to the recorded pairs.

In a parameter file the same class is named by ``identifier.update_law: own_update_law:Straight``.
"""

import numpy as np

import adaptive_blf_control as blf


class Straight(blf.UpdateLaw):
    """Towards the least squares of the recorded pairs, with a time constant of 1/k_h."""

    def __init__(self, settings):
        self.rate = settings.kh

    def step(self, theta, dt, evidence):  # theta (m,); dt [s]
        gram = evidence.gram  # of the recorded pairs, (m, m)
        ridge = 1e-9 * max(np.trace(gram), 1e-9) * np.eye(len(gram))
        goal = np.linalg.solve(gram + ridge, evidence.moment + ridge @ theta)
        return theta + (1.0 - np.exp(-self.rate * dt)) * (goal - theta)


if __name__ == '__main__':
    swing = {'amplitude': 0.3, 'frequency': 2.0}
    for law in (None, Straight):  # None: the scenario's, (37)
        run = blf.simulate(blf.TwoLinkArm(), 5.0, update_law=law, controller={
            'k2': [30.0, 10.0], 'reference': {'joint1': swing, 'joint2': swing}})
        name = 'ours' if law is None else law.__name__
        error = np.abs(run.theta_hat - blf.TwoLinkArm().nominal).max(axis=1)
        print(f'{name:<9} sets kept: {run.kept}, largest error of a parameter '
              f'{error[1000]:.3f} after 1 s, {error[-1]:.4f} at the end')
