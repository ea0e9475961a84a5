# SPDX-License-Identifier: Apache-2.0
"""The parts of a running identifier, joined to the state that its step changes."""

from __future__ import annotations

from typing import Any

import numpy as np

from adaptive_blf_control.arms.regressors import ArmInPython, arrays_of
from adaptive_blf_control.compiled import entry_for, handle, uncompiled
from adaptive_blf_control.identification.algorithm_1 import arrays_of_stack
from adaptive_blf_control.identification.artificial_noise import NoisyHistory
from adaptive_blf_control.identification.change_monitor import ChangeMonitor, ResidualMonitor
from adaptive_blf_control.identification.change_response import (
    forget_response,
    new_response,
    ResponseArrays,
)
from adaptive_blf_control.identification.excitation import Excitation
from adaptive_blf_control.identification.filter_distortion import distortion_of
from adaptive_blf_control.identification.history_stack import HistoryStack
from adaptive_blf_control.identification.parts import AnyHistory, PartMaker
from adaptive_blf_control.identification.position_limits import (
    position_limits_of,
    PositionLimits,
)
from adaptive_blf_control.identification.settings import IdentifierSettings
from adaptive_blf_control.identification.state_filter import LowPass, StateFilter
from adaptive_blf_control.identification.step import (
    AGE,
    BEGUN,
    has_settled,
    IdentifierState,
    learn_pair,
    learn_step,
    LearnerState,
    Learning,
    observe_sample,
    observe_step,
    PairState,
    Running,
    take_sample,
    take_samples,
)
from adaptive_blf_control.identification.tip_load import load_directions
from adaptive_blf_control.identification.torque_filter import TorqueFilter
from adaptive_blf_control.identification.update_laws import (
    AblfConcurrent,
    Concurrent,
    Gradient,
    UpdateLaw,
)

__all__ = ['RunningParts']

