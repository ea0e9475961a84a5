# SPDX-License-Identifier: Apache-2.0
"""What acts on an arm in MuJoCo from outside: forces on its links, and an obstacle."""

from __future__ import annotations

from typing import Any

import numpy as np

from adaptive_blf_control.limits.obstacles import frame_along
from adaptive_blf_control.simulation.mujoco.fixtures import (
    allow_fixtures,
    FIXTURE,
    LINK_SPHERE,
)
from adaptive_blf_control.simulation.mujoco.library import load_mujoco
from adaptive_blf_control.simulation.mujoco.settings import ContactSettings
from adaptive_blf_control.simulation.rotation import rotation
from adaptive_blf_control.simulation.targets import CONTACT, Target
from adaptive_blf_control.simulation.wrenches import Wrenches

__all__ = ['Surroundings', 'add_obstacle', 'touchable_geoms']

_OBSTACLE, _TOUCHING = 'obstacle of the schedule', 'sphere that touches'
_BOUNCE = 0.05  # s, longest time off the obstacle that does not end a contact
_AWAY = (0.0, 0.0, -100.0)  # m, where nothing touches it


def add_obstacle(spec: Any, settings: ContactSettings, link: str, position: np.ndarray) -> None:
    """Add the obstacle and the sphere that touches it, neither of which is there yet.

    Args:
        spec: The ``mujoco.MjSpec``.
        settings: Shape of the obstacle, and radius of the sphere.
        link: Body that carries the sphere.
        position: Of the sphere in the frame of that body, shape (3,) [m].
    """
    shapes = load_mujoco().mjtGeom
    contact = {'friction': [settings.friction, 0.005, 0.0001],
               'solref': [settings.time_constant, 1.0], 'contype': 0, 'conaffinity': 0}
    spec.body(link).add_geom(name=_TOUCHING, type=shapes.mjGEOM_SPHERE, pos=position, mass=0.0,
                             size=[settings.radius, 0.0, 0.0], **contact)
    shape = {'plane': shapes.mjGEOM_PLANE, 'sphere': shapes.mjGEOM_SPHERE,
             'box': shapes.mjGEOM_BOX}[settings.shape]
    spec.worldbody.add_geom(name=_OBSTACLE, type=shape, pos=_AWAY, size=settings.size, **contact)


def touchable_geoms(model: Any) -> list[str]:
    """Return the names of the geoms that a model has of its own."""
    names = [model.geom(i).name for i in range(model.ngeom)]
    return [name for name in names if name and name not in (_OBSTACLE, _TOUCHING)
            and not name.startswith((FIXTURE, LINK_SPHERE))]


class Surroundings:
    """Forces and contacts, each absent until `set`.

    Attributes:
        touched: Intervals of contact up to now, (begin, end) [s]; bounces are within one.
    """

    def __init__(self, model: Any, settings: ContactSettings) -> None:
        """Take over a compiled model and let nothing in it touch."""
        self._mujoco = load_mujoco()
        self._model, self._settings = model, settings
        self._there: set[int] = set()  # geoms of the schedule that can be touched now
        self._fixtures = any(model.geom(i).name.startswith(FIXTURE) for i in range(model.ngeom))
        self._allow_contacts()
        self._wrenches = Wrenches()
        self.touched: list[tuple[float, float]] = []

    @property
    def act(self) -> bool:
        """Whether anything may act on the arm now."""
        return bool(self._wrenches.by_link or self._there or self._fixtures)

    def set(self, data: Any, target: Target, value: float) -> None:
        """Set a force or torque on a link, or let an obstacle appear or go; see `targets`.

        Args:
            data: The present state.
            target: What to set.
            value: In its unit.
        """
        if target.kind == CONTACT:
            geom = self._model.geom(target.name or _OBSTACLE).id
            if value > 0.0 and not target.name:
                self._place_obstacle(data, geom)
            (self._there.add if value > 0.0 else self._there.discard)(geom)
            self._allow_contacts()
            return
        self._wrenches.set(target, value)

    def torque(self, data: Any) -> np.ndarray:
        """Return what the forces do to each degree of freedom in a state, shape (nv,) [N·m]."""
        result = np.zeros(self._model.nv)
        if self._wrenches.by_link:
            self._mujoco.mj_kinematics(self._model, data)
            self._mujoco.mj_comPos(self._model, data)
        for link, wrench in self._wrenches.by_link.items():
            body = self._model.body(link).id
            self._mujoco.mj_applyFT(self._model, data, wrench[:3], wrench[3:], data.xpos[body],
                                    body, result)
        return result

    def watch(self, data: Any, begin: float, end: float) -> None:
        """Note whether the arm touched something in a step from ``begin`` to ``end`` [s]."""
        if data.ncon:
            if self.touched and begin - self.touched[-1][1] < _BOUNCE:
                begin = self.touched.pop()[0]
            self.touched.append((begin, end))

    def _allow_contacts(self) -> None:
        """Let the sphere touch what is there, links what stands there, and nothing else anything.

        MuJoCo looks at the masks of the bodies before those of their geoms.
        """
        model = self._model
        model.geom_contype[:] = model.geom_conaffinity[:] = 0
        for geom in self._there:
            model.geom_contype[geom], model.geom_conaffinity[geom] = 1, 2
        if self._there:
            sphere = model.geom(_TOUCHING).id
            model.geom_contype[sphere], model.geom_conaffinity[sphere] = 2, 1
        allow_fixtures(model)
        for masks, of_geoms in ((model.body_contype, model.geom_contype),
                                (model.body_conaffinity, model.geom_conaffinity)):
            masks[:] = 0
            np.bitwise_or.at(masks, model.geom_bodyid, of_geoms)

    def _place_obstacle(self, data: Any, obstacle: int) -> None:
        model = self._model
        model.geom_pos[obstacle], axes = self._place(data, model.geom(_TOUCHING).id)
        self._mujoco.mju_mat2Quat(model.geom_quat[obstacle], np.ravel(axes))
        model.geom_sameframe[obstacle] = 0

    def _place(self, data: Any, sphere: int) -> tuple[np.ndarray, np.ndarray]:
        """Return centre and axes of the obstacle that appears now."""
        settings, model = self._settings, self._model
        if settings.place == 'fixed':
            return settings.position, rotation(settings.orientation)
        self._mujoco.mj_forward(model, data)
        velocity = np.zeros(6)  # angular, then linear
        self._mujoco.mj_objectVelocity(model, data, self._mujoco.mjtObj.mjOBJ_GEOM, sphere,
                                       velocity, 0)
        speed = float(np.linalg.norm(velocity[3:]))
        ahead = velocity[3:] / speed if speed > 1e-6 else np.array([0.0, 0.0, -1.0])
        depth = {'plane': 0.0, 'sphere': settings.size[0], 'box': settings.size[2]}
        distance = settings.radius + settings.gap + depth[settings.shape]
        return data.geom_xpos[sphere] + distance * ahead, frame_along(-ahead)

