# SPDX-License-Identifier: Apache-2.0
"""Gravity, nominal friction and rotor inertias of an arm from a URDF: its own, or those given."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from adaptive_blf_control.arms.joint_friction import finite_array
from adaptive_blf_control.arrays import dimensions
from adaptive_blf_control.errors import ParameterError

__all__ = ['checked_gravity', 'nominal_friction', 'nominal_rotor', 'stated_coulomb']


def checked_gravity(gravity: Any) -> np.ndarray:
    """Return gravity as an array of shape (3,) [m/s²]; ParameterError where it is none."""
    if dimensions(gravity) != 1:
        raise ParameterError('gravity', gravity, 'three finite numbers')
    return finite_array('gravity', gravity, 3)


def nominal_friction(choice: Mapping[str, tuple[bool, Any]], model: Any,
                     rows: np.ndarray) -> dict[str, object]:
    """Return the nominal coefficients of each kind of friction that is learned.

    Args:
        choice: By kind whether it is learned, and the coefficients given: a scalar, shape (n,),
            or None for the URDF's.
        model: Pinocchio's.
        rows: Row of each joint in the model's arrays, shape (n,).

    Raises:
        ParameterError: coefficients of a kind that is not learned, or a bool for coefficients.
    """
    from_urdf = {'viscous': model.damping[rows], 'offset': 0.0, 'square_root': 0.0,
                 'coulomb': _dry(model)[rows]}
    nominal: dict[str, object] = {}
    for kind, (enabled, value) in choice.items():
        if isinstance(value, (bool, np.bool_)):
            raise ParameterError(kind, value, f'nominal coefficients; friction_{kind}=True says '
                                 'that it is learned')
        if enabled:
            nominal[kind] = from_urdf[kind] if value is None else value
        elif value is not None:
            raise ParameterError(kind, value, f'None where friction_{kind} is off')
    return nominal


def stated_coulomb(model: Any) -> dict[str, float]:
    """Return the Coulomb friction that a URDF states by joint [N·m]; those without are left out.

    Args:
        model: Pinocchio's, of the joints that move.
    """
    dry = _dry(model)
    return {name: float(dry[joint.idx_v]) for name, joint in zip(
        list(model.names)[1:], list(model.joints)[1:], strict=True) if dry[joint.idx_v]}


def _dry(model: Any) -> np.ndarray:
    found = getattr(model, 'upperDryFrictionLimit', None)  # named so from Pinocchio 4 on
    result: np.ndarray = model.friction if found is None else found
    return result


def nominal_rotor(given: Any, learned: bool, n: int) -> np.ndarray:
    """Return the nominal inertias of the rotors, shape (n,) [kg·m²]; zero where None is given.

    Raises:
        ParameterError: they are negative, of a wrong length, or given and not learned.
    """
    if not learned and given is not None:
        raise ParameterError('rotor', given, 'None where rotor_inertia is off')
    value = finite_array('rotor', 0.0 if given is None else given, n)
    if value.min() < 0.0:
        raise ParameterError('rotor', given, 'inertias that are not negative')
    return value
