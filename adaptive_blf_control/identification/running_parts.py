# SPDX-License-Identifier: Apache-2.0
"""The parts of a running identifier, joined to the state that its step changes."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.arms.regressors import arrays_of, regressors
from adaptive_blf_control.compiled import uncompiled
from adaptive_blf_control.identification.artificial_noise import no_noise, NoisyHistory
from adaptive_blf_control.identification.change_monitor import ResidualMonitor
from adaptive_blf_control.identification.excitation import Excitation
from adaptive_blf_control.identification.history_stack import HistoryStack
from adaptive_blf_control.identification.parts import PartMaker
from adaptive_blf_control.identification.settings import IdentifierSettings
from adaptive_blf_control.identification.state_filter import LowPass
from adaptive_blf_control.identification.step import (
    AGE,
    BEGUN,
    identifier_step,
    IdentifierState,
    learn_step,
    LearnerState,
    observe_step,
    PairState,
)
from adaptive_blf_control.identification.torque_filter import TorqueFilter
from adaptive_blf_control.identification.update_laws import AblfConcurrent, Concurrent, Gradient

__all__ = ['RunningParts']

_LAWS = (AblfConcurrent, Concurrent, Gradient)


class _ArmInPython(NamedTuple):
    arm: Arm


def _regressors_in_python(arm: _ArmInPython, q: np.ndarray,
                          qd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return arm.arm.Y12(q, qd)


regressors.register(_ArmInPython, _regressors_in_python)


class RunningParts:
    """Filters, history, monitor and update law of an identifier.

    What is known as arrays is stepped by compiled functions; where the arm or a part is an object
    in Python, the very same functions run uncompiled.

    Attributes:
        law: What moves θ̂.
        state_filter: What filters the measured state.
        history: The recorded pairs.
        monitor: What finds that the arm has changed.
        excitation: The integral of (21).
        state: What the step changes.
        arm: The arm as the step takes it.
    """

    def __init__(self, make: PartMaker, settings: IdentifierSettings) -> None:
        """Start without a sample and without a pair."""
        arm = make.arm
        arrays = arrays_of(arm)
        self.arm: Any = _ArmInPython(arm) if arrays is None else arrays
        self._make = make
        self._settings = settings
        self.law = make.update_law(settings)
        self.state_filter = make.state_filter(settings)
        self.history = make.history(settings)
        self.monitor = make.monitor(settings)
        self.excitation = Excitation(arm.m, settings.excitation.window)
        self._noisy = self._new_noisy_history()
        self._filter = TorqueFilter(arm.n, arm.m, settings.filter.time_constant)
        self._theta = settings.initial_estimate.copy()
        self._counts, self._clock = np.zeros(8, dtype=np.int64), np.zeros(2)
        self._join()

    def _new_noisy_history(self) -> NoisyHistory | None:
        history, arm = self._settings.history, self._make.arm
        if history.noise == 0.0:
            return None
        return NoisyHistory(arm.n, arm.m, history.size, history.epsilon, history.noise,
                            history.noise_seed)

    def _join(self) -> None:
        """Take the parts as arrays where that is possible."""
        noisy, filters = self._noisy, self._settings.filter
        self.state = IdentifierState(
            state_filter=(self.state_filter.arrays if type(self.state_filter) is LowPass
                          else self.state_filter),
            pair=PairState(self._filter.arrays, self._counts, self._clock, float(filters.gap),
                           float(filters.settle * self.memory)),
            learner=LearnerState(
                self._theta, *self._learning_parts(),
                no_noise() if noisy is None else noisy.arrays(noisy.stack.pairs),
                self.excitation.arrays))
        self._observe = (observe_step if self.state.state_filter is not self.state_filter
                         and not isinstance(self.arm, _ArmInPython) else uncompiled(observe_step))
        self._learn = (learn_step if self.state.learner.history is not self.history
                       else uncompiled(learn_step))

    def _learning_parts(self) -> tuple[Any, Any, Any]:
        """Return history, monitor and law: all as arrays, or all as objects."""
        history, monitor, law = self.history, self.monitor, self.law
        if (type(history) is HistoryStack and type(monitor) is ResidualMonitor
                and type(law) in _LAWS):
            return history.pairs, monitor.arrays, law.arrays(self._make.arm.n)
        return history, monitor, law
