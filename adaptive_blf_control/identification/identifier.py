# SPDX-License-Identifier: Apache-2.0
"""The identifier: joint states in, parameter estimate and history stack out."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.arms.arm import Arm, checked_arm
from adaptive_blf_control.arms.inverse_dynamics import inverse_dynamics
from adaptive_blf_control.arrays import checked_array, checked_number
from adaptive_blf_control.compiled import all_finite, jit
from adaptive_blf_control.identification.change_monitor import ChangeMonitor
from adaptive_blf_control.identification.determination import undetermined
from adaptive_blf_control.identification.excitation import Excitation
from adaptive_blf_control.identification.given_parameters import given_parameters
from adaptive_blf_control.identification.history_stack import HistoryStack
from adaptive_blf_control.identification.recorded_noise import NoisyHistory
from adaptive_blf_control.identification.settings import IdentifierSettings
from adaptive_blf_control.identification.state_filter import StateFilter
from adaptive_blf_control.identification.torque_filter import TorqueFilter
from adaptive_blf_control.identification.update_laws import (
    Evidence,
    foreign_update_law,
    make_update_law,
    UpdateLaw,
)

__all__ = ['Identifier', 'IdentifierSettings', 'Snapshot']

# Filtered regressors (rad/s², rad²/s², m/s² and the like) and torques [N·m] of a robot stay far
# below this; the squares of what does not would drown the update law in rounding.
LARGEST = 1e6


@jit
def _finite_sample(q: np.ndarray, qd: np.ndarray, tau: np.ndarray) -> bool:
    return bool(np.isfinite(q).all() and np.isfinite(qd).all() and np.isfinite(tau).all())


@jit
def _usable(regressor: np.ndarray, torque: np.ndarray) -> bool:
    return bool((np.abs(regressor) < LARGEST).all() and (np.abs(torque) < LARGEST).all())


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
        stack: The history stack with ``rank`` and ``sigma_min``.
        restarts: How often the filter started anew after a gap or a clock jump.
        monitor: Notices when the recorded pairs contradict present data.
        dropped: Samples not used, by reason: ``not finite``, ``too large`` (the filter then
            starts anew), ``stamp repeated``, ``stamp went back``.
    """

    def __init__(self, arm: Arm, settings: IdentifierSettings | None = None,
                 update_law: UpdateLaw | type[UpdateLaw] | str | None = None,
                 **changes: Any) -> None:
        """Start from ``settings.initial_estimate`` with an empty stack.

        Args:
            arm: The arm whose parameters are learned.
            settings: Gains, filters, history and monitors. Where none are given, the defaults
                with a history of at least two pairs for each parameter.
            update_law: In place of the update law that the settings name: one, a class of them,
                which is called with the settings, or a name.
            changes: Settings by name: ``kt=1.0``, ``history={'size': 200}``,
                ``**{'history.size': 200}``.

        Raises:
            ParameterError: a setting is not known, cannot be used or does not fit the arm.
        """
        self.arm = checked_arm('arm', arm)
        if settings is None:
            usual = IdentifierSettings()
            settings = usual.replace(**{'history.size': max(usual.history.size, 2 * arm.m)})
        if isinstance(update_law, str):
            changes['update_law'] = update_law
        settings = IdentifierSettings.taken(settings, changes)
        start = given_parameters('identifier.initial_estimate', settings.initial_estimate, arm)
        settings = settings.replace(initial_estimate=start).resolved(joints=arm.n,
                                                                     parameters=arm.m)
        self._given_law = None if isinstance(update_law, str) else update_law
        self._n = (arm.n,)
        self._take(settings)
        self.theta = start
        self.stack = HistoryStack(arm.n, arm.m, settings.history.size, settings.history.epsilon,
                                  settings.history.minimum_growth)
        self._filter = TorqueFilter(arm.n, arm.m, settings.filter.time_constant,
                                    settings.filter.gap)
        self._state_filter = _state_filter(settings)
        self.monitor = ChangeMonitor(arm.n, settings.change.window, settings.change.threshold,
                                     settings.change.resolution)
        self._excitation = Excitation(arm.m, settings.excitation.window)
        self._noisy = self._new_noisy_history()
        self._no_term = np.zeros(arm.m)
        self._t: float | None = None
        self._age = 0.0
        self.restarts = 0
        self.dropped = {'not finite': 0, 'too large': 0, 'stamp repeated': 0,
                        'stamp went back': 0}

    def _take(self, settings: IdentifierSettings) -> None:
        self._settings = settings
        self._law = (make_update_law(settings) if self._given_law is None else
                     foreign_update_law('update_law', self._given_law, self._given_law, settings))

    @property
    def settings(self) -> IdentifierSettings:
        """The present settings; :meth:`retune` changes them."""
        return self._settings

    def retune(self, settings: IdentifierSettings) -> None:
        """Take over other settings between two samples, all or none.

        θ̂ and the recorded pairs stay whatever changes. The torque filter goes on through a change
        of ``time_constant``. Another state filter is a new one: both filters start anew with the
        next sample, and settle. A smaller ``size`` is reached over the next samples, see
        `HistoryStack.resize`. The excitation index begins anew with another window, the mean of
        the change monitor with another of its own, fabricated pairs with another noise or seed.
        ``initial_estimate`` is history: the one given is not looked at.

        Raises:
            ParameterError: a value cannot be used; nothing has changed.
        """
        old = self._settings
        settings = IdentifierSettings.taken(
            settings, {'initial_estimate': old.initial_estimate})
        # Checks every value before anything changes.
        fresh = Identifier(self.arm, settings, self._given_law)
        self._take(fresh.settings)
        self._filter.retune(settings.filter.time_constant, settings.filter.gap)
        self.monitor.retune(settings.change.window, settings.change.threshold,
                            settings.change.resolution)
        history, before = settings.history, old.history
        self.stack.retune(history.size, history.epsilon, history.minimum_growth)
        if settings.excitation.window != old.excitation.window:
            self._excitation = fresh._excitation
        if (history.noise, history.noise_seed) != (before.noise, before.noise_seed):
            self._noisy = fresh._noisy if self.stack.rank < self.arm.m else None
        elif self._noisy is not None:
            self._noisy.stack.retune(history.size, history.epsilon, history.minimum_growth)
        if ((settings.filter.state_order, settings.filter.state_time_constant)
                != (old.filter.state_order, old.filter.state_time_constant)):
            self._state_filter = fresh._state_filter
            self._reset_filters()

    def snapshot(self) -> Snapshot:
        """Return what :func:`write_estimate` writes, to be used in any thread."""
        stack = self.stack
        return Snapshot(self.arm.parameters, self.theta, stack.rank, stack.sigma_min,
                        stack.insertions)

    def warm_up(self) -> None:
        """Compile everything that runs, or may be switched on, on throw-away identifiers."""
        settings = self.settings.replace(**{
            'history.size': self.arm.m, 'filter.settle': 0.0, 'filter.gap': 1.0,
            'change.window': max(self.settings.change.window, 1e-3),
            'excitation.window': max(self.settings.excitation.window, 1e-3)})
        random = np.random.default_rng(0)
        for order in {0, 2, settings.filter.state_order}:
            spare = Identifier(self.arm, settings.replace(**{'filter.state_order': order}),
                               self._given_law)
            for k in range(spare.stack.size + 5):
                q, qd, tau = random.normal(size=(3, self.arm.n))
                spare.update(k * 1e-3, q, qd, tau)

    def __repr__(self) -> str:
        """Show what has been learned."""
        return (f'<Identifier of {self.arm!r}: rank {self.rank} of {self.arm.m}, '
                f'{self.stack.count} of {self.stack.size} pairs>')

    @property
    def rank(self) -> int:
        """Rank of the history stack; θ̂ converges once it is m (Theorem 1)."""
        return self.stack.rank

    @property
    def estimate(self) -> dict[str, float]:
        """θ̂ by parameter name."""
        return dict(zip(self.arm.parameters, self.theta.tolist()))

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

    @property
    def pair(self) -> tuple[np.ndarray, np.ndarray]:
        """Present filtered regressor (n, m) and torque (n,) [N·m]."""
        return self._filter.pair

    @property
    def excitation(self) -> float | None:
        """Persistence-of-excitation index γ of (21); None where switched off."""
        return self._excitation.index

    @property
    def fabricating(self) -> bool:
        """Whether θ̂ is learned from pairs with noise on them (Remark 3)."""
        return self._noisy is not None and self._noisy.fabricated > 0

    @property
    def settled(self) -> bool:
        """Whether the filter has forgotten its start (see ``settings.filter.settle``)."""
        settings = self.settings.filter
        return self._age >= settings.settle * settings.memory

    def restart(self) -> None:
        """Start the filter anew with the next sample; θ̂ and the stack stay."""
        self._reset_filters()
        self._t = None

    def _reset_filters(self) -> None:
        self._filter.reset()
        if self._state_filter is not None:
            self._state_filter.reset()
        self._age = 0.0

    def reset_history(self) -> None:
        """Empty the history stack; θ̂ stays."""
        self.stack.clear()
        self._noisy = self._new_noisy_history()
        self.monitor.reset()

    def _new_noisy_history(self) -> NoisyHistory | None:
        history = self.settings.history
        if history.noise == 0.0:
            return None
        return NoisyHistory(self.arm.n, self.arm.m, history.size, history.epsilon, history.noise,
                            history.noise_seed)

    def observe(self, t: float, q: np.ndarray, qd: np.ndarray, tau: np.ndarray) -> float:
        """Filter one sample without learning from it.

        Args:
            t: Time of the sample [s].
            q: Positions, shape (n,) [rad].
            qd: Velocities, shape (n,) [rad/s].
            tau: Mean torque over the interval that ends at ``t``, shape (n,) [N·m].

        Returns:
            The interval [s] the filter advanced by; 0 where it (re)started or dropped the sample.
        """
        arm = self.arm
        t = checked_number('t', t)
        q = checked_array('q', q, self._n, arm.joints)
        qd = checked_array('qd', qd, self._n, arm.joints)
        tau = checked_array('tau', tau, self._n, arm.joints)
        if not (math.isfinite(t) and _finite_sample(q, qd, tau)):
            self.dropped['not finite'] += 1
            return 0.0
        dt = 0.0 if self._t is None else t - self._t
        if self._t is not None and dt <= 0.0:
            if dt > -self.settings.filter.gap:
                self.dropped['stamp repeated' if dt == 0.0 else 'stamp went back'] += 1
                return 0.0
            self._reset_filters()  # the clock jumped back: begin again on the new one
        elif dt > self.settings.filter.gap:
            self._reset_filters()
        self._t = t
        if self._state_filter is not None:
            q, qd, tau = self._state_filter.update(dt, q, tau)
        advanced = self._filter.update(dt, *self.arm.Y12(q, qd), tau)
        if not advanced:
            self.restarts += 1
            self._age = 0.0
            return 0.0
        if not _usable(*self._filter.pair):  # the filter would carry it on for ever
            self.dropped['too large'] += 1
            self.restart()
            return 0.0
        self._age += dt
        return dt

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
            regressor, torque = self._filter.pair
            try:
                if self.settled:
                    self._watch(dt, regressor, torque)
                if self.settled:  # no longer where a change was just found
                    self._record(regressor, torque)
            except np.linalg.LinAlgError:  # a pair that LAPACK cannot judge is not recorded
                self.dropped['not finite'] += 1
            self._excitation.update(dt, regressor)
            self._step(dt, regressor, torque, term)
        return self.theta

    def _watch(self, dt: float, regressor: np.ndarray, torque: np.ndarray) -> None:
        """Let go of the recorded pairs when they contradict present data."""
        stack = self.stack
        whole = stack.full and not stack.shrinking and stack.rank == self.arm.m
        if self.settings.change.window > 0.0 and whole:
            self.monitor.learn(stack.regressors, stack.torques, stack.gram, stack.moment,
                               stack.revision)
            if self.monitor.update(dt, regressor, torque):
                stack.clear()
                self._age = 0.0  # the filters still remember the arm of before

    def _record(self, regressor: np.ndarray, torque: np.ndarray) -> None:
        self.stack.offer(regressor, torque)
        if self._noisy is not None:
            self._noisy.offer(regressor, torque)
            if self.stack.rank == self.arm.m:
                self._noisy = None

    def _step(self, dt: float, regressor: np.ndarray, torque: np.ndarray,
              adaptation_term: np.ndarray) -> None:
        stack = self.stack if self._noisy is None else self._noisy.stack
        evidence = Evidence(regressor, torque, self.settled, stack.gram, stack.moment,
                            adaptation_term)
        try:
            theta = self._law.step(self.theta, dt, evidence)
        except np.linalg.LinAlgError:  # not finite (numba), or singular by overflow
            theta = np.full_like(self.theta, math.nan)
        if all_finite(theta):
            self.theta = theta
        else:  # overflow of absurd data: keep the last good estimate
            self.dropped['not finite'] += 1


def _state_filter(settings: IdentifierSettings) -> StateFilter | None:
    order = settings.filter.state_order
    return StateFilter(order, settings.filter.state_time_constant) if order else None
