# SPDX-License-Identifier: Apache-2.0
"""Runs every law on the plant, reference and sensors of one scenario."""

from __future__ import annotations

from collections.abc import Callable, Mapping
import copy
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.bench.integral_cl import IntegralConcurrentLearning
from adaptive_blf_control.configuration.build_closed_loop import build_closed_loop, OwnParts
from adaptive_blf_control.configuration.parameter_file import apply_settings
from adaptive_blf_control.control.laws.protocol import Law, own_estimate, uses_estimate
from adaptive_blf_control.identification.history_stack import HistoryStack
from adaptive_blf_control.identification.state_filter import LowPass
from adaptive_blf_control.simulation.closed_loop import ClosedLoop, Trace
from adaptive_blf_control.simulation.plant import known_truth
from adaptive_blf_control.simulation.sample import Sample

__all__ = ['FIXED', 'LAWS', 'Compared', 'WRONG_MODEL', 'run_law', 'window_samples']

Data = Mapping[str, Any]
WRONG_MODEL = 0.7
"""Part of the nominal parameters that laws with a fixed, wrong model believe in."""
ERROR_GAMMA = 200.0
"""Γ of what is learned from the tracking error alone, as a multiple of the scenario's Γ.

The best in RMS of 1, 10, 50, 200 for Slotine-Li and integral CL on three_link and
three_link_encoder, 25 s."""
WINDOW_LEAST = 0.1
"""Shortest window that integral CL integrates over [s]."""


class Compared(NamedTuple):
    """A run under one law.

    Attributes:
        loop: The objects that ran.
        trace: The run as arrays.
        theta: θ̂ that the law uses next, shape (N, m); None for a law without a model.
    """

    loop: ClosedLoop
    trace: Trace
    theta: np.ndarray | None


def window_samples(loop: ClosedLoop) -> int:
    """Return the window of integral CL in samples: twice the memory of our filters.

    A mean over Δ passes as much white noise as a first-order filter with time constant Δ/2.
    """
    memory = loop.identifier.memory
    return int(round(max(2.0 * memory, WINDOW_LEAST) / loop.period))


def _integral_cl(loop: ClosedLoop, filtered: bool = False) -> Law:
    settings, arm = loop.identifier.settings, loop.arm
    stack = HistoryStack(arm.n, arm.m, settings.history.size, settings.history.epsilon,
                         settings.history.minimum_growth)
    state_filter = None
    if filtered and settings.filter.state_order:
        state_filter = LowPass(arm.n, settings.filter.state_order,
                               settings.filter.state_time_constant)
    return IntegralConcurrentLearning(arm, loop.controller.settings, settings.kh / ERROR_GAMMA,
                                      stack, window_samples(loop), state_filter)


def _integral_cl_filtered(loop: ClosedLoop) -> Law:
    return _integral_cl(loop, filtered=True)


@dataclass(frozen=True)
class _Variant:
    """What makes a scenario that of a law.

    Attributes:
        settings: Parameters, ``node.name=value``.
        model: What a fixed model is filled in with: ``known`` θ*, ``wrong`` for both nodes,
            ``wrong_known`` for a law that is told it; '' leaves the scenario's.
        from_error: Whether it learns from the tracking error, with a larger Γ.
        law: Makes the law of a loop, where no name stands for it.
    """

    settings: tuple[str, ...] = ()
    model: str = ''
    from_error: bool = False
    law: Callable[[ClosedLoop], Law] | None = None


_NO_LEARNING = ('identifier.update_law=gradient', 'identifier.kt=0.0', 'identifier.kh=0.0',
                'identifier.change.window=0.0')
_VARIANTS: dict[str, _Variant] = {
    'PD': _Variant(('controller.law=pd',)),
    f'computed torque, model x {WRONG_MODEL:g}': _Variant(
        ('controller.law=computed_torque', 'controller.model=known'), 'wrong_known'),
    'Slotine-Li adaptive': _Variant(('controller.law=slotine_li',), from_error=True),
    'integral concurrent learning': _Variant(from_error=True, law=_integral_cl),
    'integral CL behind our state filter': _Variant(from_error=True, law=_integral_cl_filtered),
    'ABLF, known model (34)': _Variant(('controller.model=known',), 'known'),
    'ABLF, wrong model, no adaptation': _Variant(_NO_LEARNING, 'wrong'),
    'ABLF, gradient (20)': _Variant(('identifier.update_law=gradient',)),
    'ABLF, concurrent (22)': _Variant(('identifier.update_law=concurrent',)),
    'ABLF, ablf_concurrent (37)': _Variant(('identifier.update_law=ablf_concurrent',)),
}
FIXED = ('PD', f'computed torque, model x {WRONG_MODEL:g}', 'ABLF, known model (34)',
         'ABLF, wrong model, no adaptation')
"""Laws that learn nothing."""
LAWS = tuple(_VARIANTS)
"""Names of all laws, in the order of the tables."""


def _model_settings(plain: ClosedLoop, model: str) -> list[str]:
    wrong = (WRONG_MODEL * plain.arm.nominal).tolist()
    if model == 'known':
        true = known_truth(plain.plant, plain.arm.parameters)[0][1].tolist()
        return [f'controller.known_parameters={true}']
    if model == 'wrong_known':
        return [f'controller.known_parameters={wrong}']
    if model == 'wrong':
        return [f'{node}.initial_estimate={wrong}' for node in ('controller', 'identifier')]
    return []


def _loop_of(data: Data, variant: _Variant) -> ClosedLoop:
    plain = build_closed_loop(data)
    settings = [*variant.settings, *_model_settings(plain, variant.model)]
    if variant.from_error:
        learning = plain.identifier.settings
        settings += [f'controller.slotine_li.gamma={(ERROR_GAMMA * learning.gamma).tolist()}',
                     f'controller.initial_estimate={learning.values()["initial_estimate"]}']
    data = apply_settings(copy.deepcopy(dict(data)), settings)
    if variant.law is None:
        return build_closed_loop(data)
    return build_closed_loop(data, OwnParts(law=variant.law(build_closed_loop(data))))


def run_law(data: Data, name: str, duration: float) -> Compared:
    """Run one law of `LAWS`.

    Args:
        data: A scenario's parameter file.
        name: Of the law.
        duration: Length of the run [s].
    """
    loop = _loop_of(data, _VARIANTS[name])
    law, own = loop.controller.law, []

    def observer(sample: Sample) -> None:
        theta = own_estimate(law)
        if theta is not None:
            own.append(theta)

    trace = loop.run(duration, observer)
    theta: np.ndarray | None = np.array(own) if own else None
    if uses_estimate(law):
        theta = trace.theta_hat if loop.known is None else np.tile(loop.known, (trace.t.size, 1))
    return Compared(loop, trace, theta)
