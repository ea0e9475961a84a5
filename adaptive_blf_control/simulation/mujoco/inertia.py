# SPDX-License-Identifier: Apache-2.0
"""Inertias as MuJoCo keeps them: principal moments and the attitude of their axes.

MuJoCo's own conversion of a full inertia is exact to about 1e-6 of its elements, and MuJoCo 3.3
forgets the ``rpy`` of an ``<inertial>`` of a URDF.
"""

from __future__ import annotations

from typing import Any
import xml.etree.ElementTree as ElementTree

import numpy as np

from adaptive_blf_control.simulation.mujoco.library import load_mujoco
from adaptive_blf_control.simulation.rotation import rotation

__all__ = ['principal_axes', 'set_inertias']

_URDF_ORDER = ('ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz')


def principal_axes(inertia: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return moments, shape (3,) [kg·m²], and attitude as a quaternion (w, x, y, z).

    Args:
        inertia: Symmetric, shape (3, 3) [kg·m²].
    """
    moments, axes = np.linalg.eigh(inertia)
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] *= -1.0
    quaternion = np.zeros(4)
    load_mujoco().mju_mat2Quat(quaternion, np.ravel(axes))
    return moments, quaternion


def set_inertias(spec: Any, urdf: ElementTree.Element | None) -> None:
    """Give the bodies of a model their inertias without loss.

    Args:
        spec: The ``mujoco.MjSpec``.
        urdf: The URDF that it was read from; None for an MJCF.
    """
    if urdf is not None:
        for link in urdf.findall('link'):
            body, inertial = spec.body(link.get('name')), link.find('inertial')
            if body is not None and inertial is not None:
                _set(body, _of_link(inertial))
        return
    for body in spec.bodies:
        if not np.isnan(body.fullinertia[0]):
            xx, yy, zz, xy, xz, yz = body.fullinertia
            _set(body, np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))


def _set(body: Any, inertia: np.ndarray) -> None:
    body.fullinertia[0] = np.nan  # as where none is given
    body.inertia, body.iquat = principal_axes(inertia)


def _of_link(inertial: ElementTree.Element) -> np.ndarray:
    """Return the inertia of a link about its centre of mass, axes of the link, shape (3, 3)."""
    element, origin = inertial.find('inertia'), inertial.find('origin')
    values = {} if element is None else element.attrib
    xx, xy, xz, yy, yz, zz = (float(values.get(name, 0.0)) for name in _URDF_ORDER)
    angles = '0 0 0' if origin is None else origin.get('rpy', '0 0 0')
    turn = rotation(np.array(angles.split(), dtype=float))
    return turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turn.T
