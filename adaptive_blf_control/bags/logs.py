# SPDX-License-Identifier: Apache-2.0
"""Measured logs for identification: q, qd and tau over time, from a bag, a file or arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import csv
import os
from pathlib import Path
from typing import Any, NamedTuple
import zipfile

import numpy as np

from adaptive_blf_control.arrays import checked_array
from adaptive_blf_control.bags.reader import Bag, JOINT_STATE, read_bag
from adaptive_blf_control.errors import BagError, LogError, ParameterError

__all__ = ['Log', 'MeasuredLog', 'read_log']

MINIMUM_ROWS = 3


class MeasuredLog(NamedTuple):
    """A log of N rows for n joints; all finite, times strictly increasing.

    Attributes:
        joints: Joint names.
        t: Time, shape (N,) [s]. From a bag it counts from the first row; a CSV file's stands.
        q: Positions, shape (N, n) [rad].
        qd: Velocities, shape (N, n) [rad/s].
        tau: Joint torques, shape (N, n) [N·m].
        dropped: Rows left out: a value not finite, a time not after the row before, or a
            message without these joints.
        problem: Why the source ends early (a truncated bag), or None.
    """

    joints: tuple[str, ...]
    t: np.ndarray
    q: np.ndarray
    qd: np.ndarray
    tau: np.ndarray
    dropped: int
    problem: str | None = None


Log = str | os.PathLike[str] | Mapping[str, Any] | MeasuredLog
"""A log as a caller gives it, see `read_log`."""


def read_log(source: Log, *, topic: str | None = None,
             joints: Sequence[str] | None = None) -> MeasuredLog:
    """Read a measured log.

    Args:
        source: CSV file with a header ``t,q1..,qd1..,tau1..`` (columns in any order, others
            skipped); NumPy's ``.npz`` file, or a mapping, with arrays t (N,) [s], q [rad],
            qd [rad/s] and tau [N·m] (N, n); a bag as `read_bag` takes it; or a log.
        topic: JointState topic of the bag. Where not given: ``joint_states``, or the only
            JointState topic there is.
        joints: For a bag or a log, which joints in which order, by name; for CSV and arrays,
            which have no names, the names of their columns in order (else ``joint1``, ...).

    Returns:
        The rows with finite values and increasing time.

    Raises:
        LogError: names the source and what is wrong where: column, row, topic or joint.
        ParameterError: ``joints`` are no names.
    """
    if joints is not None and (not isinstance(joints, (list, tuple))
                               or not all(isinstance(name, str) for name in joints)):
        raise ParameterError('joints', joints, 'a list of names')
    if isinstance(source, MeasuredLog):
        return _chosen(source, joints)
    if isinstance(source, Mapping):
        return _of_arrays('log', source, joints)
    try:
        path = Path(source)
    except TypeError:
        raise LogError(f'log is {source!r}: expected a path, a mapping with arrays t, q, qd, tau, '
                       'or a MeasuredLog') from None
    if path.suffix.lower() == '.csv':
        return _load_csv(path, joints)
    if path.suffix.lower() == '.npz':
        return _load_npz(path, joints)
    try:
        bag = read_bag(path)
        return _load_bag(bag, topic or _default_topic(bag), joints)
    except BagError as exc:
        raise LogError(str(exc)) from exc


def _chosen(log: MeasuredLog, joints: Sequence[str] | None) -> MeasuredLog:
    if joints is None or tuple(joints) == log.joints:
        return log
    if missing := [name for name in joints if name not in log.joints]:
        raise LogError(f'log: no joint {missing[0]!r}: it has {", ".join(log.joints)}')
    columns = [log.joints.index(name) for name in joints]
    q, qd, tau = (np.ascontiguousarray(values[:, columns])
                  for values in (log.q, log.qd, log.tau))
    return log._replace(joints=tuple(joints), q=q, qd=qd, tau=tau)


def _load_npz(path: Path, joints: Sequence[str] | None) -> MeasuredLog:
    try:
        with np.load(path, allow_pickle=False) as arrays:
            return _of_arrays(str(path), dict(arrays), joints)
    except (OSError, ValueError, zipfile.BadZipFile) as exc:
        if isinstance(exc, LogError):
            raise
        raise LogError(f'{path}: cannot be read: {exc}') from exc


def _of_arrays(source: str, arrays: Mapping[str, Any],
               joints: Sequence[str] | None) -> MeasuredLog:
    if missing := [name for name in ('t', 'q', 'qd', 'tau') if name not in arrays]:
        raise LogError(f'{source}: no array {missing[0]!r}: expected t, q, qd and tau, got '
                       f'{", ".join(map(str, arrays)) or "none"}')
    try:
        t = checked_array('t', arrays['t'], (-1,))
        q = checked_array('q', arrays['q'], (len(t), -1))
        qd, tau = (checked_array(name, arrays[name], q.shape) for name in ('qd', 'tau'))
    except ParameterError as exc:
        raise LogError(f'{source}: {exc}') from exc
    names = _column_names(source, q.shape[1], joints)
    values = np.hstack([q, qd, tau])
    keep = _usable(t, np.column_stack([t, values]))
    _check_rows(source, int(keep.sum()), len(keep))
    return _log(names, t[keep], values[keep], int((~keep).sum()), None)


def _default_topic(bag: Bag) -> str:
    candidates = sorted(name for name, info in bag.topics.items()
                        if info.type_name == JOINT_STATE and info.count)
    preferred = [name for name in candidates if name in ('joint_states', '/joint_states')]
    if len(preferred) == 1 or len(candidates) == 1:
        return (preferred or candidates)[0]
    if not candidates:
        raise LogError(f'{bag.path}: no topic of type {JOINT_STATE}: it has '
                       f'{[(info.name, info.type_name) for info in bag.topics.values()]}')
    raise LogError(f'{bag.path}: several JointState topics: name one of {candidates}')


def _load_bag(bag: Bag, topic: str, joints: Sequence[str] | None) -> MeasuredLog:
    series = bag.joint_states(topic, joints, skip_foreign=True)
    where = f'{bag.path}: {topic}'
    for name, values, unit in (('position', series.position, 'rad'),
                               ('velocity', series.velocity, 'rad/s'),
                               ('effort', series.effort, 'N·m')):
        for i in np.flatnonzero(np.isnan(values).all(axis=0)):
            raise LogError(f'{where}: no {name} for joint {series.names[i]!r} in any message: '
                           f'expected numbers [{unit}]')
    clock = series.stamp_ns if series.stamp_ns.any() else series.log_time_ns
    values = np.hstack((series.position, series.velocity, series.effort))
    keep = _usable(clock, values)
    _check_rows(where, int(keep.sum()), len(keep))
    # Subtracted as integers: seconds since 1970 as a double would be good to 0.2 µs only.
    t = (clock[keep] - clock[keep][0]) / 1e9
    return _log(series.names, t, values[keep], series.skipped + int((~keep).sum()), bag.problem)


def _load_csv(path: Path, joints: Sequence[str] | None) -> MeasuredLog:
    try:
        with path.open(newline='', encoding='utf-8-sig') as stream:
            rows = csv.reader(stream)
            header = [cell.strip() for cell in next(rows, [])]
            columns = _find_columns(path, header)
            numbers = [_parse_row(path, header, row, columns, rows.line_num)
                       for row in rows if row]
    except (OSError, UnicodeDecodeError, csv.Error) as exc:
        raise LogError(f'{path}: cannot be read: {exc}') from exc
    n = len(columns) // 3
    names = _column_names(str(path), n, joints)
    table = np.array(numbers, dtype=np.float64).reshape(-1, 1 + 3 * n)
    keep = _usable(table[:, 0], table)
    _check_rows(str(path), int(keep.sum()), len(keep))
    return _log(names, table[keep, 0], table[keep, 1:], int((~keep).sum()), None)


def _column_names(source: str, n: int, joints: Sequence[str] | None) -> tuple[str, ...]:
    if joints is None:
        return tuple(f'joint{i + 1}' for i in range(n))
    names = tuple(joints)
    if len(set(names)) != n or len(names) != n:
        raise LogError(f'{source} has {n} joints (q1..q{n}): expected as many different '
                       f'names, got {len(names)}: {list(joints)}')
    return names


def _find_columns(path: Path, header: list[str]) -> list[int]:
    """Return the indices of t, q1.., qd1.., tau1..; n is the number of q columns."""
    where = {name: i for i, name in enumerate(header)}
    if len(where) != len(header):
        twice = sorted({name for name in header if header.count(name) > 1})
        raise LogError(f'{path}: row 1: column {twice} occurs more than once')
    n = sum(1 for name in header if name[:1] == 'q' and name[1:].isdecimal())
    if not any(name.startswith('tau') for name in header) and n:
        raise LogError(f'{path}: row 1: no effort: expected columns tau1..tau{n} [N·m]')
    wanted = ['t', *(f'{kind}{i + 1}' for kind in ('q', 'qd', 'tau') for i in range(n or 1))]
    if missing := [name for name in wanted if name not in where]:
        raise LogError(f'{path}: row 1: missing column {", ".join(missing)}: expected a header '
                       't,q1..,qd1..,tau1..')
    return [where[name] for name in wanted]


def _parse_row(path: Path, header: list[str], row: list[str], columns: list[int],
               line: int) -> list[float]:
    if len(row) != len(header):
        raise LogError(f'{path}: row {line} has {len(row)} cells: expected {len(header)}')
    try:
        return [float(row[i]) for i in columns]
    except ValueError:
        pass
    for i in columns:
        try:
            float(row[i])
        except ValueError as exc:
            raise LogError(f'{path}: row {line}, column {header[i]!r}: {row[i]!r} is not a '
                           'number') from exc
    raise LogError(f'{path}: row {line} cannot be read')


def _usable(clock: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return which rows to keep, shape (N,): all finite, time after that of the last kept."""
    finite = np.isfinite(values).all(axis=1)
    times = clock[finite]
    if len(times) == 0:
        return finite
    # A row is after all kept rows exactly where it is after the largest time before it.
    latest = np.maximum.accumulate(times)
    finite[finite] = np.concatenate(([True], times[1:] > latest[:-1]))
    return finite


def _check_rows(where: str, kept: int, found: int) -> None:
    if kept < MINIMUM_ROWS:
        raise LogError(f'{where}: {kept} usable rows of {found}: expected at least '
                       f'{MINIMUM_ROWS} with finite values and increasing time')


def _log(joints: tuple[str, ...], t: np.ndarray, values: np.ndarray, dropped: int,
         problem: str | None) -> MeasuredLog:
    q, qd, tau = (np.ascontiguousarray(part) for part in np.split(values, 3, axis=1))
    return MeasuredLog(joints, t, q, qd, tau, dropped, problem)
