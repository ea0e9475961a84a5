# SPDX-License-Identifier: Apache-2.0
"""What a measured log is once it has been read: q, qd and tau over time, by joint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
import functools
from typing import Any, NoReturn

import numpy as np

from adaptive_blf_control.arrays import checked_array, joint_places
from adaptive_blf_control.errors import (
    LogError,
    no_array,
    ParameterError,
    UnknownParameter,
    with_hints,
)
from adaptive_blf_control.spelling import spelled

__all__ = ['MeasuredLog']

_NOT_THERE = {
    'duration': 't[-1] - t[0]', 'n': 'len(joints)', 'names': 'joints has the names',
    **dict.fromkeys(('rate', 'dt', 'fs', 'frequency', 'sample_rate', 'period'),
                    'numpy.median(numpy.diff(t)) is the usual interval'),
    **dict.fromkeys(('size', 'shape', 'samples', 'N'), 'len(t) samples'),
    **dict.fromkeys(('plot', 'show'), 'matplotlib draws arrays: plt.plot(log.t, log.tau)'),
    **dict.fromkeys(('save', 'to_csv', 'to_npz', 'to_dataframe'),
                    "numpy.savez('log.npz', t=log.t, q=log.q, qd=log.qd, tau=log.tau); "
                    'read_log reads it'),
    **dict.fromkeys(('cut', 'between', 'rows', 'slice', 'crop', 'trim', 'span'),
                    'log.q[100:200] are rows of one array, identify(log, train=(1.0, 5.0), '
                    'test=(5.0, 9.0)) chooses spans'),
    'qdd': 'no acceleration is measured or needed; numpy.gradient(log.qd, log.t, axis=0) '
           'approximates it'}


@functools.partial(with_hints, instead=_NOT_THERE)
@dataclass(frozen=True, repr=False, eq=False)
class MeasuredLog:
    """A log of N rows for n joints; all finite, times strictly increasing.

    ``len(log)`` is N; ``log.q[100:200]`` are rows of one array.

    Attributes:
        joints: Joint names.
        t: Time from the first row on, shape (N,) [s].
        q: Positions, shape (N, n) [rad].
        qd: Velocities, shape (N, n) [rad/s]; zeros where `measured_velocity` is false.
        tau: Joint torques, shape (N, n) [N·m].
        dropped: Rows left out: a value not finite, a time not after the row before or far from
            its neighbours, or a message without these joints.
        problem: Why the source ends early (a truncated bag), or None.
        notes: What was assumed or is odd, in sentences.
        breaks: Rows at which the clock was set back: filters restart there.
        measured_velocity: Whether velocities were read.
        named: Whether the joints have names of their own; else ``joint1``, ... stand for them,
            and an arm with as many joints takes them in their order.
    """

    joints: tuple[str, ...]
    t: np.ndarray
    q: np.ndarray
    qd: np.ndarray
    tau: np.ndarray
    dropped: int
    problem: str | None = None
    notes: tuple[str, ...] = ()
    breaks: tuple[int, ...] = ()
    measured_velocity: bool = True
    named: bool = True

    def __new__(cls, *values: Any, **named: Any) -> MeasuredLog:
        """Refuse arrays alone, with what makes a log of them; a copy gives nothing here."""
        needed = ('joints', 't', 'q', 'qd', 'tau', 'dropped')
        if (values or named) and not set(needed[len(values):]) <= set(named) or (
                values and isinstance(values[0], np.ndarray)):
            raise LogError("read_log({'t': t, 'q': q, 'qd': qd, 'tau': tau}) makes a log of "
                           'arrays; identify and learn take such a dictionary itself')
        return super().__new__(cls)

    def __len__(self) -> int:
        """Return N, the number of rows."""
        return len(self.t)

    def __array__(self, *_: Any, **__: Any) -> NoReturn:
        """Raise TypeError: a log is several arrays."""
        raise no_array(self)

    def __getitem__(self, key: Any) -> NoReturn:
        """Raise LogError: neither a field nor a row has a number, so that none is mistaken."""
        raise LogError(f'a log has no [{key!r}] and cannot be unpacked: log.t, log.q, log.qd and '
                       'log.tau are its arrays, log.q[100:200] rows of one of them, '
                       'identify(log, train=(1.0, 5.0)) chooses a span')

    def replace(self, **changes: Any) -> MeasuredLog:
        """Return a copy with other attributes, by name: ``log.replace(tau=2.0 * log.tau)``.

        Arrays of another number of rows are given together: t, q, qd and tau.

        Raises:
            ParameterError: a log has no attribute of such a name, or a value does not fit the
                rest: its shape, its names, a time that does not rise, a value that is not finite.
        """
        names = [item.name for item in fields(self)]
        for name, value in changes.items():
            if name not in names:
                raise UnknownParameter(name, value, names)
        joints = changes.get('joints', self.joints)
        if (not isinstance(joints, (list, tuple))
                or not all(isinstance(name, str) for name in joints)
                or not 0 < len(set(joints)) == len(tuple(joints))):
            raise ParameterError('joints', joints, 'different names, one for each joint')
        changes['joints'] = joints = tuple(joints)
        if 't' in changes:
            changes['t'] = _rising(checked_array('t', changes['t'], (-1,)))
            if len(changes['t']) != len(self):  # these are other rows
                changes.setdefault('breaks', ())
        shape = (len(changes.get('t', self.t)), len(joints))
        for name in ('q', 'qd', 'tau'):
            if name not in changes and getattr(self, name).shape != shape:
                raise ParameterError(name, _AsItIs(getattr(self, name).shape), f'to be given as '
                                     f'well, with shape {shape}')
            if name in changes:
                changes[name] = _finite(name, checked_array(name, changes[name], shape, joints))
        return self.with_fitting(**changes)

    def with_fitting(self, **changes: Any) -> MeasuredLog:
        """Return a copy with other attributes that are known to fit; :meth:`replace` checks."""
        return replace(self, **changes)

    def of_joints(self, joints: Sequence[str]) -> MeasuredLog:
        """Return the log of these joints, in this order.

        Joints without names of their own get these, in their order, where there are as many.

        Args:
            joints: Their names.

        Raises:
            LogError: it has no joint of one of these names.
        """
        names = tuple(joints)
        if names == self.joints:
            return self
        places = joint_places(names, self.joints)
        if places is None and not self.named and len(set(names)) == len(self.joints):
            return self.with_fitting(joints=names, named=True)
        if places is None:
            raise LogError(f'log: {self._without(names)}')
        q, qd, tau = (np.ascontiguousarray(values[:, places])
                      for values in (self.q, self.qd, self.tau))
        return self.with_fitting(joints=names, q=q, qd=qd, tau=tau)

    def _without(self, joints: Sequence[str]) -> str:
        """Return what is said of joints that the log does not have."""
        if not self.named:
            return (f'its {len(self.joints)} joints have no names by which to find '
                    f'{", ".join(joints)}: ' + spelled(
                        'read_log(file, joints=[...]) names all of them, in their order',
                        'its columns may have them, as in q_NAME'))
        missing = next(name for name in joints if joint_places([name], self.joints) is None)
        return f'no joint {missing!r}: it has {", ".join(self.joints)}' + spelled(
            '; read_log(file).replace(joints=arm.joints) gives them other names, in their order',
            '')

    def __repr__(self) -> str:
        """Show samples, joints, span and rate, and what is missing."""
        span = float(self.t[-1] - self.t[0])
        rate = 1.0 / float(np.median(np.diff(self.t)))
        names = ', '.join(self.joints)
        return (f'<MeasuredLog: {len(self.t)} samples of {len(self.joints)} joints ({names}), '
                f'{span:.4g} s at {rate:.4g} Hz'
                + (f', {self.dropped} rows left out' if self.dropped else '')
                + ('' if self.measured_velocity else ', without velocities')
                + (f', {self.problem}' if self.problem else '') + '>')


class _AsItIs:
    """Stands in a message for an array that was left as it is."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self._shape = shape

    def __repr__(self) -> str:
        return f'left with the shape {self._shape}'


def _finite(name: str, array: np.ndarray) -> np.ndarray:
    """Return an array of a log; ParameterError names the first element that is not finite."""
    odd = np.argwhere(~np.isfinite(array))
    if len(odd):
        place = ', '.join(map(str, odd[0]))
        raise ParameterError(name, array, f'finite numbers, not {name}[{place}] = '
                             f'{array[tuple(odd[0])]}')
    return array


def _rising(t: np.ndarray) -> np.ndarray:
    """Return times of a log; ParameterError names the first that does not come after the last."""
    back = np.flatnonzero(np.diff(_finite('t', t)) <= 0.0)
    if len(back) or len(t) < 2:
        where = f', not t[{back[0] + 1}] = {t[back[0] + 1]:g} after {t[back[0]]:g}' if len(
            back) else ''
        raise ParameterError('t', t, f'at least two times that rise{where}')
    return t
