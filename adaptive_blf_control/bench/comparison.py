# SPDX-License-Identifier: Apache-2.0
"""Runs every law on the plant, reference and sensors of one scenario and measures it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.bench.integral_cl import IntegralConcurrentLearning
from adaptive_blf_control.bench.ours import Ours
from adaptive_blf_control.configuration.build import build_closed_loop
from adaptive_blf_control.configuration.parameter_file import apply_settings
from adaptive_blf_control.identification.history_stack import HistoryStack
from adaptive_blf_control.identification.state_filter import StateFilter
from adaptive_blf_control.simulation.baselines.fixed import ComputedTorque, ProportionalDerivative
from adaptive_blf_control.simulation.baselines.gains import (
    gains_like,
    SLOTINE_LI_GAMMA,
    WINDOW_LEAST,
    WRONG_MODEL,
)
from adaptive_blf_control.simulation.baselines.law import Law
from adaptive_blf_control.simulation.baselines.slotine_li import SlotineLi
from adaptive_blf_control.simulation.closed_loop import ClosedLoop, sample_time
from adaptive_blf_control.simulation.plant import known_truth

__all__ = ['FIXED', 'LAWS', 'LawRun', 'VARIANTS', 'drive', 'run_law', 'window_samples']

Data = Mapping[str, Any]


class LawRun(NamedTuple):
    """A run over N samples: t (N,) [s]; true e1 (N, n) [rad] and q; torque (N, n); θ̂ (N, m)."""

    t: np.ndarray
    q: np.ndarray
    e1: np.ndarray
    torque: np.ndarray
    theta: np.ndarray | None


@dataclass(frozen=True)
class _Variant:
    """Settings that make our law another one; θ* and 0.7 θ are filled in from the scenario."""

    settings: tuple[str, ...] = ()
    prior: str = ''


VARIANTS: dict[str, _Variant] = {
    'ABLF, known model (34)': _Variant(('controller.model=known',), 'known'),
    'ABLF, wrong model, no adaptation': _Variant(
        ('identifier.update_law=gradient', 'identifier.kt=0.0', 'identifier.kh=0.0',
         'identifier.change.window=0.0'), 'wrong'),
    'ABLF, gradient (20)': _Variant(('identifier.update_law=gradient',)),
    'ABLF, concurrent (22)': _Variant(('identifier.update_law=concurrent',)),
    'ABLF, ablf_concurrent (37)': _Variant(('identifier.update_law=ablf_concurrent',)),
}
"""Our own law and its variants, by the parameters of the nodes."""


def _pd(loop: ClosedLoop) -> Law:
    return ProportionalDerivative(loop.controller.reference, gains_like(loop.controller))


def _computed_torque(loop: ClosedLoop) -> Law:
    return ComputedTorque(loop.arm, loop.controller.reference, gains_like(loop.controller),
                          WRONG_MODEL * loop.arm.nominal)


def _slotine_li(loop: ClosedLoop) -> Law:
    settings = loop.identifier.settings
    return SlotineLi(loop.arm, loop.controller.reference, gains_like(loop.controller),
                     SLOTINE_LI_GAMMA * settings.gamma, settings.initial_estimate)


def window_samples(loop: ClosedLoop) -> int:
    """Return the window of integral CL in samples: twice the memory of our filters.

    A mean over Δ passes as much white noise as a first-order filter with time constant Δ/2.
    """
    memory = loop.identifier.settings.filter.memory
    return int(round(max(2.0 * memory, WINDOW_LEAST) / loop.period))


def _integral_cl(loop: ClosedLoop, filtered: bool = False) -> Law:
    settings, arm = loop.identifier.settings, loop.arm
    stack = HistoryStack(arm.n, arm.m, settings.history.size, settings.history.epsilon,
                         settings.history.minimum_growth)
    state_filter = None
    if filtered and settings.filter.state_order:
        state_filter = StateFilter(settings.filter.state_order,
                                   settings.filter.state_time_constant)
    return IntegralConcurrentLearning(
        arm, loop.controller.reference, gains_like(loop.controller),
        SLOTINE_LI_GAMMA * settings.gamma, settings.initial_estimate,
        settings.kh / SLOTINE_LI_GAMMA, stack, window_samples(loop), state_filter)


def _integral_cl_filtered(loop: ClosedLoop) -> Law:
    return _integral_cl(loop, filtered=True)


BASELINES: dict[str, Callable[[ClosedLoop], Law]] = {
    'PD': _pd,
    f'computed torque, model x {WRONG_MODEL:g}': _computed_torque,
    'Slotine-Li adaptive': _slotine_li,
    'integral concurrent learning': _integral_cl,
    'integral CL behind our state filter': _integral_cl_filtered,
}

FIXED = (*tuple(BASELINES)[:2], *tuple(VARIANTS)[:2])
"""Laws that learn nothing."""
LAWS = (*BASELINES, *VARIANTS)
"""Names of all laws, in the order of the tables."""


def _variant_loop(data: Data, variant: _Variant) -> ClosedLoop:
    settings = list(variant.settings)
    plain = build_closed_loop(data)
    if variant.prior == 'known':
        true = known_truth(plain.plant, plain.arm.parameters)[0][1]
        settings.append(f'controller.known_parameters={true.tolist()}')
    elif variant.prior == 'wrong':
        wrong = (WRONG_MODEL * plain.arm.nominal).tolist()
        settings += [f'{node}.initial_estimate={wrong}' for node in ('controller', 'identifier')]
    return build_closed_loop(apply_settings(data, settings))


def run_law(data: Data, name: str, duration: float) -> tuple[ClosedLoop, LawRun]:
    """Run one law of `LAWS` for ``duration`` [s]; the loop returned has plant and sets.

    Args:
        data: A scenario's parameter file.
        name: Of the law.
        duration: Length of the run [s].
    """
    if name in VARIANTS:
        loop = _variant_loop(data, VARIANTS[name])
        law: Law = Ours(loop)
    else:
        loop = build_closed_loop(data)
        law = BASELINES[name](loop)
    steps, n = int(round(duration / loop.period)) + 1, loop.arm.n
    q, e1, torque = (np.empty((steps, n)) for _ in range(3))
    theta = None if law.theta is None else np.empty((steps, loop.arm.m))
    reference = loop.controller.reference
    for k, (t, answer) in enumerate(drive(loop, law, duration)):
        q[k], torque[k] = loop.plant.q, answer
        e1[k] = loop.plant.q - reference.at(t).position
        if theta is not None:
            theta[k] = law.theta
    return loop, LawRun(np.arange(steps) * loop.period, q, e1, torque, theta)


def drive(loop: ClosedLoop, law: Law, duration: float) -> Iterator[tuple[float, np.ndarray]]:
    """Drive the plant of ``loop`` with ``law`` and store nothing.

    Args:
        loop: Has the plant and the period.
        law: Answers every sample.
        duration: Length of the run [s]; the sample at its end is included.

    Yields:
        Time [s] and torque (n,) [N·m] of each sample, before the plant moves on.
    """
    plant = loop.plant
    for k in range(int(round(duration / loop.period)) + 1):
        t = sample_time(k, loop.period)
        torque = law.update(t, plant.measure(plant.torque, loop.period if k else 0.0))
        yield t, torque
        plant.apply(torque)
        plant.advance(loop.period)
