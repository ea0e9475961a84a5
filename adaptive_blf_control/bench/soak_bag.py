# SPDX-License-Identifier: Apache-2.0
"""Reads the bag of a soak run in one pass: counts, latencies, last diagnostics.

The bag of an hour holds 26 million messages in 4 GB. Only stamps and diagnostics are decoded, and
only two integers are kept for each answered state: 60 MB for the hour.
"""

from __future__ import annotations

from array import array
from pathlib import Path
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.bags.mcap_file import McapFile
from adaptive_blf_control.bags.storage_files import storage_files
from adaptive_blf_control.errors import BagError
from adaptive_blf_control.messages.command import answered_stamp
from adaptive_blf_control.messages.diagnostics import decode_diagnostics
from adaptive_blf_control.messages.stamp import stamp_of
from adaptive_blf_control.messages.topics import COMMANDS, JOINT_STATES

__all__ = ['RunFigures', 'read_run']

_KEPT = 20_000  # unanswered states that are kept


class RunFigures(NamedTuple):
    """Figures from one pass over the bag.

    Attributes:
        counts: Messages by topic.
        sent: Times at which the answered states were published, shape (N,) [s].
        latency: Time from there until the command that answers them was published, shape (N,) [s].
        diagnostics: The last diagnostics of each node, by its name.
    """

    counts: dict[str, int]
    sent: np.ndarray
    latency: np.ndarray
    diagnostics: dict[str, dict[str, str]]


def read_run(bag: Path) -> RunFigures:
    """Count the messages of a bag folder and match states with answers, in one pass.

    Raises:
        BagError: the bag cannot be read or breaks off.
    """
    counts: dict[str, int] = {}
    diagnostics: dict[str, dict[str, str]] = {}
    matcher = _Matcher()
    for path in storage_files(bag):
        file = McapFile(path)
        for channel, _, sent_ns, data in file.timed_messages():
            topic = file.channels[channel].topic
            counts[topic] = counts.get(topic, 0) + 1
            if topic.endswith('/' + JOINT_STATES):
                matcher.state(data, sent_ns)
            elif topic.endswith('/' + COMMANDS):
                matcher.answer(data, sent_ns)
            elif topic == '/diagnostics':
                for name, values in decode_diagnostics(data).items():
                    diagnostics[name.partition(':')[0]] = values
        if file.problem:
            raise BagError(file.problem)
    sent = np.frombuffer(matcher.sent, dtype=np.int64)
    order = np.argsort(sent, kind='stable')
    latency = np.frombuffer(matcher.latency, dtype=np.int64)
    return RunFigures(counts, 1e-9 * (sent[order] - sent[:1]), 1e-9 * latency[order],
                      diagnostics)


class _Matcher:
    """Pairs states with answers by stamp, whatever their order in the bag."""

    def __init__(self) -> None:
        self.sent, self.latency = array('q'), array('q')
        self._states: dict[int, int] = {}
        self._answers: dict[int, int] = {}

    def state(self, data: bytes, sent_ns: int) -> None:
        stamp = stamp_of(data) or 0
        answered = self._answers.pop(stamp, None)
        if answered is not None:
            self._add(sent_ns, answered)
            return
        self._states[stamp] = sent_ns
        if len(self._states) > _KEPT:  # the controller answers only the newest state
            del self._states[next(iter(self._states))]

    def answer(self, data: bytes, sent_ns: int) -> None:
        stamp = answered_stamp(data)
        if stamp is None:
            return
        state = self._states.pop(stamp, None)
        if state is not None:
            self._add(state, sent_ns)
        else:
            self._answers[stamp] = sent_ns

    def _add(self, state_ns: int, answer_ns: int) -> None:
        self.sent.append(state_ns)
        self.latency.append(answer_ns - state_ns)
