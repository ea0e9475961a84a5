# SPDX-License-Identifier: Apache-2.0
"""The compiled MuJoCo model of an arm: joints in the user's order, loads, friction, torques."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
import copy
from typing import Any

import numpy as np

from adaptive_blf_control.errors import ArmError, ParameterError
from adaptive_blf_control.simulation.mujoco.inertia import principal_axes
from adaptive_blf_control.simulation.mujoco.library import load_mujoco
from adaptive_blf_control.simulation.schedule import PAYLOAD
from adaptive_blf_control.simulation.targets import CENTRE, MASS, Target, TimedChange

__all__ = ['ArmModel', 'compiled', 'load_body']


def load_body(spec: Any, carrier: str, name: str, position: np.ndarray) -> None:
    """Add a body without mass that can be given one while the arm moves.

    Args:
        spec: The ``mujoco.MjSpec``.
        carrier: Body that it is fixed to.
        name: Its name.
        position: Its centre of mass in the frame of the carrier, shape (3,) [m].
    """
    body = spec.body(carrier).add_body(name=name)
    body.explicitinertial = True
    body.mass, body.inertia, body.ipos = 1e-3, [1e-6, 1e-6, 1e-6], position  # until compiled


def compiled(spec: Any, joints: Sequence[str]) -> Any:
    """Compile a model and check that the joints are all that moves.

    Raises:
        ArmError: MuJoCo refuses it, or something else moves.
    """
    try:
        model = spec.compile()
    except ValueError as error:
        raise ArmError(f'MuJoCo cannot simulate the model: {error}') from error
    if model.nv != len(joints):
        raise ArmError(f'the model has {model.nv} degrees of freedom besides those of the '
                       f'{len(joints)} joints')
    return model


class ArmModel:
    """Model and addresses of an arm in MuJoCo; `set` changes its loads and its friction.

    Attributes:
        model: The ``mujoco.MjModel``.
        joints: Joint names, length n.
        ids: Numbers of the joints in the model, shape (n,).
        position: Addresses of the joints in qpos, shape (n,).
        velocity: Addresses of the joints in qvel, shape (n,).
        turns: Whether each joint is a hinge, not a slide, shape (n,).
        offset: Constant torque that each joint resists with, shape (n,) [N·m].
        square_root: Friction that grows with √|q̇|, which MuJoCo does not have, shape (n,)
            [N·m·(s/rad)^½].
    """

    def __init__(self, model: Any, joints: Sequence[str], names: Sequence[str],
                 loads: dict[str, str]) -> None:
        """Take over a compiled model; its loads start without mass.

        Args:
            model: The ``mujoco.MjModel``.
            joints: Names in the order of every array.
            names: Their names in the model.
            loads: Body of the load of each link, see `load_body`.
        """
        self._mujoco = load_mujoco()
        self.model, self.joints = model, tuple(joints)
        self.ids = np.array([model.joint(name).id for name in names])
        self.position, self.velocity = model.jnt_qposadr[self.ids], model.jnt_dofadr[self.ids]
        self.turns = model.jnt_type[self.ids] == self._mujoco.mjtJoint.mjJNT_HINGE
        self.offset, self.square_root = np.zeros((2, len(self.ids)))
        self._bodies = {link: model.body(name).id for link, name in loads.items()}
        self._centres = {link: model.body_ipos[body].copy() for link, body in self._bodies.items()}
        self._masses = dict.fromkeys(loads, 0.0)
        self._inertias = {link: np.zeros((3, 3)) for link in loads}
        self._scratch = self._mujoco.MjData(model)
        for link in loads:
            self._set_load(link)

    def copy(self) -> ArmModel:
        """Return an independent copy."""
        other = copy.copy(self)
        other.model = copy.copy(self.model)
        other.offset, other.square_root = self.offset.copy(), self.square_root.copy()
        other._masses = dict(self._masses)
        other._centres = {link: centre.copy() for link, centre in self._centres.items()}
        other._inertias = {link: inertia.copy() for link, inertia in self._inertias.items()}
        other._scratch = self._mujoco.MjData(other.model)
        return other

    def set(self, changes: Iterable[TimedChange]) -> None:
        """Make the changes of one time; see `targets` for their units.

        Raises:
            ParameterError: no body can have the inertia that results.
        """
        links = set()
        for _, target, value in changes:
            if target.kind == PAYLOAD:
                self._note_load(target, value)
                links.add(target.name)
            else:
                self._set_friction(target.kind, self.joints.index(target.name), value)
        for link in links:  # when all of its components are known
            self._set_load(link)

    def _set_friction(self, kind: str, joint: int, value: float) -> None:
        if kind in ('f0', 'fs'):
            {'f0': self.offset, 'fs': self.square_root}[kind][joint] = value
        else:
            field = {'fv': self.model.dof_damping, 'fc': self.model.dof_frictionloss}[kind]
            field[self.velocity[joint]] = value

    def resistance(self, qd: np.ndarray) -> np.ndarray:
        """Return the friction that is not MuJoCo's own, f_0 + f_s √|q̇| sign(q̇), (n,) [N·m]."""
        return np.asarray(self.offset + self.square_root * np.sqrt(np.abs(qd)) * np.sign(qd))

    def _note_load(self, target: Target, value: float) -> None:
        link, component = target.name, target.component
        if component == MASS:
            self._masses[link] = value
        elif component in CENTRE:
            self._centres[link][CENTRE.index(component)] = value
        else:
            i, j = ('xyz'.index(letter) for letter in component[1:])
            self._inertias[link][i, j] = self._inertias[link][j, i] = value

    def _set_load(self, link: str) -> None:
        model, body = self.model, self._bodies[link]
        moments, attitude = principal_axes(self._inertias[link])
        if moments[0] < 0.0:
            raise ParameterError('arm_driver.schedule.value', self._inertias[link].tolist(),
                                 f'an inertia of the payload on {link} with no negative moment')
        model.body_mass[body] = self._masses[link]
        # An inertia belongs to a mass: what is put down takes it along.
        model.body_inertia[body] = moments if self._masses[link] > 0.0 else 0.0
        model.body_ipos[body] = self._centres[link]
        model.body_iquat[body] = attitude
        model.body_sameframe[body] = 0  # compiled as if its centre never moved
        self._mujoco.mj_setConst(model, self._scratch)

    def inverse_dynamics(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        """Return the torque of a motion, friction and rotor inertia included, shape (n,) [N·m].

        Contacts, joint limits and what else acts from outside are left out; Coulomb friction is
        f sign(q̇).

        Args:
            q: Positions, shape (n,) [rad].
            qd: Velocities, shape (n,) [rad/s].
            qdd: Accelerations, shape (n,) [rad/s²].
        """
        model, data = self.model, self._scratch
        data.qpos[self.position], data.qvel[self.velocity] = q, qd
        data.qacc[self.velocity] = qdd
        flags = model.opt.disableflags
        model.opt.disableflags = flags | self._mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        try:
            self._mujoco.mj_inverse(model, data)
        finally:
            model.opt.disableflags = flags
        dry = model.dof_frictionloss[self.velocity] * np.sign(qd)
        return np.asarray(data.qfrc_inverse[self.velocity] + dry + self.resistance(qd))
