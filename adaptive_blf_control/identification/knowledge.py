# SPDX-License-Identifier: Apache-2.0
"""What an identifier knows: θ̂, what determines it, and what became of the samples."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.arms.inverse_dynamics import inverse_dynamics
from adaptive_blf_control.calls import checked_call
from adaptive_blf_control.compiled import uncompiled
from adaptive_blf_control.identification.change_monitor import (
    ChangeMonitor,
    ExternalTorque,
    ResidualMonitor,
)
from adaptive_blf_control.identification.change_response import (
    ALARMS,
    CONTACTS,
    LOADS,
    STATE,
    STATES,
)
from adaptive_blf_control.identification.determination import undetermined
from adaptive_blf_control.identification.parts import AnyHistory
from adaptive_blf_control.identification.running_parts import RunningParts
from adaptive_blf_control.identification.step import (
    AT_LIMIT,
    CHANGES,
    has_settled,
    IdentifierState,
    NOT_FINITE,
    REPEATED,
    RESTARTS,
    TOO_LARGE,
    UPDATES,
    WENT_BACK,
)
from adaptive_blf_control.identification.torque_filter import FilteredPair
from adaptive_blf_control.identification.unused_log import Intervals
from adaptive_blf_control.parameters.guided import Guided

__all__ = ['Knowledge', 'Snapshot']

_DROPPED = {'not finite': NOT_FINITE, 'too large': TOO_LARGE, 'stamp repeated': REPEATED,
            'stamp went back': WENT_BACK}


class Snapshot(NamedTuple):
    """What the identifier knew at one sample; nothing of it changes later.

    Attributes:
        parameters: Names of the parameters.
        theta: θ̂, shape (m,).
        rank: Rank of the history stack.
        sigma_min: Its σ_min.
        insertions: Number of pairs it had taken.
    """

    parameters: tuple[str, ...]
    theta: np.ndarray
    rank: int
    sigma_min: float
    insertions: int


class Knowledge(Guided, instead={
        'theta_hat': 'theta is the estimate, estimate has it by name',
        'parameters': 'arm.parameters has their names, estimate their values by name',
        'joints': 'arm.joints has their names',
        'sigma_min': 'stack.sigma_min',
        'history': 'stack has the recorded pairs; settings.history has its settings, '
                   'retune(history=...) changes them',
        **dict.fromkeys(('pairs', 'n_pairs', 'recorded'),
                        'stack.regressors and stack.torques, of which stack.count are recorded; '
                        'pair is the present one'),
        **dict.fromkeys(('rmse', 'score', 'residual', 'residuals', 'test_rmse', 'train_rmse'),
                        'identify(log, arm=...) predicts what it has not learned from: its result '
                        'has test_rmse and prediction'),
        **dict.fromkeys(('plot', 'show', 'draw'), 'matplotlib draws arrays; identify(log, '
                        'arm=...).prediction has measured and predicted torques'),
        **dict.fromkeys(('std', 'stds', 'standard_deviations', 'standard_errors',
                         'covariance', 'uncertainty', 'confidence'),
                        'identify(log, arm=...) tells it of a log: its result has std and '
                        'uncertainty'),
        **dict.fromkeys(('condition', 'condition_number', 'cond'),
                        "stack.sigma_min; of a log identify(log, arm=...).figures['condition']"),
        **dict.fromkeys(('converged', 'is_converged', 'identified', 'done', 'complete'),
                        'rank == arm.m where the data determine every parameter, undetermined '
                        'names the others'),
        **dict.fromkeys(('urdf', 'to_urdf', 'consistent'),
                        'identify(log, urdf) returns what has urdf() and consistent')}):
    """What is read from an identifier; nothing here changes it.

    Attributes:
        arm: The arm whose parameters are learned.
    """

    def __init__(self, arm: Arm, parts: RunningParts) -> None:
        """Take the parts that learn."""
        self.arm = arm
        self._parts = parts
        self._theta, self._theta_updates = np.zeros(0), -1
        self._intervals = Intervals()

    def __repr__(self) -> str:
        """Show what has been learned."""
        dropped = sum(self.dropped.values())
        most = self.stack.size * self.arm.n
        return (f'<Identifier of {self.arm!r}: rank {self.rank} of {self.arm.m}, '
                f'{self.stack.count} of {self.stack.size} pairs'
                + (f', too few for more than rank {most}' if most < self.arm.m else '')
                + (f', {dropped} samples dropped' if dropped else '')
                + (f', {self.restarts} restarts of the filter' if self.restarts > 1 else '')
                + (', see its notes' if self._odd else '') + '>')

    @property
    def _odd(self) -> bool:
        """Whether it is known that there are notes: those of a model take a while."""
        return bool(self._intervals.note)

    @property
    def notes(self) -> tuple[str, ...]:
        """What is odd about the samples so far, in sentences."""
        return (self._intervals.note,) if self._intervals.note else ()

    # -- what has been learned ------------------------------------------------------------------

    @property
    def theta(self) -> np.ndarray:
        """θ̂, shape (m,), to be read; replaced by another array with every step."""
        updates = int(self._parts.state.pair.counts[UPDATES])
        if updates != self._theta_updates:
            self._theta, self._theta_updates = self._present_theta(), updates
            self._theta.setflags(write=False)
        return self._theta

    def _present_theta(self) -> np.ndarray:
        """Return θ̂ as an array of the caller's own, shape (m,)."""
        return np.array(self._parts.state.learner.theta)

    @property
    def estimate(self) -> dict[str, float]:
        """θ̂ by parameter name."""
        return dict(zip(self.arm.parameters, self.theta.tolist()))

    @property
    def stack(self) -> AnyHistory:
        """The recorded pairs, with ``rank`` and ``sigma_min``."""
        return self._parts.history

    @property
    def rank(self) -> int:
        """Rank of the history stack; θ̂ converges once it is m (Theorem 1)."""
        return self.stack.rank

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Names of the parameters that the recorded pairs do not determine; see `undetermined`."""
        return undetermined(self.stack.gram, self.arm.parameters, rank=self.rank)

    @checked_call
    def predict(self, q: Any, qd: Any, qdd: Any) -> np.ndarray:
        """Return the torque of a motion under θ̂, shape like ``q`` [N·m].

        Where q̈ is not measured, ``identify(log, arm).prediction`` compares filtered torques.

        Args:
            q: Positions, shape (n,) or (N, n) [rad]; of one joint also (N,), or a number.
            qd: Velocities, likewise [rad/s].
            qdd: Accelerations, likewise [rad/s²].

        Raises:
            ParameterError: an array has another shape.
        """
        return inverse_dynamics(self.arm, self.theta, q, qd, qdd)

    def snapshot(self) -> Snapshot:
        """Return what :func:`write_estimate` writes, to be used in any thread."""
        stack = self.stack
        return Snapshot(self.arm.parameters, self.theta, stack.rank, stack.sigma_min,
                        stack.insertions)

    # -- how it is learned ----------------------------------------------------------------------

    @property
    def pair(self) -> FilteredPair:
        """A copy of the present filtered regressor (n, m) and torque (n,) [N·m]."""
        present = self._parts.state.pair.filter
        return FilteredPair(present.regressor.copy(), present.torque.copy())

    @property
    def memory(self) -> float:
        """How long the filters remember a sample [s]."""
        return self._parts.memory

    @property
    def settled(self) -> bool:
        """Whether the filters have forgotten their start (see ``settings.filter.settle``).

        They have not either after a joint was at a position limit of the arm.
        """
        return uncompiled(has_settled)(self._parts.state.pair)

    @property
    def at_limit(self) -> int:
        """How many samples had a joint at a position limit of the arm."""
        return int(self._parts.state.pair.counts[AT_LIMIT])

    @property
    def updates(self) -> int:
        """How many samples have advanced θ̂: neither dropped nor the first after a restart."""
        return int(self._parts.state.pair.counts[UPDATES])

    @property
    def restarts(self) -> int:
        """How often the filters restarted after a gap or a clock jump; the first start counts."""
        return int(self._parts.state.pair.counts[RESTARTS])

    @property
    def dropped(self) -> dict[str, int]:
        """Samples not used, by reason.

        ``not finite``, ``too large`` (the filters then restart), ``stamp repeated`` and
        ``stamp went back``.
        """
        counts = self._parts.state.pair.counts
        return {reason: int(counts[index]) for reason, index in _DROPPED.items()}

    @property
    def monitor(self) -> ChangeMonitor:
        """What finds that the recorded pairs contradict present data."""
        return self._parts.monitor

    @property
    def changes(self) -> int:
        """How often the arm was found to be another one, so that the history was emptied."""
        return int(self._parts.state.pair.counts[CHANGES])

    @property
    def response(self) -> str:
        """What is being done about a contradiction, one of `STATES`; see `change_response`."""
        return STATES[self._parts.response.counts[STATE]]

    @property
    def found(self) -> dict[str, int]:
        """How often the recorded pairs were contradicted, and what the reason was found to be.

        ``alarms`` with `ChangeSettings.suspicion` only, ``contacts``, ``loads``, and ``changes``
        of the arm after which the history was emptied.
        """
        counts = self._parts.response.counts
        return {'alarms': int(counts[ALARMS]), 'contacts': int(counts[CONTACTS]),
                'loads': int(counts[LOADS]), 'changes': self.changes}

    @property
    def external_torque(self) -> ExternalTorque | None:
        """What is measured beyond what the recorded pairs predict; None with a plug-in monitor."""
        monitor = self._parts.monitor
        return monitor.external_torque if isinstance(monitor, ResidualMonitor) else None

    @property
    def artificial_noise(self) -> bool:
        """Whether θ̂ is learned from pairs with artificial noise (Remark 3), which biases it."""
        return self._parts.artificial_noise

    @property
    def excitation(self) -> float | None:
        """Persistence-of-excitation index γ of (21); None where switched off."""
        return self._parts.excitation.index

    @property
    def state(self) -> IdentifierState | None:
        """What `identifier_step` takes beside `arm_arrays`; None where a part is in Python.

        The identifier shares the arrays: it knows what a step has done. Another one is there
        after a retune and after :meth:`reset_history`.
        """
        return self._parts.state if self._parts.compiled else None
