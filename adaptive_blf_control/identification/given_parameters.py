# SPDX-License-Identifier: Apache-2.0
"""Parameters of an arm as settings give them: values, the nominal ones, or a file of θ̂."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.arms.joint_friction import FRICTION_KINDS
from adaptive_blf_control.arrays import checked_number
from adaptive_blf_control.bounded_yaml import load_yaml_text, read_yaml_text
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.parameters.table import broadcast, NOMINAL

__all__ = ['given_parameters', 'load_estimate', 'read_estimate', 'theta_of', 'values_of']

_SHOWN = 8  # names that a message lists


def given_parameters(name: str, value: np.ndarray | str, arm: Arm) -> np.ndarray:
    """Return θ for an arm, shape (m,).

    Args:
        name: The parameter that gives it, for messages.
        value: One element for all, or m; ``nominal``; or a file that
            :func:`~adaptive_blf_control.identification.estimate_file.write_estimate` wrote.
        arm: The arm.

    Raises:
        ParameterError: the value has neither one element nor m, or the file cannot be used.
    """
    if not isinstance(value, str):
        if value.size not in (1, arm.m):
            raise ParameterError(name, value.tolist(), f'a list of length 1 or {arm.m} (one for '
                                 'each of the parameters)')
        return broadcast(value, arm.m)
    if value == NOMINAL:
        return np.array(arm.nominal, dtype=float)
    return read_estimate(Path(value).expanduser(), arm.parameters, name)


def values_of(name: str, values: Mapping[str, Any], arm: Arm) -> np.ndarray:
    """Return θ of values by parameter name, shape (m,).

    Raises:
        ParameterError: a parameter is missing, not known, or no number.
    """
    missing = [each for each in arm.parameters if each not in values]
    unknown = [each for each in values if each not in arm.parameters]
    if missing or unknown:
        what = f'no {", ".join(missing)}' if missing else f'{unknown[0]!r} is none of them'
        raise ParameterError(name, dict(values), 'a value for each parameter of the arm: ' + what)
    return np.array([checked_number(f'{name}.{each}', values[each]) for each in arm.parameters])


def read_estimate(path: Path, parameters: tuple[str, ...],
                  name: str = 'identifier.initial_estimate_file') -> np.ndarray:
    """Read θ̂ from a file, in the order of ``parameters``, shape (m,).

    Args:
        path: The file.
        parameters: Names in the order wanted.
        name: The parameter that names the file, for messages.

    Raises:
        ParameterError: the file cannot be read, lacks a parameter, or has one that the arm does
            not have: without it the others would predict another torque.
    """
    return theta_of(load_estimate(path, name), path, parameters, name)


def load_estimate(path: Path, name: str) -> Any:
    """Return what is in a file; ParameterError where it cannot be read."""
    try:
        return load_yaml_text(read_yaml_text(path))
    except OSError as error:
        raise ParameterError(name, str(path), f'a readable file ({error.strerror})') from None
    except (ValueError, yaml.YAMLError):
        raise _no_mapping(name, path) from None


def theta_of(content: Any, path: Path, parameters: tuple[str, ...], name: str) -> np.ndarray:
    """Return θ̂ of a file's content, arguments as of `read_estimate`."""
    try:
        values = content['theta_hat']
        theta = np.array([float(values[parameter]) for parameter in parameters])
    except KeyError as error:
        raise ParameterError(name, str(path), f'an entry {error.args[0]!r}') from None
    except (TypeError, ValueError, OverflowError):
        raise _no_mapping(name, path) from None
    if not np.isfinite(theta).all():
        raise ParameterError(name, str(path), 'finite values in theta_hat')
    if others := [str(each) for each in values if each not in parameters]:
        raise ParameterError(name, str(path), f'the {len(parameters)} parameters of the arm and '
                             f'no more: it also has {", ".join(others[:_SHOWN])}'
                             + ', ...' * (len(others) > _SHOWN) + _friction_of(others))
    return theta


def _friction_of(names: list[str]) -> str:
    """Return how an arm gets the parameters of friction and rotors that are among ``names``."""
    kinds = {**FRICTION_KINDS, 'rotor_inertia': 'Ia'}
    chosen = ', '.join(f'{kind}=True' for kind, prefix in kinds.items()
                       if any(name.startswith(f'{prefix}_') for name in names))
    return (f': load_arm(urdf, {chosen}) returns an arm with these (in YAML friction.*)'
            if chosen else '')


def _no_mapping(name: str, path: Path) -> ParameterError:
    return ParameterError(name, str(path), 'a mapping theta_hat of parameter names to numbers')
