# SPDX-License-Identifier: Apache-2.0
"""A designed motion as a person reads it: what it uses, what it will tell, how long it takes."""

from __future__ import annotations

from collections.abc import Iterator
import math

import numpy as np

from adaptive_blf_control.experiment.design import Design, Task
from adaptive_blf_control.experiment.expectation import Expectation

__all__ = ['motion_text']


def motion_text(task: Task, design: Design, expected: Expectation, rate: float,
                correlation: float) -> str:
    """Return the table of joints, the figures of the motion and those of each parameter."""
    return '\n'.join([*_joints(task, design, expected), '',
                      *_figures(task, design, expected, rate, correlation), '',
                      *_parameters(task, expected)])


def _joints(task: Task, design: Design, expected: Expectation) -> Iterator[str]:
    arm, limits, use = task.arm, task.limits, design.use
    states = design.motion.at(np.linspace(0.0, task.period, 500))
    width = max(len(joint) for joint in arm.joints) + 2
    yield (f'{"joint":<{width}}{"from .. to [rad]":>18}{"speed [rad/s]":>18}'
           f'{"acceleration":>18}{"torque [N·m]":>18}{"noise":>9}{"95 % ±":>9}')
    for i, joint in enumerate(arm.joints):
        used = (f'{use.velocity[i] * limits.velocity[i]:.3g} of {limits.velocity[i]:.3g}',
                f'{use.acceleration[i] * limits.acceleration[i]:.3g} of '
                f'{limits.acceleration[i]:.3g}',
                f'{use.torque[i] * limits.torque[i]:.3g} of {limits.torque[i]:.3g}')
        span = f'{states.q[:, i].min():.2f} .. {states.q[:, i].max():.2f}'
        yield (f'{joint:<{width}}{span:>18}' + ''.join(f'{text:>18}' for text in used)
               + f'{task.noise[i]:>9.3g}{expected.interval[i]:>9.2g}')


def _figures(task: Task, design: Design, expected: Expectation, rate: float,
             correlation: float) -> Iterator[str]:
    yield (f'motion      {task.period:g} s, {task.harmonics} harmonics up to '
           f'{task.harmonics / task.period:.3g} Hz, from rest to rest: it can be repeated')
    yield f'condition   {design.condition:.1f} of the regressors, columns of length one'
    if math.isfinite(design.distance):
        yield f'distance    {design.distance:.3f} m between {" and ".join(design.between)}'
    repeats = max(1, math.ceil(expected.needed / task.period))
    yield (f'time        {expected.needed:.3g} s at {rate:g} Hz, noise alike for '
           f'{correlation:g} s, until the 95 % interval of every parameter makes less torque '
           f'than the noise: {repeats} x the motion; twice that to test on the other half')


def _parameters(task: Task, expected: Expectation) -> Iterator[str]:
    width = max(map(len, task.arm.parameters)) + 2
    yield f'{"parameter":<{width}}{"std after one motion":>22}{"needs [s]":>12}'
    for name, std, time in zip(task.arm.parameters, expected.std, expected.time):
        yield f'{name:<{width}}{std:>22.2g}{time:>12.2g}'
