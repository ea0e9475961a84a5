# SPDX-License-Identifier: Apache-2.0
"""What the state filter of an identifier costs at the speed of a reference.

The filtered state does not quite obey the arm's equation with the filtered torque: the torque of
a filtered motion is not the filtered torque of the motion. The difference is what θ̂ is fitted to
besides the arm. It is computed here without noise, along the reference, for a given θ; it grows
with the square of the filter's time and of the speed.
"""

from __future__ import annotations

from collections.abc import Iterator
import math

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.arms.inverse_dynamics import inverse_dynamics
from adaptive_blf_control.control.reference import Reference
from adaptive_blf_control.identification.settings import FilterSettings
from adaptive_blf_control.identification.state_filter import cascade_step
from adaptive_blf_control.tuning.inertia import reference_states, ReferenceStates

__all__ = ['ACCEPTED', 'filter_cost', 'filter_warnings']

STEP, FINE, SPAN = 0.01, 0.25, 12.0  # s, time constants, s: grid after the filter has settled
SETTLED = 5.0  # times its memory
ACCEPTED = 0.01  # part of the torque that a filter may cost without a warning


def filter_cost(arm: Arm, reference: Reference, theta: np.ndarray, order: int,
                time_constant: float) -> float:
    """Return RMS[τ_f − τ(q_f, q̇_f, q̈_f)] / RMS[τ_f] along a reference, over all joints.

    Args:
        arm: The arm.
        reference: The motion.
        theta: θ, shape (m,).
        order: N of 1/(T s + 1)^N, 0 or at least 2.
        time_constant: T [s].
    """
    if not order:
        return 0.0
    step = min(STEP, FINE * time_constant)
    start = math.ceil(SETTLED * order * time_constant / step)
    count = start + math.ceil(SPAN / step)
    states = reference_states(reference, count + 1, step * count)
    torque = inverse_dynamics(arm, theta, *states)
    ratio = step / time_constant
    q = _cascade(states.q, order, ratio)
    filtered = ReferenceStates(
        q[:, order], (q[:, order - 1] - q[:, order]) / time_constant,
        (q[:, order - 2] - 2.0 * q[:, order - 1] + q[:, order]) / time_constant ** 2)
    wanted = _cascade(torque, order, ratio)[start:, order]
    error = wanted - inverse_dynamics(arm, theta, *(each[start:] for each in filtered))
    scale = float(np.sqrt(np.mean(wanted ** 2)))
    return float(np.sqrt(np.mean(error ** 2))) / scale if scale > 0.0 else 0.0


def _cascade(signal: np.ndarray, order: int, ratio: float) -> np.ndarray:
    """Return a signal and the outputs of the stages it passes, (N, n) → (N, order + 1, n)."""
    stages = np.repeat(signal[:1], order, axis=0)
    result = np.empty((len(signal), order + 1, signal.shape[1]))
    for k, value in enumerate(signal):
        if k:
            stages = cascade_step(stages, signal[k - 1], value, ratio)
        result[k, 0], result[k, 1:] = value, stages
    return result


def filter_warnings(arm: Arm, reference: Reference, theta: np.ndarray,
                    settings: FilterSettings) -> Iterator[str]:
    """Yield a sentence where the state filter is too slow for the motion.

    Args:
        arm: The arm.
        reference: The motion.
        theta: θ as far as it is known, shape (m,); zero says nothing.
        settings: Of the filters.
    """
    order, constant = settings.state_order, settings.state_time_constant
    if settings.state_filter != 'low_pass' or not order:
        return
    first = cost = filter_cost(arm, reference, theta, order, constant)
    better = constant
    while cost > ACCEPTED:
        better *= 0.95 * math.sqrt(ACCEPTED / cost)
        cost = filter_cost(arm, reference, theta, order, better)
    if better < constant:
        yield (f'identifier.filter.state_time_constant: {order} times {constant:g} s distort the '
               f'torque of this reference by {first:.1%} of it; {better:.2g} s, or a motion at '
               f'{better / constant:.2g} times its speed, would cost less than {ACCEPTED:.0%}')
