# SPDX-License-Identifier: Apache-2.0
"""A topic of joint values as arrays, also where each message holds a part of the arm only."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
import functools
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arrays import record
from adaptive_blf_control.bags.row_store import RowStore
from adaptive_blf_control.errors import BagError, with_hints
from adaptive_blf_control.messages.joint_readers import JointKind

__all__ = ['JointSeries', 'merged', 'parts_of', 'series_of']

Messages = Iterable[tuple[int, bytes]]
"""Times of reception [ns] and data."""
BETWEEN = 5.0  # median periods: parts that are further apart are not interpolated


@record
@functools.partial(with_hints, instead={
    **dict.fromkeys(('t', 'time', 'times', 'stamp'),
                    '(stamp_ns - stamp_ns[0]) * 1e-9 are seconds from the first one'),
    'q': 'position', 'qd': 'velocity', 'dq': 'velocity',
    **dict.fromkeys(('tau', 'torque', 'torques'), 'effort'), 'joints': 'names'})
class JointSeries(NamedTuple):
    """All messages of one topic of joint values, N rows.

    Attributes:
        names: Joint (or parameter) names, n of them.
        stamp_ns: ``header.stamp``, shape (N,) [ns].
        log_time_ns: Time of reception, shape (N,) [ns].
        position: Shape (N, n) [rad]; NaN where a message leaves it empty.
        velocity: Shape (N, n) [rad/s], likewise.
        effort: Shape (N, n) [N·m], likewise.
        skipped: Messages left out because they do not hold these joints.
    """

    names: tuple[str, ...]
    stamp_ns: np.ndarray
    log_time_ns: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    effort: np.ndarray
    skipped: int = 0


def series_of(messages: Messages, kind: JointKind, joints: Sequence[str] | None, *,
              skip_foreign: bool) -> JointSeries:
    """Read the messages that hold all joints.

    Args:
        messages: What the topic holds.
        kind: How they are read.
        joints: Which joints in which order; those of the first message where None.
        skip_foreign: Count messages that cannot be matched instead of raising.

    Raises:
        BagError: the first message that cannot be matched, where ``skip_foreign`` is false or no
            message can; or there is no message.
    """
    reader = kind.reader(joints) if joints is not None else None
    stamps, heard = array('q'), array('q')
    rows: RowStore | None = None
    error, skipped = None, 0
    for index, (log_time_ns, data) in enumerate(messages):
        try:
            reader = reader or kind.reader(kind.names(data))
            rows = rows or RowStore(3 * len(reader.joints))
            stamp_ns, *values = reader.read(data)
        except BagError as exc:
            error = error or BagError(f'message {index}: {exc}')
            skipped += 1
            if not skip_foreign:
                raise error from exc
            continue
        rows.append(np.concatenate(values))
        stamps.append(stamp_ns)
        heard.append(log_time_ns)
    if reader is None or rows is None or not stamps:
        raise error or BagError('has no message')
    table, n = rows.table(), len(reader.joints)
    return JointSeries(reader.joints, np.frombuffer(stamps, dtype=np.int64),
                       np.frombuffer(heard, dtype=np.int64), table[:, :n], table[:, n:2 * n],
                       table[:, 2 * n:], skipped)


def parts_of(messages: Callable[[], Messages], kind: JointKind,
             joints: Sequence[str]) -> list[JointSeries]:
    """Read messages that hold some of the joints each, one series for each set of joints.

    Args:
        messages: Begins a pass over the topic.
        kind: How its messages are read.
        joints: Those of the arm.

    Returns:
        Series that together hold every joint once; empty where some joint is in no message.
    """
    counts: dict[frozenset[str], int] = {}
    for _, data in messages():
        with suppress(BagError):
            present = frozenset(kind.names(data)) & set(joints)
            counts[present] = counts.get(present, 0) + 1
    series, missing = [], set(joints)
    for present in sorted(counts, key=lambda each: -counts[each]):
        if wanted := [joint for joint in joints if joint in present & missing]:
            missing -= present
            series.append(series_of(messages(), kind, wanted, skip_foreign=True))
    return [] if missing else series


def merged(parts: Sequence[JointSeries], joints: Sequence[str]) -> JointSeries:
    """Join the parts of an arm that several drivers publish on one topic.

    A row is a message of the slowest part; the others are interpolated linearly between their
    neighbours in time, NaN where these are further apart than usual or on one side only.
    """
    base = min(parts, key=lambda part: len(part.stamp_ns))
    with_stamps = all((np.diff(part.stamp_ns) > 0).all() for part in parts)
    zero = int((base.stamp_ns if with_stamps else base.log_time_ns)[0])

    def seconds(part: JointSeries) -> np.ndarray:
        # Differences first: absolute nanoseconds do not fit a double.
        return ((part.stamp_ns if with_stamps else part.log_time_ns) - zero) * 1e-9

    times, columns = seconds(base), {}
    for part in parts:
        own = seconds(part)
        steps = np.diff(own, append=np.inf)
        far = steps > BETWEEN * float(np.median(steps))  # of one row: none is near
        for i, name in enumerate(part.names):
            columns[name] = [values[:, i] if part is base else
                             _between(times, own, values[:, i], far)
                             for values in (part.position, part.velocity, part.effort)]
    position, velocity, effort = (np.column_stack([columns[name][k] for name in joints])
                                  for k in range(3))
    return JointSeries(tuple(joints), base.stamp_ns, base.log_time_ns, position, velocity, effort)


def _between(times: np.ndarray, own: np.ndarray, values: np.ndarray,
             far: np.ndarray) -> np.ndarray:
    """Interpolate values at ``own`` times to ``times``; NaN in intervals that are ``far``."""
    found = np.interp(times, own, values, left=np.nan, right=np.nan)
    before = np.clip(np.searchsorted(own, times, 'right') - 1, 0, len(own) - 1)
    exact = own[before] == times
    found[far[before] & ~exact] = np.nan
    return found
