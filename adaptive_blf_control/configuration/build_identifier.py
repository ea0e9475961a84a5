# SPDX-License-Identifier: Apache-2.0
"""Build the identifier from its settings, with θ̂(0)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.configuration.node_settings import IdentifierNodeSettings
from adaptive_blf_control.identification.given_parameters import read_estimate
from adaptive_blf_control.identification.identifier import Identifier
from adaptive_blf_control.identification.update_laws import UpdateLaw

__all__ = ['build_identifier', 'initial_estimate']


def initial_estimate(settings: IdentifierNodeSettings, arm: Arm) -> IdentifierNodeSettings:
    """Return the settings with θ̂(0) from ``initial_estimate_file``, where one is named."""
    if not settings.initial_estimate_file:
        return settings
    estimate = read_estimate(Path(settings.initial_estimate_file), arm.parameters)
    return settings.replace(initial_estimate=estimate)


def build_identifier(settings: IdentifierNodeSettings, arm: Arm,
                     estimate: np.ndarray | None = None,
                     update_law: UpdateLaw | type[UpdateLaw] | str | None = None) -> Identifier:
    """Build the identifier for ``arm``.

    Args:
        settings: Those of the node.
        arm: The arm.
        estimate: θ̂(0), shape (m,), in place of ``initial_estimate_file`` and
            ``initial_estimate``, which are then not looked at.
        update_law: In place of the one that the settings name.
    """
    if estimate is not None:
        return Identifier(arm, settings.replace(initial_estimate=estimate), update_law)
    return Identifier(arm, initial_estimate(settings, arm), update_law)
