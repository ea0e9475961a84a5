# SPDX-License-Identifier: Apache-2.0
"""A recipe as a person reads it: what each joint sees, what it gets and what to expect."""

from __future__ import annotations

from collections.abc import Iterator
import math

import numpy as np

from adaptive_blf_control.tuning.gains import total_rate
from adaptive_blf_control.tuning.recipe import Recipe
from adaptive_blf_control.tuning.sensing import measured_velocity_noise

__all__ = ['recipe_text']

LITTLE = 0.2  # reserve of torque below which there is a caution
DEGREES = 180.0 / math.pi


def recipe_text(recipe: Recipe) -> str:
    """Return the table of joints, the margins of the loop, and what was assumed."""
    return '\n'.join([*_joints(recipe), '', *_loop(recipe), *_sensors(recipe), '',
                      *_cautions(recipe)])


def _joints(recipe: Recipe) -> Iterator[str]:
    width = max(len(joint) for joint in recipe.arm.joints) + 2
    yield (f'{"joint":<{width}}{"inertia seen":>19}{"k2":>10}{"barrier":>10}{"phase":>7}'
           f'{"torque of limit":>18}{"reserve":>9}{"bound":>8}{"start":>9}{"friction":>10}')
    yield (f'{"":<{width}}{"[kg m2]":>19}{"[N m s]":>10}{"[J]":>10}{"[deg]":>7}'
           f'{"[N m]":>18}{"[%]":>9}{"[rad]":>8}{"[rad]":>9}{"[rad]":>10}')
    gains, inertia = recipe.gains, recipe.inertia
    for i, joint in enumerate(recipe.arm.joints):
        seen = f'{inertia.least[i]:.3g} .. {inertia.most[i]:.3g}'
        torque = f'{recipe.torque[i]:.3g} of {recipe.torque_limit[i]:.3g}'
        yield (f'{joint:<{width}}{seen:>19}{gains.k2[i]:>10.3g}{gains.barrier_weight[i]:>10.3g}'
               f'{DEGREES * recipe.phase[i]:>7.0f}{torque:>18}{100.0 * recipe.reserve[i]:>9.0f}'
               f'{recipe.motion.bound[i]:>8.3g}{recipe.start_error[i]:>9.2g}'
               f'{_error(recipe.friction_error[i]):>10}')


def _error(value: float) -> str:
    return 'bound' if math.isnan(value) else f'{value:.2g}'


def _loop(recipe: Recipe) -> Iterator[str]:
    delay = recipe.robot.loop
    yield (f'loop       {1e3 * delay.total:.3g} ms from motion to torque: delay '
           f'{1e3 * delay.delay:.3g}, velocity {1e3 * delay.velocity_lag:.3g}, held torque '
           f'{500.0 * delay.period:.3g}; it oscillates from {delay.largest_rate:.4g} 1/s')
    yield (f'damping    lambda_max(M^-1 k2) = {recipe.rate:.4g} 1/s along the reference, with k1 '
           f'{total_rate(delay):.4g} 1/s; stable with '
           f'up to {1e3 * delay.delay_margin(total_rate(delay)):.3g} ms of further delay')


def _sensors(recipe: Recipe) -> Iterator[str]:
    robot, filters = recipe.robot, recipe.filters
    if robot.encoder_counts is not None:
        noise = measured_velocity_noise(robot)
        yield (f'encoder    {robot.resolution:.2g} rad a count: {noise:.2g} rad/s of noise in the '
               f'velocity, up to {noise * recipe.gains.k2.max():.2g} N m in the torque')
    if filters.state_order:
        yield (f'filters    {filters.state_order} x {1e3 * filters.state_time_constant:.3g} ms, '
               f'torque filter {1e3 * filters.time_constant:.3g} ms: they distort the torque of '
               f'this reference by {filters.motion_error:.2%}, and let {filters.noise:.2g} N m '
               'of the noise through')
    begin = 'theta_hat = 0' if robot.from_zero else "the URDF's values, a quarter off"
    yield f'start      the error of the first second, with {begin}'
    if robot.payload:
        worst = int(np.argmax(recipe.payload_error / recipe.motion.bound))
        joint, error = recipe.arm.joints[worst], recipe.payload_error[worst]
        yield (f'payload    {robot.payload:g} kg put on at once moves {joint} by {error:.2g} rad, '
               'before it is learned')
    if recipe.coulomb_friction.any():
        yield ('friction   the error that a Coulomb friction of 1 % of the torque limit leaves, '
               'which the model does not have (--coulomb learns it)')


def _cautions(recipe: Recipe) -> Iterator[str]:
    for text in recipe.assumed:
        yield f'assumed    {text}'
    for joint, error, bound in zip(recipe.arm.joints, recipe.start_error, recipe.motion.bound):
        if error > bound:
            yield (f'caution    {joint}: a URDF that is a quarter off may make the start leave '
                   f'the bound, {error:.2g} of {bound:.3g} rad: a wider --width, or less --delay')
    for joint, error, bound in zip(recipe.arm.joints, recipe.payload_error, recipe.motion.bound):
        if error > bound:
            yield (f'caution    {joint}: a payload that is put on at once leaves the bound, '
                   f'{error:.2g} of {bound:.3g} rad, before it is learned: less --payload, or '
                   'less --delay')
    for joint, reserve in zip(recipe.arm.joints, recipe.reserve):
        if reserve < LITTLE:
            yield (f'caution    {joint}: the reference needs {1.0 - reserve:.0%} of its torque '
                   'limit: choose another --centre, a smaller --amplitude, or less --payload')
    yield ('caution    nobody has looked for collisions: watch the motion first (simulate --bag, '
           'report), and choose --centre and --amplitude to fit the cell')
