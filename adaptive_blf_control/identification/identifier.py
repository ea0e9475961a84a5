# SPDX-License-Identifier: Apache-2.0
"""The identifier: joint states in, parameter estimate and history stack out."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.arms.arm import Arm, checked_arm
from adaptive_blf_control.arms.inverse_dynamics import inverse_dynamics
from adaptive_blf_control.arrays import checked_array, checked_number
from adaptive_blf_control.compiled import all_finite
from adaptive_blf_control.identification.change_monitor import ChangeMonitor
from adaptive_blf_control.identification.determination import undetermined
from adaptive_blf_control.identification.excitation import Excitation
from adaptive_blf_control.identification.history import History
from adaptive_blf_control.identification.pair_filter import PairFilter
from adaptive_blf_control.identification.parts import named, PartMaker
from adaptive_blf_control.identification.recorded_pairs import RecordedPairs
from adaptive_blf_control.identification.settings import IdentifierSettings
from adaptive_blf_control.identification.state_filter import StateFilter
from adaptive_blf_control.identification.update_laws import Evidence, UpdateLaw

__all__ = ['Identifier', 'IdentifierSettings', 'Snapshot']


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


class Identifier:
    """Torque filter, history stack and update law joined: (12)-(18), Algorithm 1, (37).

    Attributes:
        theta: θ̂, shape (m,); replaced, never changed in place.
    """

    def __init__(self, arm: Arm, settings: IdentifierSettings | None = None,
                 update_law: UpdateLaw | type[UpdateLaw] | str | None = None, *,
                 state_filter: StateFilter | type[StateFilter] | str | None = None,
                 history_stack: History | type[History] | str | None = None,
                 change_monitor: ChangeMonitor | type[ChangeMonitor] | str | None = None,
                 **changes: Any) -> None:
        """Start from ``settings.initial_estimate`` with an empty stack.

        Each part may be given in place of the one that the settings name: as an object, as a name
        or as a class, which is called with the settings (an update law) or with the arm and the
        settings (the others).

        Args:
            arm: The arm whose parameters are learned.
            settings: Gains, filters, history and monitors. Where none are given, the defaults
                with a history of at least two pairs for each parameter.
            update_law: What moves θ̂.
            state_filter: What filters the measured state.
            history_stack: What records pairs.
            change_monitor: What finds that the arm has changed.
            changes: Settings by name: ``kt=1.0``, ``history={'size': 200}``,
                ``**{'history.size': 200}``.

        Raises:
            ParameterError: a setting is not known, cannot be used or does not fit the arm, or a
                part lacks what its protocol asks for.
        """
        self.arm = checked_arm('arm', arm)
        if settings is None:
            usual = IdentifierSettings()
            settings = usual.replace(**{'history.size': max(usual.history.size, 2 * arm.m)})
        given, names = named({'update_law': update_law, 'state_filter': state_filter,
                              'history_stack': history_stack, 'change_monitor': change_monitor})
        settings = IdentifierSettings.taken(settings, {**changes, **names})
        self._start(settings.resolved(joints=arm.n, parameters=arm.m), PartMaker(arm, given))

    def _start(self, settings: IdentifierSettings, make: PartMaker) -> None:
        arm = self.arm
        self._n = (arm.n,)
        self._make = make
        self._settings = settings
        self._law = make.update_law(settings)
        self._filter = PairFilter(arm, settings.filter, make.state_filter(settings))
        self._recorded = RecordedPairs(make, settings)
        self._excitation = Excitation(arm.m, settings.excitation.window)
        self.theta = settings.initial_estimate.copy()
        self._no_term = np.zeros(arm.m)

    @property
    def settings(self) -> IdentifierSettings:
        """The present settings; :meth:`retune` changes them."""
        return self._settings

    def retune(self, settings: IdentifierSettings) -> None:
        """Use other settings from the next sample on, all or none of them.

        θ̂ and the recorded pairs stay whatever changes. The torque filter goes on through a change
        of ``time_constant``. Another state filter is a new one: both filters restart with the next
        sample, and settle. A smaller ``size`` is reached over the next samples, see
        `HistoryStack.resize`; another selection is offered the pairs recorded so far. The
        excitation index restarts with another window, the mean of the change monitor with another
        window of its own, artificial noise with another deviation or seed. ``initial_estimate``
        is history: the one given is not looked at.

        Raises:
            ParameterError: a value cannot be used; nothing has changed.
        """
        old, make = self._settings, self._make
        settings = IdentifierSettings.taken(
            settings, {'initial_estimate': old.initial_estimate})
        settings = settings.resolved(joints=self.arm.n, parameters=self.arm.m)
        # What may be refused comes first.
        law = make.update_law(settings)
        state_filter = (make.state_filter(settings)
                        if _state_filter_of(settings) != _state_filter_of(old) else None)
        stack = (make.history(settings)
                 if settings.history.selection != old.history.selection else None)
        monitor = make.monitor(settings) if settings.change.monitor != old.change.monitor else None
        self._settings, self._law = settings, law
        self._filter.retune(settings.filter, state_filter)
        self._recorded.retune(settings, stack, monitor)
        if settings.excitation.window != old.excitation.window:
            self._excitation = Excitation(self.arm.m, settings.excitation.window)

    def snapshot(self) -> Snapshot:
        """Return what :func:`write_estimate` writes, to be used in any thread."""
        stack = self.stack
        return Snapshot(self.arm.parameters, self.theta, stack.rank, stack.sigma_min,
                        stack.insertions)

    def warm_up(self) -> None:
        """Compile everything that runs, or may be switched on, on throw-away identifiers.

        Parts that were given as objects are left alone.
        """
        settings = self.settings.replace(**{
            'history.size': self.arm.m, 'filter.settle': 0.0, 'filter.gap': 1.0,
            'change.window': max(self.settings.change.window, 1e-3),
            'excitation.window': max(self.settings.excitation.window, 1e-3)})
        parts = self._make.given.reusable()._asdict()
        random = np.random.default_rng(0)
        for order in {0, 2, settings.filter.state_order}:
            spare = Identifier(self.arm, settings.replace(**{'filter.state_order': order}),
                               **parts)
            for k in range(settings.history.size + 5):
                q, qd, tau = random.normal(size=(3, self.arm.n))
                spare.update(k * 1e-3, q, qd, tau)

    def __repr__(self) -> str:
        """Show what has been learned."""
        return (f'<Identifier of {self.arm!r}: rank {self.rank} of {self.arm.m}, '
                f'{self.stack.count} of {self.stack.size} pairs>')

    # -- what has been learned ------------------------------------------------------------------

    @property
    def estimate(self) -> dict[str, float]:
        """θ̂ by parameter name."""
        return dict(zip(self.arm.parameters, self.theta.tolist()))

    @property
    def stack(self) -> History:
        """The recorded pairs, with ``rank`` and ``sigma_min``."""
        return self._recorded.stack

    @property
    def rank(self) -> int:
        """Rank of the history stack; θ̂ converges once it is m (Theorem 1)."""
        return self.stack.rank

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Names of the parameters that the recorded pairs do not determine; see `undetermined`."""
        return undetermined(self.stack.gram, self.arm.parameters)

    def predict(self, q: Any, qd: Any, qdd: Any) -> np.ndarray:
        """Return the torque of a motion under θ̂, shape like ``q`` [N·m].

        Args:
            q: Positions, shape (n,) or (N, n) [rad].
            qd: Velocities, likewise [rad/s].
            qdd: Accelerations, likewise [rad/s²].

        Raises:
            ParameterError: an array has another shape.
        """
        return inverse_dynamics(self.arm, self.theta, q, qd, qdd)

    # -- how it is learned ----------------------------------------------------------------------

    @property
    def pair(self) -> tuple[np.ndarray, np.ndarray]:
        """Present filtered regressor (n, m) and torque (n,) [N·m]."""
        return self._filter.pair

    @property
    def memory(self) -> float:
        """How long the filters remember a sample [s]."""
        return self._filter.memory

    @property
    def settled(self) -> bool:
        """Whether the filters have forgotten their start (see ``settings.filter.settle``)."""
        return self._filter.settled

    @property
    def restarts(self) -> int:
        """How often the filters restarted after a gap or a clock jump; the first start counts."""
        return self._filter.restarts

    @property
    def dropped(self) -> dict[str, int]:
        """Samples not used, by reason.

        ``not finite``, ``too large`` (the filters then restart), ``stamp repeated`` and
        ``stamp went back``.
        """
        return self._filter.dropped

    @property
    def monitor(self) -> ChangeMonitor:
        """What finds that the recorded pairs contradict present data."""
        return self._recorded.monitor

    @property
    def changes(self) -> int:
        """How often the arm was found to have changed."""
        return self._recorded.changes

    @property
    def artificial_noise(self) -> bool:
        """Whether θ̂ is learned from pairs with artificial noise (Remark 3), which biases it."""
        return self._recorded.artificial_noise

    @property
    def excitation(self) -> float | None:
        """Persistence-of-excitation index γ of (21); None where switched off."""
        return self._excitation.index

    def restart(self) -> None:
        """Restart the filters with the next sample; θ̂ and the stack stay."""
        self._filter.restart()

    def reset_history(self) -> None:
        """Empty the history stack; θ̂ stays."""
        self._recorded.clear()

    # -- samples --------------------------------------------------------------------------------

    def observe(self, t: float, q: np.ndarray, qd: np.ndarray, tau: np.ndarray) -> float:
        """Filter one sample without learning from it.

        Args:
            t: Time of the sample [s].
            q: Positions, shape (n,) [rad].
            qd: Velocities, shape (n,) [rad/s].
            tau: Mean torque over the interval that ends at ``t``, shape (n,) [N·m].

        Returns:
            The interval [s] the filters advanced by; 0 where they (re)started or the sample was
            dropped.
        """
        joints = self.arm.joints
        return self._filter.update(checked_number('t', t),
                                   checked_array('q', q, self._n, joints),
                                   checked_array('qd', qd, self._n, joints),
                                   checked_array('tau', tau, self._n, joints))

    def update(self, t: float, q: np.ndarray, qd: np.ndarray, tau: np.ndarray,
               adaptation_term: np.ndarray | None = None) -> np.ndarray:
        """Filter one sample, offer it to the stack and advance θ̂; arguments as :meth:`observe`.

        Args:
            t: Time of the sample [s].
            q: Positions, shape (n,) [rad].
            qd: Velocities, shape (n,) [rad/s].
            tau: Mean torque over the interval that ends at ``t``, shape (n,) [N·m].
            adaptation_term: Xᵀe2 held over that interval, shape (m,), None for zero; used by the
                law ``ablf_concurrent`` only.

        Returns:
            θ̂, shape (m,).
        """
        term = self._no_term if adaptation_term is None else checked_array(
            'adaptation_term', adaptation_term, self.theta.shape, self.arm.parameters)
        dt = self.observe(t, q, qd, tau)
        if dt > 0.0:
            self._record(dt)
            self._excitation.update(dt, self._filter.pair.regressor)
            self._step(dt, term)
        return self.theta

    def _record(self, dt: float) -> None:
        recorded, pair = self._recorded, self._filter.pair
        try:
            if self.settled and recorded.contradict(dt, pair):
                self._filter.unsettle()
            if self.settled:
                recorded.offer(pair)
        except np.linalg.LinAlgError:  # a pair that LAPACK cannot judge is not recorded
            self.dropped['not finite'] += 1

    def _step(self, dt: float, adaptation_term: np.ndarray) -> None:
        evidence = Evidence(*self._filter.pair, self.settled, *self._recorded.sums(),
                            adaptation_term)
        try:
            theta = self._law.step(self.theta, dt, evidence)
        except np.linalg.LinAlgError:  # not finite (numba), or singular by overflow
            theta = np.full_like(self.theta, math.nan)
        if all_finite(theta):
            self.theta = theta
        else:  # overflow in data beyond reason: keep the last good estimate
            self.dropped['not finite'] += 1

    def learn(self, t: Any, q: Any, qd: Any, tau: Any) -> np.ndarray:
        """Take a whole log, one sample after the other, as :meth:`update` does.

        Args:
            t: Times, shape (N,) [s].
            q: Positions, shape (N, n) [rad].
            qd: Velocities, shape (N, n) [rad/s].
            tau: Mean torques over the intervals that end at ``t``, shape (N, n) [N·m].

        Returns:
            θ̂ after the last sample, shape (m,).

        Raises:
            ParameterError: an array has another shape.
        """
        times = checked_array('t', t, (-1,))
        rows = [checked_array(name, value, (len(times), self.arm.n), self.arm.joints)
                for name, value in (('q', q), ('qd', qd), ('tau', tau))]
        for sample in zip(times.tolist(), *rows):
            self.update(*sample)
        return self.theta


def _state_filter_of(settings: IdentifierSettings) -> tuple[object, ...]:
    chosen = settings.filter
    return chosen.state_filter, chosen.state_order, chosen.state_time_constant
