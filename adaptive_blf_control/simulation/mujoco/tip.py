# SPDX-License-Identifier: Apache-2.0
"""Where the tip of an arm is in its MuJoCo model."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.simulation.mujoco.arm_model import ArmModel
from adaptive_blf_control.simulation.mujoco.kinematics import check_kinematics
from adaptive_blf_control.simulation.mujoco.library import load_mujoco

__all__ = ['Place', 'tip_of']


class Place(NamedTuple):
    """A point of a body.

    Attributes:
        body: Its name.
        position: In the frame of the body, shape (3,) [m].
    """

    body: str
    position: np.ndarray


def tip_of(arm: Arm, model: ArmModel, tolerance: float, source: str) -> Place:
    """Return the tip on the body that the last joint moves.

    It is the last of the arm's link points where the arm comes from a URDF, whose kinematics have
    to be those of the model; else the origin of the model's last body.

    Raises:
        ParameterError: the joint axes differ by more than ``tolerance`` [m, rad].
    """
    mujoco, compiled = load_mujoco(), model.model
    data = mujoco.MjData(compiled)
    data.qpos[model.position] = 0.0
    mujoco.mj_kinematics(compiled, data)
    body = int(compiled.jnt_bodyid[model.ids].max())
    if isinstance(arm, UrdfArm):
        base = check_kinematics(arm, model, tolerance, source).base
        point = arm.link_points(np.zeros(arm.n))[-1] + base
    else:
        last = max(i for i in range(compiled.nbody) if compiled.body_weldid[i] == body)
        point = data.xpos[last]
    position = data.xmat[body].reshape(3, 3).T @ (point - data.xpos[body])
    return Place(compiled.body(body).name, position)
