# SPDX-License-Identifier: Apache-2.0
"""Measured logs for identification: q, qd and tau over time, from a bag, a file or arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import os
from pathlib import Path
import re
from types import MappingProxyType
from typing import Any, Protocol
import zipfile

import numpy as np

from adaptive_blf_control.arrays import checked_array, dimensions, labels_of
from adaptive_blf_control.bags.bag_log import bag_log
from adaptive_blf_control.bags.csv_log import csv_log
from adaptive_blf_control.bags.log_clock import log_clock
from adaptive_blf_control.bags.log_conversion import Conversion, conversion
from adaptive_blf_control.bags.measured_log import MeasuredLog
from adaptive_blf_control.bags.raw_log import RawLog
from adaptive_blf_control.bags.reader import Bag, read_bag
from adaptive_blf_control.bags.row_store import keep_rows, new_table, row_blocks
from adaptive_blf_control.bags.table_log import columns_of, DataFrame, is_table, table_log
from adaptive_blf_control.calls import checked_call
from adaptive_blf_control.errors import (
    BagError,
    LogError,
    ParameterError,
    shown,
    UnknownParameter,
)
from adaptive_blf_control.spelling import option, setting
from adaptive_blf_control.synonyms import same_meaning
from adaptive_blf_control.time_units import order_problem

__all__ = ['Log', 'read_log']

MANY = 0.1  # of the rows of a log: where more are left out, a note says why
MINIMUM_ROWS = 3
_TEXTS = ('.csv', '.tsv', '.txt', '.dat', '.asc', '.log')
LOG_OPTIONS = ('topic', 'joints', 'velocity', 'columns', 'degrees', 'gain', 'effort_delay')
_TABLES = {'.xlsx': 'read_excel', '.parquet': 'read_parquet', '.json': 'read_json',
           '.pkl': 'read_pickle', '.h5': 'read_hdf', '.feather': 'read_feather'}
_NO_GAIN: Mapping[str, float] = MappingProxyType({})


class MeasuredRun(Protocol):
    """A run of a simulation: times, and what the sensors showed."""

    @property
    def t(self) -> np.ndarray:
        """Times, shape (N,) [s]."""
        ...

    @property
    def measured(self) -> Any:
        """With q, qd and torque, shape (N, n) each."""
        ...


Log = (str | os.PathLike[str] | Mapping[str, Any] | MeasuredLog | np.ndarray | DataFrame | Bag
       | MeasuredRun)
"""A log as a caller gives it, see `read_log`."""


@checked_call
def read_log(source: Log, *, topic: str | None = None, joints: Sequence[str] | None = None,
             velocity: bool = True, columns: Mapping[str, str] | None = None,
             degrees: bool = False, gain: Mapping[str, float] = _NO_GAIN,
             effort_delay: float = 0.0, **others: Any) -> MeasuredLog:
    """Read a measured log.

    Args:
        source: CSV file with a header such as ``t,q1..,qd1..,tau1..``, in any order, dialect and
            with names of other programs, see ``docs/logs.md``; NumPy's ``.npz`` file, or a
            mapping, with arrays t (N,) [s], q [rad], qd [rad/s] and tau [N·m] (N, n), or (N,)
            for one joint, and the names of the joints as ``joints`` where it has them; a data
            frame, structured array or mapping with columns like those of a CSV file; a bag, or
            what `read_bag` takes for one; a run of `simulate`; or a log.
        topic: Topic of joint values in the bag. Where not given: ``joint_states``, or the only
            one there is.
        joints: Which joints in which order, by name, where the source has names; else the names
            of its columns in order (``joint1``, ... where not given).
        velocity: Whether velocities are needed; where not, they are not read.
        columns: Columns of a CSV file or table by kind, e.g. ``{'t': 'stamp[ms]', 'q': 'pos_*'}``
            or ``{'q': ['shoulder', 'elbow']}``; of a mapping or ``.npz`` file names of arrays,
            e.g. ``{'t': 'time', 'tau': 'effort'}``.
        degrees: Whether positions and velocities are in degrees.
        gain: What the effort of a joint is multiplied by, by joint [N·m per unit].
        effort_delay: How far the effort is behind the motion [s].
        others: Not used; another name is refused with the one that is meant.

    Returns:
        The rows with finite values and increasing time.

    Raises:
        LogError: names the source and what is wrong where: column, row, topic or joint.
        ParameterError: an option is not known or cannot be used.
    """
    for name, value in others.items():
        raise UnknownParameter(name, value, LOG_OPTIONS)
    converted_by = conversion(degrees, gain, effort_delay)
    if columns is not None and not isinstance(columns, Mapping):
        raise ParameterError('columns', columns, "a mapping such as {'t': 'stamp[ms]'}")
    log = _read(source, topic, joints, velocity, _one_by_one(columns))
    return _converted(log, converted_by, source)


def _one_by_one(columns: Mapping[str, Any] | None) -> dict[str, str] | None:
    """Return columns by kind, those of a list by kind and number: ``q1``, ``q2``.

    Raises:
        ParameterError: a kind is not known, or what it has is no name.
    """
    if columns is None:
        return None
    single: dict[str, str] = {}
    for kind, given in columns.items():
        if not re.fullmatch(r't|(q|qd|tau)\d*', str(kind)):
            raise ParameterError('columns', kind, 't, q, qd or tau, each with the name of a '
                                 "column or an array, as in {'t': 'time'}")
        several = isinstance(given, (list, tuple)) and kind in ('q', 'qd', 'tau')
        named = {f'{kind}{k}': each for k, each in enumerate(given, 1)} if several else {
            kind: given}
        for name in named.values():
            if not isinstance(name, str):
                raise ParameterError('columns', given, f'a name or a list of names for {kind}')
        single.update(named)
    return single


def _read(source: Log, topic: str | None, joints: Sequence[str] | None, velocity: bool,
          columns: Mapping[str, str] | None) -> MeasuredLog:
    if joints is not None and (not isinstance(joints, (list, tuple))
                               or not all(isinstance(name, str) for name in joints)):
        raise ParameterError('joints', joints, 'a list of names')
    log = source if isinstance(source, MeasuredLog) else _finished(
        *_found(source, topic, joints, velocity, columns), joints)
    return log if joints is None else log.of_joints(joints)


def _found(source: Log, topic: str | None, joints: Sequence[str] | None, velocity: bool,
           columns: Mapping[str, str] | None) -> tuple[str, RawLog]:
    """Return how messages call a source, and all of its rows."""
    if isinstance(source, Bag):
        return str(source.path), _of_bag(source, topic, joints, velocity)
    arrays = source if isinstance(source, Mapping) else _of_run(source) or columns_of(source)
    if arrays is not None:
        return 'log', _of_arrays('log', arrays, joints, velocity, columns)
    try:
        path = Path(source)  # type: ignore[arg-type]
    except TypeError:
        plain = source is None or isinstance(source, (int, float, list, tuple, np.ndarray))
        raise LogError(f'log is {shown(source) if plain else f"of type {type(source).__name__}"}: '
                       'expected a path, arrays by name such as '
                       "{'t': a[:, 0], 'q': a[:, 1:3], 'qd': a[:, 3:5], 'tau': a[:, 5:7]}, a data "
                       'frame with named columns, a run of simulate, a bag, or a MeasuredLog'
                       ) from None
    return str(path), _of_file(path, topic, joints, velocity, columns)


def _of_run(source: Any) -> Mapping[str, Any] | None:
    """Return what the sensors showed in a run as arrays by name; None of anything else."""
    measured: Any = getattr(source, 'measured', None)
    if not hasattr(measured, 'torque') or not hasattr(source, 't'):
        return None
    named = {'joints': source.joints} if hasattr(source, 'joints') else {}
    return {'t': source.t, 'q': measured.q, 'qd': measured.qd, 'tau': measured.torque, **named}


def _of_bag(bag: Bag, topic: str | None, joints: Sequence[str] | None, velocity: bool) -> RawLog:
    try:
        return bag_log(bag, topic, joints, velocity=velocity)
    except BagError as exc:
        raise LogError(str(exc)) from exc


def _of_file(path: Path, topic: str | None, joints: Sequence[str] | None, velocity: bool,
             columns: Mapping[str, str] | None) -> RawLog:
    kind = path.suffix.lower()
    if kind in _TEXTS:
        return csv_log(path, joints, velocity=velocity, columns=columns)
    if kind == '.npz':
        return _load_npz(path, joints, velocity, columns)
    if kind == '.mat':
        raise LogError(f'{path} is a file of MATLAB: read_log(scipy.io.loadmat({path.name!r}, '
                       'squeeze_me=True)) reads its arrays')
    if kind in _TABLES:
        raise LogError(f'{path} is a table: read_log(pandas.{_TABLES[kind]}'
                       f'({path.name!r})) reads it')
    try:
        bag = read_bag(path)
    except BagError as exc:
        raise LogError(str(exc)) from exc
    return _of_bag(bag, topic, joints, velocity)


def _finished(source: str, raw: RawLog, joints: Sequence[str] | None) -> MeasuredLog:
    """Leave out the rows that cannot be used."""
    table, n = raw.table, raw.n
    names = raw.joints or _column_names(source, n, joints)
    finite = np.empty(len(table), bool)
    for some in row_blocks(table):
        finite[some] = np.isfinite(table[some]).all(axis=1)
    if problem := order_problem(raw.clock):
        raise LogError(f'{source}: {problem}')
    clock = log_clock(raw.clock, finite, raw.per_second)
    found, kept = len(table), int(clock.keep.sum())
    left_out = _left_out(raw.skipped, found, int(finite.sum()), kept)
    if kept < MINIMUM_ROWS:
        raise LogError(f'{source}: {kept} usable rows of {found}: expected at least '
                       f'{MINIMUM_ROWS} with finite values and increasing time'
                       + (f': {left_out}' if left_out else '')
                       + _empty_columns(table, n, names, raw.velocity)
                       + (f'; {raw.problem}' if raw.problem else ''))
    table = keep_rows(table, clock.keep)
    qd = table[:, n:2 * n] if raw.velocity else np.broadcast_to(0.0, (kept, n))
    return MeasuredLog(names, clock.t, table[:, :n], qd, table[:, -n:],
                       raw.skipped + found - kept, raw.problem,
                       (*raw.notes, *clock.notes, *([left_out] if left_out else [])),
                       clock.breaks, raw.velocity,
                       raw.joints is not None or joints is not None)


def _left_out(skipped: int, found: int, finite: int, kept: int) -> str:
    """Return why rows are left out, in a sentence; '' where they are few.

    Args:
        skipped: Messages that do not hold the joints.
        found: Rows.
        finite: Those without a missing value.
        kept: Those of them with a time that can be used.
    """
    total, left = skipped + found, skipped + found - kept
    if left <= MANY * total:
        return ''
    reasons = {'do not hold all joints (renamed, or of another robot?)': skipped,
               'have no value for a column': found - finite,
               'have a time that is not after that of the row before (with too few digits, or '
               'rows that are there twice?)': finite - kept}
    return f'{left} of {total} rows are left out: ' + '; '.join(
        f'{count} {reason}' for reason, count in reasons.items() if count)


def _empty_columns(table: np.ndarray, n: int, names: Sequence[str], velocity: bool) -> str:
    """Name the values that no row has."""
    kinds = ('q', 'qd', 'tau') if velocity else ('q', 'tau')
    empty = [f'{kind} of {names[i]!r}' for k, kind in enumerate(kinds) for i in range(n)
             if not np.isfinite(table[:, k * n + i]).any()]
    return f'; no row has {", ".join(empty)}' if empty and len(table) else ''


def _load_npz(path: Path, joints: Sequence[str] | None, velocity: bool,
              columns: Mapping[str, str] | None) -> RawLog:
    try:
        with np.load(path, allow_pickle=False) as arrays:
            return _of_arrays(str(path), dict(arrays), joints, velocity, columns)
    except (OSError, ValueError, zipfile.BadZipFile) as exc:
        if isinstance(exc, LogError):
            raise
        raise LogError(f'{path}: cannot be read: {exc}') from exc


def _of_arrays(source: str, arrays: Mapping[str, Any], joints: Sequence[str] | None,
               velocity: bool, columns: Mapping[str, str] | None) -> RawLog:
    needed = ('t', 'q', 'qd', 'tau') if velocity else ('t', 'q', 'tau')
    whole = all((columns or {}).get(name, name) in arrays for name in needed)
    if arrays and not whole and is_table(arrays):
        return table_log(source, arrays, joints, velocity=velocity, given=columns)
    arrays = _renamed(source, arrays, columns or {})
    if missing := [name for name in needed if name not in arrays]:
        raise LogError(f'{source}: no array {missing[0]!r}: expected t, q, qd and tau, got '
                       f'{", ".join(map(str, arrays)) or "none"}: '
                       + option('columns', f'{{{missing[0]!r}: ...}}', f'{missing[0]}=...')
                       + ' names another' + _others(missing, arrays))
    try:
        t = checked_array('t', arrays['t'], (-1,))
        one = dimensions(arrays['q']) == 1  # a column for the only joint
        q = checked_array('q', arrays['q'], (len(t), 1 if one else -1))
        names = _stored_names(arrays.get('joints'), q.shape[1]) or _names_of_columns(arrays['q'])
        columns_of_all = names or joints or ()
        q, *rest = [checked_array(name, arrays[name], q.shape,
                                  columns_of_all if len(columns_of_all) == q.shape[1] else
                                  _column_names(source, q.shape[1], None)) for name in needed[1:]]
    except ParameterError as exc:
        raise LogError(f'{source}: {exc}') from exc
    return RawLog(names, t, 1.0, np.hstack([q, *rest]), q.shape[1], velocity, 0, (), None)


def _names_of_columns(q: Any) -> tuple[str, ...] | None:
    """Return the names of joints that the columns of a data frame have; None for numbers.

    Raises:
        ParameterError: the names say that the values are in degrees.
    """
    labels = labels_of(q) if dimensions(q) == 2 else None
    if labels is None or all(each[-1:].isdecimal() for each in labels):
        return None
    if any(re.search(r'_deg(?:rees?)?$', each, re.IGNORECASE) for each in labels):
        raise ParameterError('q', labels, 'radians, of numpy.deg2rad(q); or one data frame with '
                             'all columns, of which those whose names end so are converted')
    return tuple(labels) if len(set(labels)) == len(labels) else None


def _stored_names(stored: Any, n: int) -> tuple[str, ...] | None:
    """Return the names of the joints that arrays come with; None where they have none.

    Raises:
        ParameterError: there are not as many different ones as joints.
    """
    if stored is None or np.asarray(stored).dtype.kind != 'U':
        return None
    names = tuple(str(name).strip() for name in np.atleast_1d(stored))
    if len(names) != n or len(set(names)) != n:
        raise ParameterError('joints', list(names), f'{n} different names, one for each column '
                             'of q')
    return names


def _others(missing: Sequence[str], arrays: Mapping[str, Any]) -> str:
    """Return what may be meant by arrays of other names, and how to do without velocities."""
    meant = {kind: next(iter(same_meaning(kind, map(str, arrays))), None) for kind in missing}
    named = {kind: name for kind, name in meant.items() if name is not None}
    if named:
        return f', as in {option("columns", str(named), ",".join(map("=".join, named.items())))}'
    if missing == ['qd']:
        return f'; or {setting("filter.state_order", "4")}, which takes velocities from positions'
    return ''


def _renamed(source: str, arrays: Mapping[str, Any],
             columns: Mapping[str, str]) -> Mapping[str, Any]:
    """Return arrays under the names t, q, qd and tau, where they are called otherwise."""
    for name in columns.values():
        if name not in arrays:
            raise LogError(f'{source}: no array {name!r}: it has {", ".join(map(str, arrays))}')
    return {**arrays, **{kind: arrays[name] for kind, name in columns.items()}}


def _converted(log: MeasuredLog, by: Conversion, source: Log) -> MeasuredLog:
    gains = by.gains(log.joints)
    if by.degrees:
        log = log.with_fitting(q=_scaled(log.q, np.pi / 180.0), qd=_scaled(log.qd, np.pi / 180.0))
    if by.gain:
        log = log.with_fitting(tau=_scaled(log.tau, gains))
    return _shifted(log, by.effort_delay, source) if by.effort_delay else log


def _scaled(values: np.ndarray, by: float | np.ndarray) -> np.ndarray:
    """Return values times a factor, block by block: they may not fit the memory."""
    result = new_table(*values.shape)
    for some in row_blocks(result, values):
        np.multiply(values[some], by, out=result[some])
    return result


def _shifted(log: MeasuredLog, delay: float, source: Log) -> MeasuredLog:
    """Return a log whose effort at t is the one that was recorded at t + delay."""
    later = log.t + delay
    inside = (later >= log.t[0]) & (later <= log.t[-1])
    count, first = int(inside.sum()), int(inside.argmax())
    if count < MINIMUM_ROWS:
        name = os.fspath(source) if isinstance(source, (str, os.PathLike)) else 'log'
        raise LogError(f'{name}: {option("effort_delay", f"{delay:g}")} s leaves nothing of '
                       f'{log.t[-1] - log.t[0]:.3g} s')
    there = slice(first, first + count)  # times rise, so it is one stretch
    t = log.t[there]
    return log.with_fitting(t=t - t[0], q=log.q[there], qd=log.qd[there],
                        tau=_interpolated(later[there], log.t, log.tau),
                        dropped=log.dropped + len(log.t) - count,
                        breaks=tuple(row - first for row in log.breaks
                                     if 0 < row - first < count))


def _interpolated(times: np.ndarray, t: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return values (N, n) at ``t`` (N,) interpolated to ``times`` (K,); both rise."""
    result = new_table(len(times), values.shape[1])
    for some in row_blocks(result, values):
        wanted = times[some]
        low = max(int(np.searchsorted(t, wanted[0], 'right')) - 1, 0)
        near = slice(low, int(np.searchsorted(t, wanted[-1])) + 1)
        for column, joint in zip(result[some].T, values[near].T, strict=True):
            column[:] = np.interp(wanted, t[near], joint)
    return result


def _column_names(source: str, n: int, joints: Sequence[str] | None) -> tuple[str, ...]:
    if joints is None:
        return tuple(f'joint{i + 1}' for i in range(n))
    names = tuple(joints)
    if len(set(names)) != n or len(names) != n:
        raise LogError(f'{source} has {n} joints (q1..q{n}): expected as many different '
                       f'names, got {len(names)}: {list(joints)}')
    return names
