# SPDX-License-Identifier: Apache-2.0
"""How a motion begins: from where the arm is, joined to the reference or held there."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.control.controller import Controller
from adaptive_blf_control.control.reference import Posture, SmoothStart
from adaptive_blf_control.control.settings import ControllerSettings
from adaptive_blf_control.errors import SetViolation

__all__ = ['holding_controller', 'joined_controller']


def joined_controller(settings: ControllerSettings, arm: Arm, q: np.ndarray, qd: np.ndarray,
                      resumes: bool) -> Controller:
    """Build the controller of a motion that begins in ``q``, joined to the reference.

    With ``reference.smooth_start`` 0 it begins on the reference itself, as the paper's, where
    ``q`` is within the performance set around that.

    Args:
        settings: Gains, limits, sets and reference.
        arm: The arm.
        q: Measured positions, shape (n,) [rad].
        qd: Measured velocities, shape (n,) [rad/s].
        resumes: A motion came before: the reference has moved on since, and so may the arm.

    Raises:
        SetViolation: the start is not inside, and no smooth start would make it so.
    """
    if not resumes:
        try:
            return Controller(arm, settings, start=q, velocity=qd)
        except SetViolation:
            if settings.reference.smooth_start > 0.0:
                raise
    settings = settings.replace(**{'reference.smooth_start': max(
        settings.reference.smooth_start, settings.reference.resume_time)})
    return Controller(arm, settings, start=q, velocity=qd)


def holding_controller(settings: ControllerSettings, arm: Arm, q: np.ndarray,
                       qd: np.ndarray) -> Controller:
    """Build the controller of a motion that begins in ``q`` and stays there; as the others."""
    hold = SmoothStart(Posture(q), settings.reference.resume_time, q)
    controller = Controller(arm, settings, reference=hold)
    controller.check_start(q, qd)
    return controller
