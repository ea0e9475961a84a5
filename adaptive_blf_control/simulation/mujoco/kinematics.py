# SPDX-License-Identifier: Apache-2.0
"""Whether the model in MuJoCo and the URDF of the arm have the same joint axes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.arms.urdf_model import JointOrder, load_pinocchio
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.simulation.mujoco.arm_model import ArmModel
from adaptive_blf_control.simulation.mujoco.library import load_mujoco

__all__ = ['Difference', 'check_kinematics', 'largest_difference']

_POSTURES = 20
_FIRST = 1e6  # weight of the first axis where the bases are laid over one another


class Difference(NamedTuple):
    """Where two models of an arm differ most.

    Attributes:
        joint: The joint whose axis it is.
        distance: Between the two axes [m].
        angle: Between their directions [rad].
        base: Origin of the URDF's root frame in the frame of the model, shape (3,) [m].
    """

    joint: str
    distance: float
    angle: float
    base: np.ndarray


def largest_difference(arm: UrdfArm, model: ArmModel) -> Difference:
    """Compare the joint axes at random postures.

    Each axis is a line: its direction u and, of a revolute joint, its moment p × u about the
    origin. The model may stand anywhere, but not turned: it is moved so that the first axes
    coincide, and along them as fits best.
    """
    random = np.random.default_rng(0)
    postures = random.uniform(-np.pi, np.pi, (_POSTURES, arm.n))
    ours = np.array([_axes_of_urdf(arm, q) for q in postures])
    theirs = np.array([_axes_of_model(model, q) for q in postures])
    directions, moments = theirs[..., :3], theirs[..., 3:] - ours[..., 3:]
    turning = directions * model.turns[:, None]
    # With a base at b the moments differ by b × u = −[u]× b.
    weights = np.ones(moments.shape)
    weights[:, int(np.argmin(model.velocity))] = _FIRST
    rows = np.array([-_cross_matrix(u) for u in turning.reshape(-1, 3)]).reshape(-1, 3)
    base = np.linalg.lstsq(weights.reshape(-1, 1) * rows, (weights * moments).reshape(-1),
                           rcond=None)[0]
    distances = np.linalg.norm(moments - np.cross(base, turning), axis=-1)
    angles = np.linalg.norm(np.cross(ours[..., :3], directions), axis=-1)
    angles = np.arctan2(angles, np.sum(ours[..., :3] * directions, axis=-1))
    worst = int(np.argmax(np.max(np.maximum(distances, angles), axis=0)))
    return Difference(arm.joints[worst], float(distances[:, worst].max()),
                      float(angles[:, worst].max()), base)


def check_kinematics(arm: UrdfArm, model: ArmModel, tolerance: float, source: str) -> Difference:
    """Return the largest difference; ParameterError where it is beyond ``tolerance`` [m, rad]."""
    worst = largest_difference(arm, model)
    if max(worst.distance, worst.angle) > tolerance:
        raise ParameterError(
            'arm_driver.mujoco.model', source,
            f"the joint axes of the arm's URDF within {tolerance:g} m and rad: that of "
            f'{worst.joint} is {worst.distance:.4g} m and {np.degrees(worst.angle):.3g} degrees '
            'away')
    return worst


def _axes_of_urdf(arm: UrdfArm, q: np.ndarray) -> np.ndarray:
    """Return direction and moment of each joint axis in the root frame, shape (n, 6)."""
    pin, data, order = load_pinocchio(), arm.model.createData(), JointOrder(arm.model, arm.joints)
    jacobian = pin.computeJointJacobians(arm.model, data, order.position(q)).reshape(6, arm.n)
    columns = jacobian[:, order.rows].T  # velocity of the point at the origin, then rotation
    turns = np.linalg.norm(columns[:, 3:], axis=1, keepdims=True) > 0.5
    return np.where(turns, np.hstack([columns[:, 3:], columns[:, :3]]),
                    np.hstack([columns[:, :3], np.zeros((arm.n, 3))]))


def _axes_of_model(model: ArmModel, q: np.ndarray) -> np.ndarray:
    """Return the same of the joints in MuJoCo, in the frame of its world, shape (n, 6)."""
    mujoco = load_mujoco()
    data = mujoco.MjData(model.model)
    data.qpos[model.position] = q
    mujoco.mj_kinematics(model.model, data)
    directions, points = data.xaxis[model.ids], data.xanchor[model.ids]
    moments = np.where(model.turns[:, None], np.cross(points, directions), 0.0)
    return np.hstack([directions, moments])


def _cross_matrix(u: np.ndarray) -> np.ndarray:
    return np.array([[0.0, -u[2], u[1]], [u[2], 0.0, -u[0]], [-u[1], u[0], 0.0]])
