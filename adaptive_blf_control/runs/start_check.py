# SPDX-License-Identifier: Apache-2.0
"""What is to be said about a scenario before it runs: its loop, its history, the arm's limits."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.configuration.node_settings import ControllerNodeSettings, DriverSettings
from adaptive_blf_control.configuration.parameter_file import given_values, node_settings
from adaptive_blf_control.control.arm_limits import limit_warnings
from adaptive_blf_control.control.reference import full_range
from adaptive_blf_control.identification.rank_condition import rank_warning
from adaptive_blf_control.simulation.closed_loop import ClosedLoop
from adaptive_blf_control.simulation.encoder_check import encoder_warning
from adaptive_blf_control.tuning.filter_cost import filter_warnings
from adaptive_blf_control.tuning.loop_check import check_loop, warnings_of_loop
from adaptive_blf_control.tuning.stated_loop import simulated_delay, stated_delay

__all__ = ['known_theta', 'loop_warnings', 'start_warnings']


def start_warnings(data: Mapping[str, Any], loop: ClosedLoop) -> Iterator[str]:
    """Yield a sentence for whatever a scenario is to be warned of.

    Args:
        data: The parameter file's data.
        loop: Built from it.

    Raises:
        ParameterError: see `loop_warnings`.
    """
    too_few = rank_warning(loop.identifier.settings, loop.arm.n, loop.arm.m)
    if too_few:
        yield too_few
    if unused := encoder_warning(given_values(data, 'arm_driver'), loop.plant):
        yield unused
    yield from limit_warnings(loop.arm, loop.controller.settings)
    lower, upper = full_range(loop.controller.reference)
    if np.array_equal(lower, upper):
        yield ('the reference does not move, so that next to nothing is learned: set '
               'controller.reference.<joint>.amplitude and frequency')
    known = known_theta(loop.arm, loop.initial_estimate)
    if known is not None:
        yield from filter_warnings(loop.arm, loop.controller.reference, known,
                                   loop.identifier.settings.filter)
    yield from loop_warnings(data, loop)


def known_theta(arm: Arm, estimate: np.ndarray) -> np.ndarray | None:
    """Return the estimate, the nominal θ where it is zero; None where there is neither."""
    if np.any(estimate):
        return estimate
    nominal: np.ndarray | None = getattr(arm, 'nominal', None)
    return nominal


def loop_warnings(data: Mapping[str, Any], loop: ClosedLoop) -> Iterator[str]:
    """Yield a sentence for gains that do not fit the delay, the larger of stated and simulated.

    Raises:
        ParameterError: they are unstable, and ``controller.loop.unstable`` is ``refuse``.
    """
    stated = node_settings(data, ControllerNodeSettings).loop
    delay = stated_delay(stated).longer(simulated_delay(node_settings(data, DriverSettings)))
    controller = loop.controller
    yield from warnings_of_loop(
        check_loop(loop.arm, controller.settings, controller.reference, loop.initial_estimate,
                   delay), stated.unstable)
