# SPDX-License-Identifier: Apache-2.0
"""What stands between the law and the drives: a torque is let through, or another in its place."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, NamedTuple, Protocol

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.control.reference import ReferencePoint
from adaptive_blf_control.control.settings import ControllerSettings, SAFETY_FILTERS
from adaptive_blf_control.parameters.plugin import load_plugin, made

__all__ = ['FilterSample', 'Governed', 'SafetyFilter', 'complaint_of', 'made_filter',
           'narrow', 'status_of', 'watched_by']


class FilterSample(NamedTuple):
    """What a safety filter is asked about; arrays of shape (n,).

    Attributes:
        t: Time since the start of the motion [s].
        q: Measured positions [rad].
        qd: Measured velocities [rad/s].
        torque: Of the law, within its limits [N·m].
        least: Smallest torque that the limits of torque and its rate allow [N·m].
        most: Largest such torque [N·m].
    """

    t: float
    q: np.ndarray
    qd: np.ndarray
    torque: np.ndarray
    least: np.ndarray
    most: np.ndarray


class Governed(NamedTuple):
    """What is followed at a sample in place of the reference.

    Attributes:
        point: y_d with two derivatives.
        path_time: Time of the reference that this belongs to [s]; it does not run ahead of t,
            unless the clock was set back.
        rate: Its rate, 1 where the reference is not slowed down.
    """

    point: ReferencePoint
    path_time: float
    rate: float


class SafetyFilter(Protocol):
    """A safety filter, made as ``filter(arm, settings)``.

    What it may have besides ``filtered``:

    * ``retuned(settings)``: returns the filter that goes on with other settings, or raises
      ParameterError where the present state does not allow them; without it, it is made again;
    * ``constraints``: what it keeps, see `Constraint`;
    * ``complaint``: what is wrong with the last sample, '' where nothing is;
    * ``status()``: values for the diagnostics, by name;
    * ``watched`` and ``watch()``: names and values of what is published on
      ``controller/reserve``, since the last call;
    * ``narrow(bounds)``: told what is known of the arm for sure, see `CauseBounds`;
    * ``see(obstacles)``: told which obstacles move, see `MovingObstacles`;
    * ``governor``: a reference governor with ``governed(t, q, reference) -> Governed``, asked
      before the law, and ``heed(bounds)``, told the performance bounds of the sample; None for
      none.
    """

    @abstractmethod
    def filtered(self, sample: FilterSample) -> np.ndarray:
        """Return the torque to command, (n,) [N·m]: ``sample.torque`` itself lets it through."""
        ...


def complaint_of(safety_filter: SafetyFilter | None) -> str:
    """Return what is wrong with the last sample; '' where nothing is or it does not say."""
    complaint: str = getattr(safety_filter, 'complaint', '')
    return complaint


def status_of(safety_filter: SafetyFilter | None) -> dict[str, object]:
    """Return what a filter has for the diagnostics, by name."""
    status = getattr(safety_filter, 'status', None)
    return {} if status is None else dict(status())


def watched_by(safety_filter: SafetyFilter | None) -> tuple[str, ...]:
    """Return the names of what a filter publishes of itself, see `SafetyFilter`."""
    return tuple(getattr(safety_filter, 'watched', ()))


def narrow(safety_filter: SafetyFilter | None, bounds: Any) -> None:
    """Tell a filter that learns what is known of the arm for sure, see `CauseBounds`.

    Raises:
        ParameterError: it cannot use that, and goes on with what was known before any motion.
    """
    take = getattr(safety_filter, 'narrow', None)
    if take is not None:
        take(bounds)


def made_filter(arm: Arm, settings: ControllerSettings,
                before: SafetyFilter | None = None) -> SafetyFilter | None:
    """Return the filter that ``settings.safety_filter`` names; None for ``none``.

    Args:
        arm: The arm.
        settings: With arrays of full length, see `Settings.resolved`.
        before: The filter so far, which goes on where it can.

    Raises:
        ParameterError: it cannot be imported or made, or has no ``filtered``.
    """
    name = settings.safety_filter
    if name == 'none':
        return None
    retuned = getattr(before, 'retuned', None)
    if retuned is not None:
        other: SafetyFilter = retuned(settings)
        return other
    part: SafetyFilter = made('controller.safety_filter', name, load_plugin(
        'controller.safety_filter', SAFETY_FILTERS.get(name, name)), ('filtered',), arm, settings)
    return part
