# SPDX-License-Identifier: Apache-2.0
"""The true arm of a simulation: θ* from the settings, and how it changes over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arms.arm import Arm, ForwardDynamics
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.given_parameters import given_parameters
from adaptive_blf_control.simulation.schedule import changes_of, Schedule
from adaptive_blf_control.simulation.settings import PlantSettings

__all__ = ['Epoch', 'Truth', 'epochs_truth', 'true_epochs', 'true_theta']

Truth = tuple[tuple[float, np.ndarray], ...]
"""(t, θ*) from t [s] on, in ascending order from 0, θ* of shape (m,)."""


class Epoch(NamedTuple):
    """The true arm from ``t`` [s] on: its dynamics, and θ* by parameter name."""

    t: float
    dynamics: ForwardDynamics
    parameters: Mapping[str, float]


def true_theta(settings: PlantSettings, arm: Arm) -> np.ndarray:
    """Return θ* at the start, payload included, shape (m,).

    Raises:
        ParameterError: ``true_parameters`` do not fit the arm or ``true_model``, or a payload is
            asked of an arm that cannot say where its tip is.
    """
    given, payload = settings.true_parameters, settings.payload
    if settings.true_model == 'given':
        if not isinstance(given, str) and len(given) != arm.m:
            raise ParameterError('arm_driver.true_parameters', given.tolist(),
                                 f'{arm.m} values: {" ".join(arm.parameters)}')
        theta = given_parameters('arm_driver.true_parameters', given, arm)
    elif isinstance(given, str) or np.any(given):
        raise ParameterError('arm_driver.true_parameters',
                             given if isinstance(given, str) else given.tolist(),
                             'no values, or true_model: given')
    else:
        theta = arm.nominal
    if payload == 0.0:
        return theta
    if arm.payload_direction is None:
        raise ParameterError('arm_driver.payload', payload,
                             f'0.0: {type(arm).__name__} has no tip to put it on')
    return theta + payload * arm.payload_direction


def true_epochs(settings: PlantSettings, arm: Arm) -> tuple[Epoch, ...]:
    """Return the true arm over time, the first epoch from t = 0 on.

    Raises:
        ParameterError: see `true_theta` and `Schedule`.
        ArmError: the arm cannot be simulated with these parameters.
    """
    schedule = Schedule(true_theta(settings, arm), arm.parameters,
                        changes_of(settings.schedule), arm.payload_direction, settings.payload)
    return tuple(Epoch(t, arm.dynamics(theta), dict(zip(arm.parameters, theta.tolist())))
                 for t, theta in schedule.epochs)


def epochs_truth(epochs: Sequence[Epoch], parameters: Sequence[str]) -> Truth:
    """Return (t, θ*) of each epoch in the order of ``parameters``.

    An effect the true arm does not have counts as 0.
    """
    return tuple((epoch.t, np.array([epoch.parameters.get(name, 0.0) for name in parameters]))
                 for epoch in epochs)
