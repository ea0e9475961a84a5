# SPDX-License-Identifier: Apache-2.0
"""The law that a parameter names: one of ours, or ``module:name``."""

from __future__ import annotations

from typing import Any

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.arrays import checked_array
from adaptive_blf_control.control.laws.protocol import (
    Law,
    LawAnswer,
    LawSample,
    own_estimate,
    uses_estimate,
)
from adaptive_blf_control.control.settings import ControllerSettings, LAWS
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.parameters.plugin import load_plugin, made

__all__ = ['checked_law', 'make_law', 'retuned_law']


def make_law(arm: Arm, settings: ControllerSettings) -> Law:
    """Make the law that ``settings.law`` names: one of ours, or a plug-in.

    Args:
        arm: The arm.
        settings: With arrays of full length, see `Settings.resolved`.

    Raises:
        ParameterError: the plug-in cannot be imported or has no ``answer``.
    """
    if settings.law in LAWS:
        law: Law = load_plugin('controller.law', LAWS[settings.law])(arm, settings)
        return law
    return checked_law('controller.law', settings.law, load_plugin(
        'controller.law', settings.law), arm, settings)


def checked_law(name: str, value: object, given: Any, arm: Arm,
                settings: ControllerSettings) -> Law:
    """Return a plug-in behind a check of what it answers.

    Args:
        name: The parameter or argument that gives it, for messages.
        value: Its value, likewise.
        given: A law, or what is called with the arm and the settings and returns one.
        arm: The arm.
        settings: With arrays of full length.

    Raises:
        ParameterError: it cannot be made or has no ``answer``.
    """
    return _Checked(made(name, value, given, ('answer',), arm, settings,
                         base='Law'), arm)


def retuned_law(law: Law, settings: ControllerSettings) -> Law | None:
    """Return the law that goes on with other settings, None for one that is made again."""
    retuned = getattr(law, 'retuned', None)
    other: Law | None = None if retuned is None else retuned(settings)
    return other


class _Checked:
    """A law whose answers are what the compiled functions after it take, or are refused."""

    def __init__(self, law: Law, arm: Arm) -> None:
        self._law, self._arm = law, arm
        self.uses_estimate = uses_estimate(law)

    @property
    def given(self) -> Law:
        """The law itself."""
        return self._law

    @property
    def theta(self) -> np.ndarray | None:
        return own_estimate(self._law)

    def retuned(self, settings: ControllerSettings) -> Law | None:
        other = retuned_law(self._law, settings)
        return None if other is None else _Checked(other, self._arm)

    def answer(self, sample: LawSample) -> LawAnswer:
        answer, arm = self._law.answer(sample), self._arm
        if not isinstance(answer, LawAnswer):
            raise ParameterError(f'{type(self._law).__name__}.answer', answer,
                                 'a LawAnswer: LawAnswer(torque, e2), e2 q̇ − α or zeros')
        x = answer.regressor
        return LawAnswer(
            checked_array('torque', answer.torque, (arm.n,), arm.joints),
            checked_array('e2', answer.e2, (arm.n,), arm.joints),
            None if x is None else checked_array('regressor', x, (arm.n, arm.m)))
