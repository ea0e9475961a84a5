# SPDX-License-Identifier: Apache-2.0
"""From parameters to a MuJoCo model: arm, friction, rotors, loads, obstacle."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.simulation.mujoco.arm_model import ArmModel, compiled, load_body
from adaptive_blf_control.simulation.mujoco.fixtures import add_fixtures
from adaptive_blf_control.simulation.mujoco.library import load_mujoco
from adaptive_blf_control.simulation.mujoco.source import arm_spec
from adaptive_blf_control.simulation.mujoco.surroundings import (
    add_obstacle,
    Surroundings,
    touchable_geoms,
)
from adaptive_blf_control.simulation.mujoco.tip import Place, tip_of
from adaptive_blf_control.simulation.rotation import rotation
from adaptive_blf_control.simulation.schedule import Change, changes_of, PAYLOAD
from adaptive_blf_control.simulation.settings import PlantSettings
from adaptive_blf_control.simulation.targets import payload_links, timed_changes, TIP

__all__ = ['Scene']


_STICTION_TIME = 0.001  # s
_STICTION_IMPEDANCE = 0.9999  # the largest there is


class Scene:
    """A compiled model, and what the schedule may change in it.

    Attributes:
        arm_model: The arm, with its loads.
        surroundings: Forces and the obstacle.
        changes: The schedule, the payload of the start included.
    """

    def __init__(self, settings: PlantSettings, arm: Arm,
                 gravity: Sequence[float] | np.ndarray) -> None:
        """Build it; see `MujocoPlant`."""
        _refuse_true_parameters(settings)
        source = settings.mujoco.model or _own_urdf(arm)
        shown = 'XML text' if source.lstrip().startswith('<') else source
        names = _names_in_the_model(settings, arm)
        spec = arm_spec(source, names)
        _set_options(spec, settings, gravity)
        bare = ArmModel(compiled(spec, arm.joints), arm.joints, names, {})
        tip = tip_of(arm, bare, settings.mujoco.tolerance, shown)
        links = [bare.model.body(i).name for i in range(1, bare.model.nbody)]
        start = [Change(0.0, PAYLOAD, settings.payload)] if settings.payload > 0.0 else []
        changes = start + changes_of(settings.schedule)
        self.changes = timed_changes(changes, arm.joints, links, touchable_geoms(bare.model))
        loads = _add_loads(spec, payload_links(changes), tip)
        contact = settings.mujoco.contact
        touching = Place(contact.link, np.zeros(3)) if contact.link else tip
        if touching.body not in links:
            raise ParameterError('arm_driver.mujoco.contact.link', touching.body,
                                 f'one of {", ".join(links)}')
        add_obstacle(spec, contact, *touching)
        add_fixtures(spec, settings.mujoco.fixtures, arm, bare)
        model = compiled(spec, arm.joints)
        self.arm_model = ArmModel(model, arm.joints, names, loads)
        _set_friction(self.arm_model, settings)
        self.surroundings = Surroundings(model, contact)


def _refuse_true_parameters(settings: PlantSettings) -> None:
    if settings.true_model != 'nominal' or np.any(settings.true_parameters):
        raise ParameterError('arm_driver.true_model', settings.true_model,
                             'nominal: the arm in MuJoCo is that of its model')


def _names_in_the_model(settings: PlantSettings, arm: Arm) -> tuple[str, ...]:
    names = tuple(filter(None, settings.mujoco.joints)) or arm.joints
    if len(names) != arm.n or len(set(names)) != arm.n:
        raise ParameterError('arm_driver.mujoco.joints', list(names),
                             f'the names of {", ".join(arm.joints)} in the model, each once')
    return tuple(names)


def _own_urdf(arm: Arm) -> str:
    if not isinstance(arm, UrdfArm):
        raise ParameterError('arm_driver.mujoco.model', '',
                             'a URDF or an MJCF: only an arm from a URDF has one of its own')
    return arm.xml


def _set_options(spec: Any, settings: PlantSettings,
                 gravity: Sequence[float] | np.ndarray) -> None:
    mujoco = load_mujoco()
    option, disable = spec.option, mujoco.mjtDisableBit
    option.gravity = rotation(settings.mounting).T @ np.asarray(gravity, dtype=float)
    option.timestep = settings.mujoco.step
    option.integrator = {'implicitfast': mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
                         'rk4': mujoco.mjtIntegrator.mjINT_RK4}[settings.mujoco.integrator]
    # An obstacle moves to where it appears: what is compiled for its first place is not used.
    # A simulation that diverges is an error, not a start from the beginning.
    option.disableflags |= (disable.mjDSBL_ACTUATION | disable.mjDSBL_MIDPHASE
                            | disable.mjDSBL_AUTORESET)


def _add_loads(spec: Any, links: Sequence[str], tip: Place) -> dict[str, str]:
    """Add a body for a load at the tip and on each link; return their names by link."""
    loads = {TIP: 'load at the tip', **{link: f'load on {link}' for link in links}}
    load_body(spec, tip.body, loads[TIP], tip.position)
    for link in links:
        load_body(spec, link, loads[link], np.zeros(3))
    return loads


def _set_friction(model: ArmModel, settings: PlantSettings) -> None:
    """Set what is given; where nothing is, the model's own values stay."""
    friction, fields = settings.true_friction, model.model
    for values, field in ((friction.viscous, fields.dof_damping),
                          (friction.coulomb, fields.dof_frictionloss),
                          (friction.rotor_inertia, fields.dof_armature)):
        if np.any(values):
            field[model.velocity] = values
    model.offset[:], model.square_root[:] = friction.offset, friction.square_root
    # Coulomb friction that holds: by default MuJoCo's creeps at several hundredths of a rad/s.
    fields.dof_solref[:, 0], fields.dof_solimp[:, :2] = _STICTION_TIME, _STICTION_IMPEDANCE
