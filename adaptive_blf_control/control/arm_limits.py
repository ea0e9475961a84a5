# SPDX-License-Identifier: Apache-2.0
"""Limits that are not kept: those of the arm's URDF, and those that no safety filter looks at."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.control.harmonics import extremes
from adaptive_blf_control.control.settings import (
    ControllerSettings,
    ReferenceSettings,
    SinusoidSettings,
)
from adaptive_blf_control.parameters.settings import changed_names

__all__ = ['limit_warnings']


def limit_warnings(arm: Arm, settings: ControllerSettings) -> Iterator[str]:
    """Yield sentences about limits that are not kept.

    One where ``limits`` are set that no safety filter keeps; and one for each joint whose own
    limits the settings go beyond: the safety set those of positions, the torque limit those of
    efforts, the sinusoids, by the largest velocity that they can reach, those of velocities. An
    arm without such limits is not compared.

    Args:
        arm: Its ``position_lower``, ``position_upper`` [rad], ``velocity_limit`` [rad/s] and
            ``torque_limit`` [N·m] count, each of shape (n,), where it has them.
        settings: Of the controller.
    """
    settings = settings.resolved(joints=arm.n)
    idle = sorted(changed_names(
        ControllerSettings().resolved(joints=arm.n).limits, settings.limits))
    if idle and settings.safety_filter == 'none':
        yield (f'nothing keeps {", ".join(f"limits.{name}" for name in idle)}: safety_filter is '
               "'none', safety_filter='limits' keeps them")
    lower, upper, velocity, effort = (
        np.broadcast_to(getattr(arm, name, free), arm.n) for name, free in (
            ('position_lower', -np.inf), ('position_upper', np.inf), ('velocity_limit', np.inf),
            ('torque_limit', np.inf)))
    safety, speed = settings.safety, _speed(settings.reference, arm.joints)
    for i, joint in enumerate(arm.joints):
        if safety.lower[i] < lower[i] or safety.upper[i] > upper[i]:
            yield (f'joint {joint!r}: the safety set {safety.lower[i]:.6g} .. '
                   f'{safety.upper[i]:.6g} rad goes beyond the limits of the arm, '
                   f'{lower[i]:.6g} .. {upper[i]:.6g} rad')
        if speed[i] > velocity[i]:
            yield (f'joint {joint!r}: the reference may reach {speed[i]:.4g} rad/s, the limit of '
                   f'the arm is {velocity[i]:.4g} rad/s')
        if settings.torque_limit[i] > effort[i]:
            yield (f'joint {joint!r}: torque_limit {settings.torque_limit[i]:.4g} N·m is above '
                   f'the limit of the arm, {effort[i]:.4g} N·m')


def _speed(reference: ReferenceSettings, joints: tuple[str, ...]) -> np.ndarray:
    """Return a speed that each joint never exceeds, shape (n,) [rad/s]."""
    each = (reference.of_joint.get(joint, SinusoidSettings()) for joint in joints)
    return np.array([max(np.abs(extremes(one.amplitude * one.frequency, one.frequency,
                                         one.phase + 0.5 * np.pi))) for one in each])
