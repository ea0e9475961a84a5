# SPDX-License-Identifier: Apache-2.0
"""The identifier: joint states in, parameter estimate and history stack out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any, NamedTuple
import warnings

import numpy as np

from adaptive_blf_control.arms.arm import Arm, checked_arm
from adaptive_blf_control.arrays import (
    are_vectors,
    by_name,
    checked_array,
    checked_number,
    checked_vectors,
)
from adaptive_blf_control.calls import checked_call, without_argument
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.change_monitor import ChangeMonitor
from adaptive_blf_control.identification.given_parameters import given_parameters, values_of
from adaptive_blf_control.identification.knowledge import Knowledge
from adaptive_blf_control.identification.log_checks import LearnedLog
from adaptive_blf_control.identification.parts import AnyHistory, named, PartMaker
from adaptive_blf_control.identification.running_parts import RunningParts
from adaptive_blf_control.identification.settings import IdentifierSettings
from adaptive_blf_control.identification.state_filter import StateFilter
from adaptive_blf_control.identification.unused_log import check_order, no_sample_used
from adaptive_blf_control.identification.update_laws import check_answers, UpdateLaw
from adaptive_blf_control.identification.whole_log import breaks_of, log_arrays

__all__ = ['BLOCK', 'Identifier', 'IdentifierSettings', 'LearnedBlock']


class LearnedBlock(NamedTuple):
    """Samples of a log that were taken one after the other, B of them.

    Attributes:
        samples: Where they are in the log.
        rows: [Y_f τ_f] after each of them, shape (B, n, m + 1).
        usable: Whether the filters had advanced to that pair and were settled, shape (B,).
        recorded: Whether the history was another one after it, shape (B,).
    """

    samples: slice
    rows: np.ndarray
    usable: np.ndarray
    recorded: np.ndarray


BLOCK = 64
"""Samples of a log that are taken between two returns to Python."""


class Identifier(Knowledge, settings=IdentifierSettings, instead={
        '()': 'update(t, q, qd, tau) takes a sample, learn(t, q, qd, tau) a log',
        'copy': 'copy.deepcopy(identifier) of the standard library',
        'reset': 'reset_history empties the history, restart restarts the filters; an Identifier '
                 'that knows nothing is a new one',
        **dict.fromkeys(('publish', 'subscribe', 'spin'),
                        '`python -m adaptive_blf_control identifier` is the node'),
        **dict.fromkeys(('from_yaml', 'from_file', 'from_config'),
                        'simulate(file, 0.001).identifier is that of a parameter file'),
        **dict.fromkeys(('theta =', 'estimate ='),
                        'Identifier(arm, initial_estimate=...) starts from a given one'),
        'load': "Identifier(arm, initial_estimate='theta.yaml') starts from what was saved",
        'save': 'estimate is a dictionary by name, which json.dump writes and '
                'Identifier(arm, initial_estimate=...) takes; identify(log, arm=...).save(path) '
                'writes a file that initial_estimate=path reads'}):
    """Torque filter, history stack and update law joined: (12)-(18), Algorithm 1, (37).

    :meth:`update` takes one sample, :meth:`learn` a whole log; then ``estimate`` has θ̂ by name,
    shape (m,), ``undetermined`` what the data leave open, and :meth:`predict` gives torques [N·m].

    The defaults are for a simulation, whose filters follow fast and whose friction is viscous.
    The log of a real robot needs slower filters, a larger history and an arm with its friction,
    see ``IdentifierSettings.real_robot()``, which `identify` takes.
    """

    @checked_call
    def __init__(self, arm: Arm, settings: IdentifierSettings | None = None,
                 update_law: UpdateLaw | type[UpdateLaw] | str | None = None, *,
                 state_filter: StateFilter | type[StateFilter] | str | None = None,
                 history_stack: AnyHistory | type[AnyHistory] | str | None = None,
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
                ``**{'history.size': 200}``; ``initial_estimate`` also by parameter name, or an
                object that has such an ``estimate``, as what `identify` returns.

        Raises:
            ParameterError: a setting is not known, cannot be used or does not fit the arm, or a
                part lacks what its protocol asks for.
        """
        checked_arm('arm', arm)
        if settings is None:
            usual = IdentifierSettings()
            settings = usual.replace(**{'history.size': max(usual.history.size, 2 * arm.m)})
        start = changes.get('initial_estimate')
        start = by_name(getattr(start, 'estimate', start))  # of another identifier, or of a log
        if isinstance(start, Mapping):
            changes['initial_estimate'] = values_of('initial_estimate', start, arm)
        given, names = named({'update_law': update_law, 'state_filter': state_filter,
                              'history_stack': history_stack, 'change_monitor': change_monitor})
        settings = IdentifierSettings.taken(settings, {**changes, **names}, of_any_arm=True)
        settings = settings.replace(initial_estimate=given_parameters(
            'identifier.initial_estimate', settings.initial_estimate, arm))
        self._settings = settings.resolved(joints=arm.n, parameters=arm.m)
        self._given = given
        super().__init__(arm, RunningParts(PartMaker(arm, given), self._settings))
        self._n = (arm.n,)
        self._no_term = np.zeros(arm.m)
        self._learned: LearnedLog | None = None

    @property
    def settings(self) -> IdentifierSettings:
        """The present settings; :meth:`retune` changes them."""
        return self._settings

    @checked_call
    def retune(self, settings: IdentifierSettings | None = None, **changes: Any) -> None:
        """Use other settings from the next sample on, all or none of them.

        θ̂ and the recorded pairs stay whatever changes. The torque filter goes on through a change
        of ``time_constant``. Another state filter is a new one: both filters restart with the next
        sample, and settle. A smaller ``size`` is reached over the next samples, see
        `HistoryStack.resize`; another selection is offered the pairs recorded so far. The
        excitation index restarts with another window, the mean of the change monitor with another
        window of its own, artificial noise with another deviation or seed. ``initial_estimate``
        is history: the one given is not looked at.

        Args:
            settings: The new ones; the present ones where None.
            changes: Settings by name, as the constructor takes them: ``kt=5.0``.

        Raises:
            ParameterError: a value cannot be used; nothing has changed.
        """
        settings = IdentifierSettings.taken(
            self._settings if settings is None else settings,
            {**changes, 'initial_estimate': self._settings.initial_estimate})
        settings = settings.resolved(joints=self.arm.n, parameters=self.arm.m)
        self._parts.retune(settings)
        self._settings = settings

    def warm_up(self, log: bool = False) -> None:
        """Compile everything that runs, or may be switched on, on a throw-away identifier.

        Parts that were given as objects are left alone.

        Args:
            log: What :meth:`learn` runs, in place of what :meth:`update` does.
        """
        settings = self.settings.replace(**{
            'history.size': self.arm.m, 'filter.settle': 0.0, 'filter.gap': 1.0,
            'change.window': max(self.settings.change.window, 1e-3),
            'excitation.window': max(self.settings.excitation.window, 1e-3)})
        parts = self._given.reusable()._asdict()
        count, joints = settings.history.size + 5, self.arm.n
        random = np.random.default_rng(0)
        t, samples = 1e-3 * np.arange(count), random.normal(size=(3, count, joints))
        spare = Identifier(self.arm, settings, **parts)
        if log:
            for _ in spare.learn_in_blocks(t, *samples):
                pass
            return
        for k in range(count):
            spare.update(t[k], *samples[:, k])
        spare.retune(history={'size': max(spare.stack.count - 1, 1)})

    def restart(self) -> None:
        """Restart the filters with the next sample; θ̂ and the stack stay."""
        self._parts.restart()

    def reset_history(self) -> None:
        """Empty the history stack; θ̂ stays."""
        self._parts.clear()

    # -- samples --------------------------------------------------------------------------------

    @checked_call
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
        return self._parts.observe(*self._checked(t, q, qd, tau))

    def _checked(self, t: float, q: np.ndarray, qd: np.ndarray, tau: np.ndarray,
                 ) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
        t = checked_number('t', t)
        if not are_vectors(self._n, q, qd, tau):
            q, qd, tau = checked_vectors(self.arm.joints, q=q, qd=qd, tau=tau)
        return t, q, qd, tau

    @checked_call
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
            'adaptation_term', adaptation_term, self._no_term.shape, self.arm.parameters)
        t, q, qd, tau = self._checked(t, q, qd, tau)
        return self.take(t, q, qd, tau, term).copy()

    def take(self, t: float, q: np.ndarray, qd: np.ndarray, tau: np.ndarray,
             term: np.ndarray | None) -> np.ndarray:
        """Take a sample as :meth:`update` does; θ̂ is in an array that the next one changes.

        For a node, whose arrays are known to be right: nothing is checked.

        Args:
            t: Time of the sample [s].
            q: Positions, shape (n,) [rad]; contiguous float64, as the other arrays.
            qd: Velocities, shape (n,) [rad/s].
            tau: Mean torque over the interval that ends at ``t``, shape (n,) [N·m].
            term: Xᵀe2 held over that interval, shape (m,), None for zero.
        """
        self._intervals.take(t, self._settings.filter.gap)
        self._parts.take(t, q, qd, tau, self._no_term if term is None else term)
        theta: np.ndarray = self._parts.state.learner.theta
        return theta

    @checked_call
    def learn(self, t: Any, q: Any = None, qd: Any = None, tau: Any = None) -> np.ndarray:
        """Take a whole log, one sample after the other, as :meth:`update` does.

        The usual settings are those of a simulation. The log of a real robot is learned from, and
        checked before, by `identify`, whose settings are ``IdentifierSettings.real_robot()``.
        Here a log that `identify` would refuse makes a warning; ``notes`` has all that is odd.

        Args:
            t: Times, shape (N,) [s]; or, alone, a log that has all four: a mapping with arrays
                t, q, qd and tau, what `read_log` returns, whose joints are put in the order of
                the arm's, or a run of `simulate`. Where the clock of a log was set back the
                filters restart.
            q: Positions, shape (N, n) [rad].
            qd: Velocities, shape (N, n) [rad/s].
            tau: Mean torques over the intervals that end at ``t``, shape (N, n) [N·m].

        Returns:
            θ̂ after the last sample, shape (m,).

        Raises:
            ParameterError: an array has another shape, the samples are not in the order of
                time, no two follow each other so that the filter can take them, or no position
                is within the limits of the arm.
            LogError: the joints of the log have other names than those of the arm.
        """
        breaks: tuple[int, ...] = ()
        if q is None and qd is None and tau is None:
            log, breaks = log_arrays(t, self.arm.joints), breaks_of(t)
            if log is None:
                raise without_argument(Identifier.learn, 'q')
            t, q, qd, tau = log
        for name, value in (('q', q), ('qd', qd), ('tau', tau)):
            if value is None:
                raise without_argument(Identifier.learn, name)
        check_order(t)
        q, qd, tau = (checked_array(name, value, (len(t), self.arm.n), self.arm.joints)
                      for name, value in (('q', q), ('qd', qd), ('tau', tau)))
        unused, beyond = self.restarts + sum(self.dropped.values()), self.at_limit
        for begin, end in pairwise((0, *breaks, len(t))):
            if begin:
                self.restart()
            for _ in self.learn_in_blocks(*(each[begin:end] for each in (t, q, qd, tau))):
                pass
        unused = self.restarts + sum(self.dropped.values()) - unused
        if unused >= len(t):
            check_answers(self._parts.law, self.dropped['not finite'], q, qd, tau)
            raise no_sample_used(t, self.settings.filter.gap, q=q, qd=qd, tau=tau)
        largest = float(np.nanmax(np.abs(np.asarray(q, dtype=float)), initial=0.0))
        if self.at_limit - beyond == len(t) and largest > 2.0 * np.pi:
            raise ParameterError('q', f'up to {largest:.4g}', 'positions in rad: no sample is '
                                 'within the limits of the arm; are they in degrees? '
                                 'np.deg2rad(q) and np.deg2rad(qd) are radians')
        self._learned = LearnedLog(self.arm, self.settings, t, q, qd, tau, breaks=breaks)
        if self._learned.refused:
            warnings.warn('the log that was learned from cannot be right: '
                          + '; '.join(self._learned.refused), stacklevel=3)
        return self._present_theta()

    @property
    def _odd(self) -> bool:
        return super()._odd or (self._learned is not None and bool(self._learned.found))

    @property
    def notes(self) -> tuple[str, ...]:
        """What is odd about the samples, or the log that was learned from last, in sentences.

        A log is checked as `identify` does; what takes a model is looked at when it is asked for.
        """
        log = () if self._learned is None else self._learned.findings
        return (*super().notes, *map(str, log))

    def learn_in_blocks(self, t: Any, q: Any, qd: Any, tau: Any, learning: Any = True,
                        size: int = BLOCK) -> Iterator[LearnedBlock]:
        """Take a whole log as :meth:`learn` does, and show what its samples gave.

        Args:
            t: Times, shape (N,) [s].
            q: Positions, shape (N, n) [rad].
            qd: Velocities, shape (N, n) [rad/s].
            tau: Mean torques over the intervals that end at ``t``, shape (N, n) [N·m].
            learning: Whether it is learned from a sample, which else is only filtered; one for
                all, or shape (N,).
            size: Samples in a block.

        Yields:
            The blocks in their order, each once its samples have been taken.

        Raises:
            ParameterError: an array has another shape.
        """
        n, m = self.arm.n, self.arm.m
        times = checked_array('t', t, (-1,))
        q, qd, tau = (checked_array(name, value, (len(times), n), self.arm.joints)
                      for name, value in (('q', q), ('qd', qd), ('tau', tau)))
        chosen = np.array(np.broadcast_to(np.asarray(learning, dtype=bool), times.shape))
        for begin in range(0, len(times), size):
            some = slice(begin, begin + size)
            count = len(times[some])
            block = LearnedBlock(some, np.empty((count, n, m + 1)), np.empty(count, dtype=bool),
                                 np.empty(count, dtype=bool))
            self._parts.take_all(times[some], q[some], qd[some], tau[some], self._no_term,
                                 chosen[some], block.rows, block.usable, block.recorded)
            yield block
