# SPDX-License-Identifier: Apache-2.0
"""One sample of the closed loop, and its time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptive_blf_control.control.control_output import ControlOutput
from adaptive_blf_control.identification.change_monitor import ExternalTorque
from adaptive_blf_control.simulation.sensors import Measurement

__all__ = ['Sample', 'sample_time', 'sample_times']


def sample_time(k: int, period: float) -> float:
    """Return the time of sample k [s], that of a stamp in whole nanoseconds.

    A node that gets the stamp computes the very same double from it.
    """
    return round(k * period * 1e9) * 1e-9


def sample_times(samples: int, period: float) -> np.ndarray:
    """Return the times of the first ``samples`` samples, shape (samples,) [s]."""
    return np.round(np.arange(samples) * period * 1e9) * 1e-9


class Sample(NamedTuple):
    """One sample of the loop: the measured state and what the nodes answer to it.

    Attributes:
        t: Time since the start [s].
        measured: The state as the sensors show it.
        output: The controller's answer.
        theta_used: θ it was computed with, shape (m,).
        theta_hat: The identifier's answer, shape (m,).
        rank: Rank of the history.
        sigma_min: σ_min of the history.
        insertions: Pairs that the history has taken so far.
        excitation: Excitation index; None where switched off.
        external_torque: See `Identifier.external_torque`; None where nobody tells it.
    """

    t: float
    measured: Measurement
    output: ControlOutput
    theta_used: np.ndarray
    theta_hat: np.ndarray
    rank: int
    sigma_min: float
    insertions: int
    excitation: float | None
    external_torque: ExternalTorque | None
