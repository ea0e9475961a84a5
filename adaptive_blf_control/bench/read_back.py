# SPDX-License-Identifier: Apache-2.0
"""Do other programs predict the same torques from an exported URDF?"""

from __future__ import annotations

from pathlib import Path
from typing import Any
import xml.etree.ElementTree as ElementTree

import numpy as np

from adaptive_blf_control.errors import MissingExtra
from adaptive_blf_control.simulation.mujoco.inertia import set_inertias
from adaptive_blf_control.simulation.mujoco.library import load_mujoco

__all__ = ['mujoco_errors']

_STATES = 200


def mujoco_errors(path: Path) -> tuple[float, float] | None:
    """Return by how much MuJoCo's torques differ from Pinocchio's, at most, for random states.

    Args:
        path: URDF of an arm; what it looks like is left out.

    Returns:
        The largest difference [N·m] as MuJoCo reads the file, and once it is given the inertias
        of the file; None without MuJoCo.
    """
    try:
        mujoco = load_mujoco()
    except MissingExtra:
        return None
    root = ElementTree.parse(path).getroot()
    for link in root.iter('link'):
        for shape in [*link.findall('visual'), *link.findall('collision')]:
            link.remove(shape)
    # Fusing static links, 3.3 forgets to turn their centre of mass.
    ElementTree.SubElement(ElementTree.SubElement(root, 'mujoco'), 'compiler', fusestatic='false')
    text = ElementTree.tostring(root, encoding='unicode')
    spec = mujoco.MjSpec.from_string(text)
    as_read = _error(mujoco, spec.compile(), text)
    set_inertias(spec, root)
    return as_read, _error(mujoco, spec.compile(), text)


def _error(mujoco: Any, model: Any, text: str) -> float:
    import pinocchio

    reference = pinocchio.buildModelFromXML(text)
    scratch, data = reference.createData(), mujoco.MjData(model)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    model.dof_damping[:] = 0.0
    worst = 0.0
    for state in np.random.default_rng(0).normal(size=(_STATES, 3, model.nv)):
        data.qpos[:], data.qvel[:], data.qacc[:] = state
        mujoco.mj_inverse(model, data)
        torque = pinocchio.rnea(reference, scratch, *state)
        worst = max(worst, float(np.abs(data.qfrc_inverse - torque).max()))
    return worst