_LAWS = (AblfConcurrent, Concurrent, Gradient)


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
        compiled: Whether the step is one compiled function.
    """

    _made: Any  # what compiled functions get, and the machine code that takes a sample
    _entry: Any

    def __init__(self, make: PartMaker, settings: IdentifierSettings) -> None:
        """Start without a sample and without a pair."""
        arm = make.arm
        arrays = arrays_of(arm)
        self.arm: Any = ArmInPython(arm) if arrays is None else arrays
        self._make = make
        self._settings = settings
        self.law = make.update_law(settings)
        self.state_filter = make.state_filter(settings)
        self.history = make.history(settings)
        self.monitor = make.monitor(settings)
        self.excitation = Excitation(arm.m, settings.excitation.window)
        self._response = new_response(arm.n, arm.m, load_directions(arm))
        self._noisy = self._new_noisy_history()
        self._filter = TorqueFilter(arm.n, arm.m, settings.filter.time_constant,
                                    instant=settings.filter.effort == 'instant')
        self._theta = np.array(settings.initial_estimate, dtype=float)
        self._counts, self._clock = np.zeros(9, dtype=np.int64), np.zeros(2)
        self._since_limit, self._distortion = np.full(arm.n, np.inf), np.zeros(1)
        self._join()

    def _new_noisy_history(self) -> NoisyHistory:
        history, arm = self._settings.history, self._make.arm
        return NoisyHistory(arm.n, arm.m, history.size, history.epsilon, history.noise,
                            history.noise_seed)

    def _join(self) -> None:
        """Take the parts as arrays where that is possible."""
        filters = self._settings.filter
        arrays = _as_arrays(self.history, self.monitor, self.law, self._make.arm.n)
        history, monitor, law = arrays or (self.history, self.monitor, self.law)
        state_filter = (self.state_filter.arrays if type(self.state_filter) is LowPass
                        else self.state_filter)
        self.state = IdentifierState(
            state_filter,
            PairState(self._filter.arrays, self._counts, self._clock, float(filters.gap),
                      float(filters.settle * self.memory), self._limits(),
                      distortion_of(filters, self._distortion)),
            LearnerState(self._theta, history, self._noisy.arrays, monitor,
                         self._joined_response(arrays is not None), self.excitation.arrays, law))
        observes = state_filter is not self.state_filter and not isinstance(
            self.arm, ArmInPython)
        self.compiled = observes and arrays is not None
        self._learns = arrays is not None
        self._made = self._entry = None

    def _limits(self) -> PositionLimits:
        settings = self._settings
        return position_limits_of(self._make.arm, settings.position_limit_margin,
                                  settings.change.settle * self.memory, self._since_limit)

    def _joined_response(self, ours: bool) -> ResponseArrays:
        """Return the response with its settings; no suspicion where a part is not ours."""
        change, memory = self._settings.change, self.memory
        return self._response._replace(
            suspicion=float(change.suspicion) if ours and change.window > 0.0 else 0.0,
            memory=float(memory), settling=float(change.settle * memory),
            patience=float(change.patience),
            contact=bool(self._settings.known_contact), adapts=bool(change.adapt))

    @property
    def response(self) -> ResponseArrays:
        """What follows when the recorded pairs are contradicted."""
        return self._response

    def __getstate__(self) -> dict[str, Any]:
        """Return what a copy or a pickle takes: all but the handle, which it makes again."""
        return {**self.__dict__, '_made': None, '_entry': None}

    @property
    def _handle(self) -> Any:
        """What compiled functions get: all, or what is after filters in Python."""
        if self._made is None:
            self._made = handle(Running(self.arm, self.state) if self.compiled else
                                Learning(self.state.pair, self.state.learner))
        return self._made

    @property
    def memory(self) -> float:
        """How long the filters remember a sample [s]."""
        return self._settings.filter.time_constant + self.state_filter.memory

    @property
    def artificial_noise(self) -> bool:
        """Whether pairs with artificial noise teach (Remark 3)."""
        return self._noisy.in_use

    def observe(self, t: float, q: np.ndarray, qd: np.ndarray, tau: np.ndarray) -> float:
        """Filter one sample, see `observe_step`."""
        if self.compiled:
            return float(observe_sample(self._handle, t, q, qd, tau))
        state = self.state
        return uncompiled(observe_step)(self.arm, state.state_filter, state.pair, t, q, qd, tau)

    def take(self, t: float, q: np.ndarray, qd: np.ndarray, tau: np.ndarray,
             term: np.ndarray) -> None:
        """Filter one sample and learn from it, see `identifier_step`; no type is looked at."""
        self._follow_stack()
        if self.compiled:
            if self._entry is None:
                self._entry = entry_for(take_sample, self._handle, t, q, qd, tau, term)
            self._entry(self._handle, t, q, qd, tau, term)
            return
        dt = self.observe(t, q, qd, tau)
        if dt > 0.0:
            self._learn(dt, term)

    def _follow_stack(self) -> None:
        """Take the arrays of a stack whose size was changed beside `retune`."""
        history: Any = self.history
        if self._learns and arrays_of_stack(history) is not self.state.learner.history:
            self._join()

    def _learn(self, dt: float, term: np.ndarray) -> None:
        if self._learns:
            learn_pair(self._handle, dt, term)
        else:
            uncompiled(learn_step)(self.state.pair, self.state.learner, dt, term)

    def take_all(self, t: np.ndarray, q: np.ndarray, qd: np.ndarray, tau: np.ndarray,
                 term: np.ndarray, learning: np.ndarray, rows: np.ndarray,
                 usable: np.ndarray, recorded: np.ndarray) -> None:
        """Take samples one after the other, see `take_samples`."""
        self._follow_stack()
        if self.compiled:
            take_samples(self._handle, t, q, qd, tau, term, learning, rows, usable,
                         recorded)
            return
        pair, m = self.state.pair, self._theta.size
        for k in range(t.size):
            revision = self.history.revision
            dt = self.observe(t[k], q[k], qd[k], tau[k])
            if dt > 0.0 and learning[k]:
                self._learn(dt, term)
            recorded[k] = self.history.revision != revision
            usable[k] = dt > 0.0 and uncompiled(has_settled)(pair)
            rows[k, :, :m], rows[k, :, m] = pair.filter.regressor, pair.filter.torque

    def restart(self) -> None:
        """Restart the filters with the next sample, whatever its time is."""
        self._forget_samples()
        self._counts[BEGUN] = 0

    def _forget_samples(self) -> None:
        self._filter.reset()
        self.state_filter.reset()
        self._clock[AGE] = 0.0

    def clear(self) -> None:
        """Forget every pair."""
        self.history.clear()
        self.monitor.reset()
        forget_response(self._response)
        self._noisy = self._new_noisy_history()
        self._join()

    def retune(self, settings: IdentifierSettings) -> None:
        """Use other settings, see `Identifier.retune`; ParameterError, and nothing has changed."""
        before, make = self._settings, self._make
        # What may be refused comes first.
        law = make.update_law(settings)
        state_filter = (make.state_filter(settings)
                        if _chosen_filter(settings) != _chosen_filter(before) else None)
        history = (make.history(settings)
                   if settings.history.selection != before.history.selection else None)
        if settings.change.monitor != before.change.monitor:
            self.monitor = make.monitor(settings)  # the last that can be refused
        self._settings, self.law = settings, law
        self._retune_filters(state_filter)
        self._retune_history(before, history)
        change = settings.change
        self.monitor.retune(change.window, change.threshold, change.resolution)
        if settings.excitation.window != before.excitation.window:
            self.excitation = Excitation(make.arm.m, settings.excitation.window)
        self._join()

    def _retune_filters(self, state_filter: StateFilter | None) -> None:
        self._filter.retune(self._settings.filter.time_constant, self._filter.gap,
                            instant=self._settings.filter.effort == 'instant')
        if state_filter is not None:
            self.state_filter = state_filter
            self._forget_samples()

    def _retune_history(self, before: IdentifierSettings, history: AnyHistory | None) -> None:
        chosen, former = self._settings.history, before.history
        if history is not None:
            for j in range(self.history.count):
                history.offer(self.history.regressors[j], self.history.torques[j])
            self.history = history
        self.history.retune(chosen.size, chosen.epsilon, chosen.minimum_growth)
        if (chosen.noise, chosen.noise_seed) != (former.noise, former.noise_seed):
            self._noisy = self._new_noisy_history()
            if self.history.rank == self._make.arm.m:
                self._noisy.end()
        else:
            self._noisy.retune(chosen.size, chosen.epsilon)


def _as_arrays(history: AnyHistory, monitor: ChangeMonitor, law: UpdateLaw,
               n: int) -> tuple[Any, Any, Any] | None:
    """Return parts as arrays where all are ours, and none inherits from ours, for n joints."""
    if (type(history) is HistoryStack and type(monitor) is ResidualMonitor
            and isinstance(law, AblfConcurrent) and type(law) in _LAWS):
        return arrays_of_stack(history), monitor.arrays, law.arrays(n)
    return None


def _chosen_filter(settings: IdentifierSettings) -> tuple[object, ...]:
    chosen = settings.filter
    return chosen.state_filter, chosen.state_order, chosen.state_time_constant
