# SPDX-License-Identifier: Apache-2.0
"""What stands beside an arm in MuJoCo all the time, and the spheres on its links that touch it."""

from __future__ import annotations

from typing import Any

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.control.limit_settings import rows_of
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.limits.link_spheres import sphere_centres
from adaptive_blf_control.limits.obstacles import frame_along
from adaptive_blf_control.limits.scene import given_spheres
from adaptive_blf_control.simulation.mujoco.arm_model import ArmModel
from adaptive_blf_control.simulation.mujoco.kinematics import check_kinematics
from adaptive_blf_control.simulation.mujoco.library import load_mujoco
from adaptive_blf_control.simulation.mujoco.settings import FixtureSettings

__all__ = ['add_fixtures', 'allow_fixtures', 'FIXTURE', 'LINK_SPHERE']

FIXTURE, LINK_SPHERE = 'fixture ', 'link sphere '  # beginnings of the names of their geoms
_STANDS, _TOUCHES = 4, 8  # bits of MuJoCo's masks; those of `Surroundings` are 1 and 2
_WHERE = 'arm_driver.mujoco.fixtures'


def add_fixtures(spec: Any, settings: FixtureSettings, arm: Arm, bare: ArmModel) -> None:
    """Add the obstacles that stand there and the spheres on the links that touch them.

    Args:
        spec: The ``mujoco.MjSpec``.
        settings: What stands there.
        arm: The arm.
        bare: Its compiled model without them.

    Raises:
        ParameterError: a row lacks numbers, or the arm has no chain that spheres could be on.
    """
    mujoco, world = load_mujoco(), spec.worldbody
    shapes, count = mujoco.mjtGeom, 0
    for kind, shape, width in (('spheres', shapes.mjGEOM_SPHERE, 4),
                               ('boxes', shapes.mjGEOM_BOX, 6),
                               ('half_spaces', shapes.mjGEOM_PLANE, 6)):
        for row in rows_of(f'{_WHERE}.{kind}', getattr(settings, kind), width):
            size, quaternion = row[3:], np.array([1.0, 0.0, 0.0, 0.0])
            if kind == 'half_spaces':
                normal = np.array(row[3:])
                length = float(np.linalg.norm(normal))
                if not length > 0.0:
                    raise ParameterError(f'{_WHERE}.{kind}', row, 'a normal that is not zero')
                mujoco.mju_mat2Quat(quaternion, np.ravel(frame_along(normal / length)))
                size = [0.0, 0.0, 0.1]  # a plane without end
            elif not min(size) > 0.0:
                raise ParameterError(f'{_WHERE}.{kind}', row, 'sizes > 0 m')
            world.add_geom(name=f'{FIXTURE}{count}', type=shape, pos=row[:3], quat=quaternion,
                           size=[*size, 0.0, 0.0][:3], contype=0, conaffinity=0)
            count += 1
    _add_spheres(spec, settings.link_spheres, arm, bare)


def allow_fixtures(model: Any) -> None:
    """Let the spheres on the links touch what stands there, in a compiled model."""
    for geom in range(model.ngeom):
        name = model.geom(geom).name
        if name.startswith(FIXTURE):
            model.geom_contype[geom], model.geom_conaffinity[geom] = _STANDS, _TOUCHES
        elif name.startswith(LINK_SPHERE):
            model.geom_contype[geom], model.geom_conaffinity[geom] = _TOUCHES, _STANDS


def _add_spheres(spec: Any, value: np.ndarray, arm: Arm, bare: ArmModel) -> None:
    name = f'{_WHERE}.link_spheres'
    if not rows_of(name, value, 5):
        return
    if not isinstance(arm, UrdfArm):
        raise ParameterError(name, value.tolist(),
                             f'an arm from a URDF: {type(arm).__name__} has no geometry')
    mujoco, model, chain = load_mujoco(), bare.model, arm.chain.chain
    spheres = given_spheres(name, value, chain, arm.n)
    base = check_kinematics(arm, bare, np.inf, '').base
    data = mujoco.MjData(model)
    data.qpos[bare.position] = 0.0
    mujoco.mj_kinematics(model, data)
    centres = sphere_centres(chain, spheres, np.zeros(arm.n)) + base
    for k, centre in enumerate(centres):
        body = int(model.jnt_bodyid[bare.ids[chain.place[spheres.body[k] - 1]]])
        local = data.xmat[body].reshape(3, 3).T @ (centre - data.xpos[body])
        spec.body(model.body(body).name).add_geom(
            name=f'{LINK_SPHERE}{k}', type=mujoco.mjtGeom.mjGEOM_SPHERE, pos=local, mass=0.0,
            size=[spheres.radius[k], 0.0, 0.0], contype=0, conaffinity=0)
