# SPDX-License-Identifier: Apache-2.0
"""Watch a constraint of your own beside the two sets: here the distance of the tip from a wall.

In a parameter file: ``controller.constraints: [own_constraint:Wall]``. It is checked at the start
and has its margin in the table, on ``controller/barrier`` and in the diagnostics. The law (38)
does not look at it: it keeps the two sets.
"""

import numpy as np

import adaptive_blf_control as blf

WALL = 0.88  # m in front of the base; the arm reaches 0.9 m


class Wall(blf.Constraint):
    """The tip of the arm stays in front of a wall."""

    name, quantity, unit = 'wall', 'reach', 'm'
    recovery = 'move the arm away from the wall'
    bodies = ('tip',)

    def __init__(self, arm, settings):
        self.arm = arm

    def bounded(self, state):  # of one sample: state.t, q, qd, e1
        reach = self.arm.link_points(state.q)[-1][:1]
        return blf.Bounded(reach, np.array([-np.inf]), np.array([WALL]))


if __name__ == '__main__':
    swing = {'amplitude': 0.3, 'frequency': 2.0}
    for offset in (1.0, 0.0):  # elbow bent or stretched [rad]
        elbow = {'offset': offset, **swing}
        try:
            run = blf.simulate(blf.TwoLinkArm(), 5.0, constraints=Wall, arm_driver={
                'initial_position': [0.0, offset]}, controller={
                'k2': [30.0, 10.0], 'reference': {'joint1': swing, 'joint2': elbow}})
            print(run)
        except blf.SetViolation as error:
            print(f'refused: {error}')
