# SPDX-License-Identifier: Apache-2.0
"""The sets and the reference that the settings of a controller describe."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptive_blf_control.control.reference import Reference, SumOfSinusoids
from adaptive_blf_control.control.sets import JointInterval
from adaptive_blf_control.control.settings import (
    ControllerSettings,
    ReferenceSettings,
    SinusoidSettings,
)
from adaptive_blf_control.errors import ParameterError

__all__ = ['ControllerParts', 'controller_parts']


def _check_demand(name: str, sinusoids: SinusoidSettings, limits: ReferenceSettings) -> None:
    """Raise ParameterError where sinusoids may ask for more than the limits of the reference."""
    speed = np.abs(np.asarray(sinusoids.amplitude) * np.asarray(sinusoids.frequency))
    for what, unit, demand, limit in (
            ('velocity', 'rad/s', speed, limits.velocity_limit),
            ('acceleration', 'rad/s²', speed * np.abs(sinusoids.frequency),
             limits.acceleration_limit)):
        if demand.sum() > limit:
            raise ParameterError(name, f'a reference that asks for {demand.sum():.4g} {unit}', (
                f'at most {limit:g} {unit}, reference.{what}_limit: less amplitude or frequency'))


_FIELDS = ('amplitude', 'frequency', 'phase')


def _reference(settings: ReferenceSettings, joints: tuple[str, ...]) -> Reference:
    for name in settings.of_joint:
        if name not in joints:
            raise ParameterError(f'controller.reference.{name}', settings.of_joint[name],
                                 f'the name of a joint: {", ".join(joints)}')
    sinusoids = [settings.of_joint.get(joint, SinusoidSettings()) for joint in joints]
    rows = [[getattr(each, field) for each in sinusoids]
            for field in _FIELDS]
    for i, joint in enumerate(joints):
        given = {field: len(column[i]) for field, column in zip(_FIELDS, rows)}
        terms = given['amplitude']
        if given['frequency'] != terms or given['phase'] not in (1, terms):
            said = ', '.join(f'{length} of {field}' for field, length in given.items())
            raise ParameterError(f'controller.reference.{joint}', sinusoids[i],
                                 'amplitude, frequency and phase of the same length, or one '
                                 f'phase for all, not {said}')
        rows[-1][i] = np.resize(rows[-1][i], terms)
    for joint, each in zip(joints, sinusoids):
        _check_demand(f'controller.reference.{joint}', each, settings)
    terms = max(len(row) for row in rows[0])
    padded = [np.array([np.pad(row, (0, terms - len(row))) for row in column])
              for column in rows]
    return SumOfSinusoids(np.array([each.offset for each in sinusoids]), *padded)


class ControllerParts(NamedTuple):
    """What of the controller may change while it runs: keywords of `Controller.retune`."""

    settings: ControllerSettings
    safety: JointInterval
    performance: JointInterval
    reference: Reference


def controller_parts(settings: ControllerSettings, joints: tuple[str, ...]) -> ControllerParts:
    """Build what of the controller may change while it runs, the reference without its start."""
    settings = settings.resolved(joints=len(joints))
    safety = JointInterval(settings.safety.lower, settings.safety.upper, 'controller.safety')
    performance = JointInterval(settings.performance.lower, settings.performance.upper,
                                'controller.performance')
    return ControllerParts(settings, safety, performance,
                           _reference(settings.reference, joints))
