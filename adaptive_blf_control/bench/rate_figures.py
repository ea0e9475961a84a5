# SPDX-License-Identifier: Apache-2.0
"""The arithmetic of ``bench rates``: periods from stamps, percentiles, processor time."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Mapping
import os
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np

from adaptive_blf_control.bags.mcap_file import McapFile
from adaptive_blf_control.bags.storage_files import storage_files
from adaptive_blf_control.bench.soak_figures import account_of
from adaptive_blf_control.errors import BagError
from adaptive_blf_control.messages.command import answered_stamp
from adaptive_blf_control.messages.diagnostics import decode_diagnostics
from adaptive_blf_control.messages.stamp import stamp_of
from adaptive_blf_control.messages.topics import COMMANDS, JOINT_STATES, THETA_HAT
from adaptive_blf_control.runtime.processes import nodes_in

__all__ = ['Loop', 'RateFigures', 'Row', 'Seen', 'Usage', 'Way', 'median', 'of_bag', 'of_bare',
           'stolen_time', 'usage_of']

TAIL = 0.1  # s at the end that are left out: nodes that have ended answer no states
CALLBACK = 'callback so far p50, p99, p99.9, largest [ms]'
ROUND_TRIP = 'round trip p50, p99, p99.9, largest so far [ms]'
IN_TIME = 'answered within their period so far [%]'
HELD = 'rate [Hz]'
# A node has served a period if a message on its topic has the stamp of the period's state.
SHOWN_BY = {'arm_driver': JOINT_STATES, 'controller': COMMANDS, 'identifier': THETA_HAT}
STAMP_BY = {COMMANDS: answered_stamp}  # where the stamp is not the first thing in a message
NAN = float('nan')


class Row(NamedTuple):
    """Figures of one process in one run.

    Attributes:
        rate: Periods served per second [Hz]; for the recorder, messages received per second.
        missed: Periods due and not served; for the recorder, messages that are not in the bag.
        due: Periods due; for the recorder, messages published to it.
        p50: Median duration of a callback [ms]. NaN, like the next two, where not measured.
        p99: 99th percentile of the duration of a callback [ms].
        largest: Duration of the longest callback [ms].
        cpu: Processor time [% of a core].
        memory: Resident memory at the end [MB].
    """

    rate: float
    missed: float
    due: float
    p50: float = NAN
    p99: float = NAN
    largest: float = NAN
    cpu: float = NAN
    memory: float = NAN


class Loop(NamedTuple):
    """The round trip from a state to its command over one run; times in ms.

    Attributes:
        p50: Median of the round trip as the driver sees it.
        p99: 99th percentile of the round trip.
        p999: 99.9th percentile of the round trip.
        largest: The longest round trip.
        met: Periods whose state was answered, even if late [%].
        in_time: Periods whose state was answered before the next one was due [%].
        cores: Processor time of all processes together [cores].
        stolen: Processor time that the host of a virtual machine gave to others meanwhile [%].
        start: From the start of the processes until the arm moves [s].
    """

    p50: float
    p99: float
    p999: float
    largest: float
    met: float
    in_time: float
    cores: float
    stolen: float = NAN
    start: float = NAN


class Seen(NamedTuple):
    """What is seen from outside; fields as of :class:`Loop`."""

    stolen: float = NAN
    start: float = NAN


class Way(NamedTuple):
    """Where the time of a round trip goes [ms]; all NaN where it is not known.

    Attributes:
        late: Median time from when a state was due until it was sent.
        late99: Its 99th percentile.
        slow: States that were sent more than half a period after they were due [%].
        answer: Median time from when a state was sent until its command was sent.
        answer99: Its 99th percentile.
        back: What is left of the median round trip: from the sending of the command on.
    """

    late: float = NAN
    late99: float = NAN
    slow: float = NAN
    answer: float = NAN
    answer99: float = NAN
    back: float = NAN


class RateFigures(NamedTuple):
    """Figures of one run: a row for each process, the loop through them, and its way."""

    rows: dict[str, Row]
    loop: Loop
    way: Way = Way()


class Usage(NamedTuple):
    """Processor time [% of a core] and resident memory [MB] of a process."""

    cpu: float
    memory: float


NOTHING_SEEN = Seen()


def _way(due_ns: np.ndarray, sent_ns: np.ndarray, answered_ns: np.ndarray, rate: float,
         trip: float) -> Way:
    """Return the way of a round trip whose median is ``trip`` [ms].

    Args:
        due_ns: When each state was due, shape (k,).
        sent_ns: When it was sent, by the same clock, likewise.
        answered_ns: When its command was sent, likewise; 0 where none was.
        rate: Rate of the states [Hz].
        trip: See above.
    """
    late, answer = (sent_ns - due_ns) * 1e-6, (answered_ns - sent_ns)[answered_ns > 0] * 1e-6
    if not late.size or not answer.size:
        return Way()
    middle = float(np.median(answer))
    return Way(float(np.median(late)), float(np.percentile(late, 99)),
               100.0 * float(np.mean(late > 500.0 / rate)), middle,
               float(np.percentile(answer, 99)), trip - middle)


def usage_of(pid: int) -> tuple[float, float] | None:
    """Return processor time so far [s] and resident memory [MB]; None where it has ended."""
    try:
        text = Path(f'/proc/{pid}/stat').read_text(encoding='ascii', errors='replace')
        fields = text.rpartition(')')[2].split()  # the name before may hold anything
        ticks, pages = int(fields[11]) + int(fields[12]), int(fields[21])
    except (OSError, IndexError, ValueError):
        return None
    if not pages:  # ended, and not waited for yet
        return None
    return ticks / os.sysconf('SC_CLK_TCK'), pages * os.sysconf('SC_PAGE_SIZE') * 1e-6


def stolen_time() -> tuple[float, float]:
    """Return the time that the host has taken from this machine, and all time, so far [ticks]."""
    try:
        line = Path('/proc/stat').read_text(encoding='ascii').partition('\n')[0]
        ticks = [float(text) for text in line.split()[1:9]]  # user .. steal
    except (OSError, ValueError):
        return NAN, NAN
    return (ticks[7], sum(ticks)) if len(ticks) == 8 else (NAN, NAN)


def _row(times_ns: np.ndarray, rate: float, begin_ns: int, end_ns: int) -> Row:
    """Count what was served from ``begin_ns`` until before ``end_ns``."""
    span = (end_ns - begin_ns) * 1e-9
    served = int(np.count_nonzero((times_ns >= begin_ns) & (times_ns < end_ns)))
    due = round(span * rate)
    return Row(served / span, max(due - served, 0), due)


def _window(times_ns: np.ndarray, rate: float, start_up: float, what: str) -> tuple[int, int]:
    """Return begin and end of the time that counts [ns], half a period before the states' grid."""
    half = 0.5e9 / rate
    begin, end = int(times_ns[0] + start_up * 1e9 - half), int(times_ns[-1] - TAIL * 1e9 - half)
    if end <= begin:
        raise BagError(f'{what}: {(times_ns[-1] - times_ns[0]) * 1e-9:.2f} s of motion: expected '
                       f'more than {start_up + TAIL:g} s')
    return begin, end


