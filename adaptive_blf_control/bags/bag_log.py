# SPDX-License-Identifier: Apache-2.0
"""Rows of a measured log in a bag."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from adaptive_blf_control.bags.joint_series import JointSeries
from adaptive_blf_control.bags.raw_log import RawLog
from adaptive_blf_control.bags.reader import Bag
from adaptive_blf_control.bags.row_store import release, row_blocks
from adaptive_blf_control.errors import LogError
from adaptive_blf_control.messages.joint_readers import (
    DYNAMIC_JOINT_STATE,
    joint_kind,
    JOINT_STATE,
)
from adaptive_blf_control.spelling import argument, setting

__all__ = ['bag_log']

_LOOKED_AT = 10_000  # messages that tell whether stamps can be used
_COARSE = 0.6  # of them with the stamp of the one before, from which they cannot


def bag_log(bag: Bag, topic: str | None, joints: Sequence[str] | None, *,
            velocity: bool) -> RawLog:
    """Read a topic of joint values; see `read_log`.

    Raises:
        LogError: no topic, or several, can be meant; or a joint has no value in any message.
        BagError: a message cannot be read.
    """
    topic = topic or _default_topic(bag)
    series = bag.joint_states(topic, joints, skip_foreign=True)
    where = f'{bag.path}: {topic}'
    needed = [('position', series.position, 'rad'), ('velocity', series.velocity, 'rad/s'),
              ('effort', series.effort, 'N·m')]
    for name, values, unit in needed if velocity else (needed[0], needed[2]):
        for i in _never_given(values):
            raise LogError(f'{where}: no {name} for joint {series.names[i]!r} in any message: '
                           f'expected numbers [{unit}]'
                           + (f': {setting("filter.state_order", "4")} takes velocities from the '
                              'positions' if name == 'velocity' else ''))
    clock, notes = _clock(series)
    return RawLog(series.names, clock, 1e9, _table(series, velocity),
                  len(series.names), velocity, series.skipped, notes, bag.problem)


def _never_given(values: np.ndarray) -> np.ndarray:
    """Return the columns without a number, block by block: the rows may not fit the memory."""
    empty = np.ones(values.shape[1], dtype=bool)
    for some in row_blocks(values):
        empty &= np.isnan(values[some]).all(axis=0)
        if not empty.any():
            break
    release(values)
    return np.flatnonzero(empty)


def _clock(series: JointSeries) -> tuple[np.ndarray, tuple[str, ...]]:
    """Return the stamps, or the times of reception where they tell more; and what is to be said.

    They do where all stamps are the same, and where those of most messages are, with other
    positions: a driver that stamps whole seconds.
    """
    if (series.stamp_ns == series.stamp_ns[0]).all():
        return series.log_time_ns, ()
    stamps, positions = series.stamp_ns[:_LOOKED_AT], series.position[:_LOOKED_AT]
    held = float(((np.diff(stamps) == 0) & (np.diff(positions, axis=0) != 0.0).any(axis=1)).sum())
    if held < _COARSE * len(stamps) or not (np.diff(series.log_time_ns[:_LOOKED_AT]) > 0).all():
        return series.stamp_ns, ()
    return series.log_time_ns, (f'the stamp is that of the message before in '
                                f'{held / len(stamps):.0%} of the messages, whose positions are '
                                'others: times of reception are used',)


def _table(series: JointSeries, velocity: bool) -> np.ndarray:
    """Return the table behind a series, or one without its velocities."""
    parts = (series.position, series.velocity, series.effort)
    whole = series.position.base
    if velocity and whole is not None and all(part.base is whole for part in parts) and (
            whole.shape == (len(series.stamp_ns), 3 * len(series.names))):
        return whole  # a large one is not copied
    return np.hstack(parts if velocity else (series.position, series.effort))


def _default_topic(bag: Bag) -> str:
    """Return the only topic of joint values, JointState before DynamicJointState."""
    for types in ((JOINT_STATE, 'sensor_msgs/JointState'), (DYNAMIC_JOINT_STATE,), ('',)):
        found = sorted(name for name, info in bag.topics.items() if info.count
                       and info.type_name in types and joint_kind(info.type_name, info.encoding))
        named = [name for name in found if name.strip('/') == 'joint_states']
        if len(named) == 1 or (len(found) == 1 and types != ('',)):
            return (named or found)[0]
        if found and types != ('',):
            raise LogError(f'{bag.path}: several JointState topics: expected '
                           f'{argument("topic")} to name one of {", ".join(found)}')
    raise LogError(f'{bag.path}: no topic of type {JOINT_STATE}: it has '
                   + ', '.join(_described(bag, name) for name in bag.topics)
                   + f': where a type is not stated, {argument("topic")} names the topic')


def _described(bag: Bag, name: str) -> str:
    info = bag.topics[name]
    return f'{name} ({info.type_name or "type not stated"}' + (
        ')' if info.encoding == 'cdr' else f', encoded as {info.encoding})')
