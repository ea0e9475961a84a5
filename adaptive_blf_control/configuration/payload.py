# SPDX-License-Identifier: Apache-2.0
"""Build what finds the load, from the settings of the identifier node."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.arms.load_frame import load_map
from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.configuration.node_settings import IdentifierNodeSettings
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.given_parameters import load_estimate, theta_of
from adaptive_blf_control.identification.payload import PayloadEstimator
from adaptive_blf_control.parameters.table import NOMINAL

__all__ = ['baseline_of', 'build_payload']

_PART = 0.1  # of the mass that the arm moves: a load that it may well have
_LEAST = 0.1  # kg


def build_payload(settings: IdentifierNodeSettings, arm: Arm, memory: float,
                  baseline: np.ndarray | None = None) -> PayloadEstimator | None:
    """Return what finds the load, None where ``payload.frame`` is empty.

    Args:
        settings: Those of the node.
        arm: The arm of its identifier.
        memory: How long the filters of its identifier remember [s].
        baseline: θ of the arm without the load, shape (m,), in place of ``payload.baseline``.

    Raises:
        ParameterError: the arm has no such frame, or the model without the load is of another
            arm or cannot be read.
    """
    given = settings.payload
    if not given.frame:
        return None
    columns = load_map(arm, given.frame, 'identifier.payload.frame')
    assert isinstance(arm, UrdfArm)  # else there is no such frame
    scale = max(_PART * float(arm.inertial[:, 0].sum()), _LEAST)
    if baseline is None:
        baseline = baseline_of(given.baseline, arm)
    return PayloadEstimator(
        columns, baseline, memory, scale=scale,
        least_mass=given.least_mass, period=given.period, gap=settings.filter.gap)


def baseline_of(value: str, arm: Arm, name: str = 'identifier.payload.baseline') -> np.ndarray:
    """Return θ of the arm without its load, shape (m,).

    Args:
        value: ``nominal``, or a file that `identify` or an identifier has written.
        arm: The arm.
        name: The parameter that gives it, for messages.

    Raises:
        ParameterError: the file cannot be read, or is a model of another arm or with other
            friction: what a model says has to be all of the torque.
    """
    if value == NOMINAL:
        return np.array(arm.nominal, dtype=float)
    path = Path(value).expanduser()
    content = load_estimate(path, name)
    known = content.get('theta_hat') if isinstance(content, dict) else None
    if isinstance(known, dict) and set(known) != set(arm.parameters):
        odd = sorted(map(str, set(known) ^ set(arm.parameters)))
        raise ParameterError(name, value, f'a model with the {arm.m} parameters of this arm '
                             f'(joints, friction.*); {len(odd)} differ, as {odd[0]}')
    return theta_of(content, path, arm.parameters, name)