def of_bare(files: Mapping[str, Path], usage: Mapping[str, Usage], rate: float,
            start_up: float, seen: Seen = NOTHING_SEEN) -> RateFigures:
    """Return the figures of a run of `bare_echo` from the files its nodes saved.

    Raises:
        BagError: too few states were sent.
    """
    served = {name: np.load(path)['served'] for name, path in files.items()}
    trips, sent = np.load(files['driver'])['trips'], served['driver']
    if sent.size < 2:
        raise BagError(f'the bare driver sent {sent.size} states: expected 2 or more')
    begin, end = _window(sent, rate, start_up, 'bare echo')
    inside = trips[(sent >= begin) & (sent < end) & (trips > 0)] * 1e-6
    rows = {name: _row(times, rate, begin, end)._replace(**usage[name]._asdict())
            for name, times in served.items()}
    quantiles = np.percentile(inside, (50, 99, 99.9, 100)) if inside.size else np.full(4, NAN)
    met, in_time = (100.0 * min(count / rows['driver'].due, 1.0)
                    for count in (inside.size, np.count_nonzero(inside <= 1e3 / rate)))
    p50, p99, p999, largest = map(float, quantiles)
    loop = Loop(p50, p99, p999, largest, met, in_time, _cores(usage), *seen)
    return RateFigures(rows, loop, _way_of_raw(files, (sent >= begin) & (sent < end), rate, p50))


def _way_of_raw(files: Mapping[str, Path], inside: np.ndarray, rate: float, trip: float) -> Way:
    """Return the way as the nodes of `raw_echo` have kept it; no other nodes do."""
    driver, echo = np.load(files['driver']), np.load(files['echo'])
    if 'due' not in driver:
        return Way()
    answered = np.zeros(driver['served'].size, dtype=np.int64)
    answered[echo['stamp'] - 1] = echo['sent']  # a stamp is the number of the state, plus 1
    return _way(driver['due'][inside], driver['served'][inside], answered[inside], rate, trip)


