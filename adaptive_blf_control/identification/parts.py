# SPDX-License-Identifier: Apache-2.0
"""The parts of an identifier: those that its settings name, or that the caller passes in."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.arms.joint_friction import coulomb_columns
from adaptive_blf_control.identification.change_monitor import ChangeMonitor, ResidualMonitor
from adaptive_blf_control.identification.history import History
from adaptive_blf_control.identification.history_stack import HistoryStack
from adaptive_blf_control.identification.settings import IdentifierSettings
from adaptive_blf_control.identification.state_filter import LowPass, StateFilter
from adaptive_blf_control.identification.update_laws import (
    make_update_law,
    plugin_update_law,
    UpdateLaw,
)
from adaptive_blf_control.parameters.plugin import is_plugin, load_plugin, made

__all__ = ['AnyHistory', 'Given', 'named', 'PartMaker']

AnyHistory = History | HistoryStack
"""Ours has attributes that cannot be set."""
_STATE_FILTER = ('update', 'reset', 'memory')
_HISTORY = ('offer', 'clear', 'retune', 'regressors', 'torques', 'gram', 'moment', 'size',
            'count', 'insertions', 'revision', 'rank', 'sigma_min')
_MONITOR = ('watch', 'reset', 'retune')


class Given(NamedTuple):
    """Parts in place of those that the settings name; None where these shall be used.

    A class, or another callable, is called as one that is named.
    """

    update_law: UpdateLaw | type[UpdateLaw] | None = None
    state_filter: StateFilter | type[StateFilter] | None = None
    history_stack: AnyHistory | type[AnyHistory] | None = None
    change_monitor: ChangeMonitor | type[ChangeMonitor] | None = None

    def reusable(self) -> Given:
        """Return those that make a new part for each identifier."""
        return self._replace(**{name: None for name, part in self._asdict().items()
                                if not isinstance(part, type)})


def named(given: Mapping[str, Any]) -> tuple[Given, dict[str, str]]:
    """Tell parts from names.

    Args:
        given: What the caller gave for each part of `Given`.

    Returns:
        The parts, and the settings that the names stand for.
    """
    settings = {'update_law': 'update_law', 'state_filter': 'filter.state_filter',
                'history_stack': 'history.selection', 'change_monitor': 'change.monitor'}
    return (Given(**{name: part for name, part in given.items() if not isinstance(part, str)}),
            {settings[name]: part for name, part in given.items() if isinstance(part, str)})


class PartMaker(NamedTuple):
    """Makes the parts of an identifier; ParameterError where one cannot be made.

    Settings have to have arrays of full length, see `Settings.resolved`.

    Attributes:
        arm: The arm whose parameters are learned.
        given: Parts that the caller passed in.
    """

    arm: Arm
    given: Given

    def update_law(self, settings: IdentifierSettings) -> UpdateLaw:
        """Make the update law; called again with every change of the settings."""
        law = self.given.update_law
        if law is None:
            return make_update_law(settings)
        return plugin_update_law('update_law', law, law, settings)

    def state_filter(self, settings: IdentifierSettings) -> StateFilter:
        """Make what filters the measured state."""
        chosen = settings.filter
        result: StateFilter = self._made(
            'state_filter', 'identifier.filter.state_filter', chosen.state_filter, _STATE_FILTER,
            lambda: LowPass(self.arm.n, chosen.state_order, chosen.state_time_constant), settings)
        return result

    def history(self, settings: IdentifierSettings) -> AnyHistory:
        """Make an empty history."""
        result: AnyHistory = self._made(
            'history_stack', 'identifier.history.selection', settings.history.selection, _HISTORY,
            lambda: self.algorithm_1(settings), settings)
        return result

    def algorithm_1(self, settings: IdentifierSettings) -> HistoryStack:
        """Make an empty stack of Algorithm 1."""
        chosen = settings.history
        return HistoryStack(self.arm.n, self.arm.m, chosen.size, chosen.epsilon,
                            chosen.minimum_growth)

    def monitor(self, settings: IdentifierSettings) -> ChangeMonitor:
        """Make the change monitor."""
        chosen = settings.change
        result: ChangeMonitor = self._made(
            'change_monitor', 'identifier.change.monitor', chosen.monitor, _MONITOR,
            lambda: ResidualMonitor(self.arm.n, self.arm.m, chosen.window, chosen.threshold,
                                    chosen.resolution, coulomb_columns(self.arm)), settings)
        return result

    def _made(self, argument: str, parameter: str, name: str, required: tuple[str, ...],
              ours: Callable[[], Any], settings: IdentifierSettings) -> Any:
        given = getattr(self.given, argument)
        if given is not None:
            return made(argument, given, given, required, self.arm, settings)
        if is_plugin(name):
            return made(parameter, name, load_plugin(parameter, name), required, self.arm,
                        settings)
        return ours()
