# SPDX-License-Identifier: Apache-2.0
"""The parameters with which the controller begins."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.configuration.node_settings import ControllerNodeSettings
from adaptive_blf_control.identification.given_parameters import given_parameters

__all__ = ['initial_theta']


def initial_theta(settings: ControllerNodeSettings, arm: Arm) -> np.ndarray:
    """Return what the controller uses before the first θ̂, or for good (``model: known``), (m,).

    Raises:
        ParameterError: it has neither one element nor m, or its file cannot be used.
    """
    name = 'known_parameters' if settings.model == 'known' else 'initial_estimate'
    return given_parameters(f'controller.{name}', getattr(settings, name), arm)