def of_bag(bag: Path, log: str, usage: Mapping[str, Usage], rate: float, start_up: float,
           seen: Seen = NOTHING_SEEN) -> RateFigures:
    """Return the figures of a run of the four nodes, in four processes or in three.

    Args:
        bag: Folder of the bag.
        log: What the recorder printed.
        usage: Processor time and memory by process.
        rate: Rate of the states [Hz].
        start_up: Time after the first answered state that is left out [s].
        seen: What was seen from outside.

    Raises:
        BagError: the bag cannot be read, or has no motion that is long enough.
    """
    content = _Content(bag)
    sent, answered = (content.stamps[SHOWN_BY[name]] for name in ('arm_driver', 'controller'))
    if answered.size == 0:
        raise BagError(f'{bag}: no joint state was answered by the controller')
    begin, end = _window(sent[sent >= answered[0]], rate, start_up, str(bag))
    rows = {name: _row(content.stamps[topic], rate, begin, end)
            for name, topic in SHOWN_BY.items()}
    if 'identifier' not in usage:  # it publishes fewer estimates than it makes
        rows['identifier'] = content.by_its_own_count('identifier', rate, begin, end)
    taken = np.count_nonzero((content.received >= begin) & (content.received < end))
    account = account_of(log, content.counts)
    rows['recorder'] = Row(taken / ((end - begin) * 1e-9),
                           sum(a.received - a.written + a.lost for a in account),
                           sum(a.received + a.lost for a in account))
    for name, row in rows.items():
        p50, p99, _, largest = content.figures(name, CALLBACK)
        rows[name] = row._replace(p50=p50, p99=p99, largest=largest)
    for process, used in usage.items():
        name = process if nodes_in(process) == (process,) else nodes_in(process)[-1]
        rows[name] = rows[name]._replace(**used._asdict())
    met = 100.0 * (1.0 - rows['controller'].missed / rows['controller'].due)
    p50, p99, p999, largest = content.figures('arm_driver', ROUND_TRIP)
    in_time, = content.figures('arm_driver', IN_TIME, 1)
    in_time = min(in_time, met)
    loop = Loop(p50, p99, p999, largest, met, in_time, _cores(usage), *seen)
    return RateFigures(rows, loop, content.way(rate, begin, end, p50))


class _Content:
    """One pass over a bag.

    Attributes:
        counts: Messages by topic.
        received: When each message was received, in any order [ns].
        stamps: Different stamps on each topic of `SHOWN_BY`, in order [ns].
        diagnostics: The diagnostics of each node, with the time of their arrival [ns].
        sent: When what has a stamp was sent, by topic of `SHOWN_BY` and stamp [ns].
    """

    def __init__(self, bag: Path) -> None:
        self.counts: dict[str, int] = {}
        self.diagnostics: dict[str, list[tuple[int, dict[str, str]]]] = {}
        received = array('q')
        self.sent: dict[str, dict[int, int]] = {topic: {} for topic in SHOWN_BY.values()}
        for path in storage_files(bag):
            file = McapFile(path)
            for channel, received_ns, sent_ns, data in file.timed_messages():
                topic = file.channels[channel].topic
                self.counts[topic] = self.counts.get(topic, 0) + 1
                received.append(received_ns)
                name = topic.lstrip('/')
                if name in self.sent:
                    self.sent[name][STAMP_BY.get(name, stamp_of)(data) or 0] = sent_ns
                elif name == 'diagnostics':
                    for status, values in decode_diagnostics(data).items():
                        self.diagnostics.setdefault(status.partition(':')[0], []).append(
                            (received_ns, values))
            if file.problem:
                raise BagError(file.problem)
        self.received = np.array(received, dtype=np.int64)
        self.stamps = {topic: np.unique(np.array(list(sent), dtype=np.int64))
                       for topic, sent in self.sent.items()}

    def way(self, rate: float, begin_ns: int, end_ns: int, trip: float) -> Way:
        """Return the way of the states between two times; a stamp is when its state was due."""
        due = self.stamps[JOINT_STATES]
        due = due[(due >= begin_ns) & (due < end_ns)]
        sent, answered = (np.array([self.sent[topic].get(stamp, 0) for stamp in due.tolist()],
                                   dtype=np.int64) for topic in (JOINT_STATES, COMMANDS))
        return _way(due, sent, answered, rate, trip)

    def figures(self, node: str, key: str, count: int = 4) -> tuple[float, ...]:
        """Return the last figures of ``node`` under ``key``; NaN where there are none."""
        _, values = self.diagnostics.get(node, [(0, {})])[-1]
        text = values.get(key, '')
        return tuple(map(float, text.split(', '))) if text else (NAN,) * count

    def by_its_own_count(self, node: str, rate: float, begin_ns: int, end_ns: int) -> Row:
        """Return the periods that a node says it has served between two times."""
        said = [float(values[HELD]) for at, values in self.diagnostics.get(node, [])
                if begin_ns <= at < end_ns and HELD in values]
        held, span = float(np.mean(said)) if said else NAN, (end_ns - begin_ns) * 1e-9
        due = round(span * rate)
        return Row(held, max(due - held * span, 0.0), due)


def _cores(usage: Mapping[str, Usage]) -> float:
    return sum(one.cpu for one in usage.values()) / 100.0


Figures = TypeVar('Figures', Row, Loop, Way)


def median(runs: Iterable[RateFigures]) -> RateFigures:
    """Return the median of every figure over runs of the same processes."""
    every = list(runs)
    rows = {name: _median([run.rows[name] for run in every]) for name in every[0].rows}
    return RateFigures(rows, _median([run.loop for run in every]),
                       _median([run.way for run in every]))


def _median(figures: list[Figures]) -> Figures:
    return type(figures[0])(*map(float, np.median(np.array(figures, dtype=float), axis=0)))
