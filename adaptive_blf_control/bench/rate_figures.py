# SPDX-License-Identifier: Apache-2.0
"""The arithmetic of ``bench rates``: periods from stamps, percentiles, processor time."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Mapping
import os
from pathlib import Path
import struct
from typing import NamedTuple, TypeVar

import numpy as np

from adaptive_blf_control.bags.mcap_file import McapFile
from adaptive_blf_control.bags.reader import storage_files
from adaptive_blf_control.bench.soak_figures import account_of
from adaptive_blf_control.errors import BagError
from adaptive_blf_control.messages.diagnostics_reader import decode_diagnostics
from adaptive_blf_control.messages.topics import ADAPTATION_TERM, JOINT_STATES, THETA_HAT

__all__ = ['Loop', 'Run', 'Row', 'Usage', 'median', 'of_bag', 'of_bare', 'stolen_time',
           'usage_of']

TAIL = 0.1  # s at the end that are not judged: the last states may find nobody
CALLBACK = 'callback so far p50, p99, p99.9, largest [ms]'
ROUND_TRIP = 'round trip p50, p99, p99.9, largest so far [ms]'
IN_TIME = 'answered within their period so far [%]'
# Who serves a period shows it by a message with the stamp of the period's state.
SHOWN_BY = {'arm_driver': JOINT_STATES, 'controller': ADAPTATION_TERM, 'identifier': THETA_HAT}
_STAMP = struct.Struct('<iI')  # after the four bytes of the CDR encapsulation
NAN = float('nan')


class Row(NamedTuple):
    """One process over one run.

    Attributes:
        rate: Periods served, of the recorder messages taken, in a second [Hz].
        missed: Periods due and not served; of the recorder messages that are not in the bag.
        due: Periods due, of the recorder messages sent to it.
        p50: Median time of a callback [ms], NaN where it was not measured; likewise the next two.
        p99: 99 % of the callbacks took no longer [ms].
        largest: The longest callback [ms].
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
    """From a state to its command and back over one run; times in ms.

    Attributes:
        p50: Median of the round trip as the driver sees it; the next three likewise.
        p99: 99 % of the round trips were no longer.
        p999: 99.9 % of the round trips were no longer.
        largest: The longest round trip.
        met: Periods with a state that was answered, if late [%].
        in_time: Periods with a state that was answered before the next one was due [%].
        cores: Processor time of all processes together [cores].
        stolen: Processor time that the host of a virtual machine gave to others meanwhile [%].
    """

    p50: float
    p99: float
    p999: float
    largest: float
    met: float
    in_time: float
    cores: float
    stolen: float = NAN


class Run(NamedTuple):
    """What one run gave: a row for each process, and the loop through them."""

    rows: dict[str, Row]
    loop: Loop


class Usage(NamedTuple):
    """Processor time [% of a core] and resident memory [MB] of a process."""

    cpu: float
    memory: float


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
    """Return the time the host has taken from this machine, and all time, both so far [ticks]."""
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


def _window(times_ns: np.ndarray, rate: float, settle: float, what: str) -> tuple[int, int]:
    """Return begin and end of what is judged [ns], half a period before the grid of the states."""
    half = 0.5e9 / rate
    begin, end = int(times_ns[0] + settle * 1e9 - half), int(times_ns[-1] - TAIL * 1e9 - half)
    if end <= begin:
        raise BagError(f'{what}: {(times_ns[-1] - times_ns[0]) * 1e-9:.2f} s of motion: expected '
                       f'more than {settle + TAIL:g} s')
    return begin, end


def of_bare(files: Mapping[str, Path], usage: Mapping[str, Usage], rate: float,
            settle: float, stolen: float = NAN) -> Run:
    """Return the figures of a run of `bare_echo` from the files its nodes saved.

    Raises:
        BagError: too few states were sent.
    """
    served = {name: np.load(path)['served'] for name, path in files.items()}
    trips, sent = np.load(files['driver'])['trips'], served['driver']
    if sent.size < 2:
        raise BagError(f'the bare driver sent {sent.size} states: expected 2 or more')
    begin, end = _window(sent, rate, settle, 'bare echo')
    inside = trips[(sent >= begin) & (sent < end) & (trips > 0)] * 1e-6
    rows = {name: _row(times, rate, begin, end)._replace(**usage[name]._asdict())
            for name, times in served.items()}
    quantiles = np.percentile(inside, (50, 99, 99.9, 100)) if inside.size else np.full(4, NAN)
    met, in_time = (100.0 * min(count / rows['driver'].due, 1.0)
                    for count in (inside.size, np.count_nonzero(inside <= 1e3 / rate)))
    p50, p99, p999, largest = map(float, quantiles)
    return Run(rows, Loop(p50, p99, p999, largest, met, in_time, _cores(usage), stolen))


def of_bag(bag: Path, log: str, usage: Mapping[str, Usage], rate: float, settle: float,
           stolen: float = NAN) -> Run:
    """Return the figures of a run of the four nodes.

    Args:
        bag: Folder of the bag.
        log: What the recorder printed.
        usage: Processor time and memory by node.
        rate: Rate of the states [Hz].
        settle: What is left out after the first answered state [s].
        stolen: See :class:`Loop`.

    Raises:
        BagError: the bag cannot be read, or has no motion that is long enough.
    """
    content = _Content(bag)
    sent, answered = (content.stamps[SHOWN_BY[name]] for name in ('arm_driver', 'controller'))
    if answered.size == 0:
        raise BagError(f'{bag}: no joint state was answered by the controller')
    begin, end = _window(sent[sent >= answered[0]], rate, settle, str(bag))
    rows = {name: _row(content.stamps[topic], rate, begin, end)
            for name, topic in SHOWN_BY.items()}
    taken = np.count_nonzero((content.received >= begin) & (content.received < end))
    account = account_of(log, content.counts)
    rows['recorder'] = Row(taken / ((end - begin) * 1e-9),
                           sum(a.received - a.written + a.lost for a in account),
                           sum(a.received + a.lost for a in account))
    for name, row in rows.items():
        p50, p99, _, largest = content.figures(name, CALLBACK)
        rows[name] = row._replace(p50=p50, p99=p99, largest=largest, **usage[name]._asdict())
    met = 100.0 * (1.0 - rows['controller'].missed / rows['controller'].due)
    p50, p99, p999, largest = content.figures('arm_driver', ROUND_TRIP)
    in_time, = content.figures('arm_driver', IN_TIME, 1)
    in_time = min(in_time, met)  # a command has no stamp, and the driver may take it for another's
    return Run(rows, Loop(p50, p99, p999, largest, met, in_time, _cores(usage), stolen))


class _Content:
    """One pass over a bag.

    Attributes:
        counts: Messages by topic.
        received: When each message was received, in any order [ns].
        stamps: Different stamps on each topic of `SHOWN_BY`, in order [ns].
        diagnostics: What each node said last.
    """

    def __init__(self, bag: Path) -> None:
        self.counts: dict[str, int] = {}
        self.diagnostics: dict[str, dict[str, str]] = {}
        received, stamps = array('q'), {topic: array('q') for topic in SHOWN_BY.values()}
        for path in storage_files(bag):
            file = McapFile(path)
            for channel, received_ns, data in file.messages():
                topic = file.channels[channel].topic
                self.counts[topic] = self.counts.get(topic, 0) + 1
                received.append(received_ns)
                name = topic.lstrip('/')
                if name in stamps:
                    seconds, nanoseconds = _STAMP.unpack_from(data, 4)
                    stamps[name].append(seconds * 10**9 + nanoseconds)
                elif name == 'diagnostics':
                    self.diagnostics.update(
                        {status.partition(':')[0]: values
                         for status, values in decode_diagnostics(data).items()})
            if file.problem:
                raise BagError(file.problem)
        self.received = np.array(received, dtype=np.int64)
        self.stamps = {topic: np.unique(np.array(values, dtype=np.int64))
                       for topic, values in stamps.items()}

    def figures(self, node: str, key: str, count: int = 4) -> tuple[float, ...]:
        """Return the figures under ``key`` that ``node`` gave last; NaN where it did not."""
        text = self.diagnostics.get(node, {}).get(key, '')
        return tuple(map(float, text.split(', '))) if text else (NAN,) * count


def _cores(usage: Mapping[str, Usage]) -> float:
    return sum(one.cpu for one in usage.values()) / 100.0


Figures = TypeVar('Figures', Row, Loop)


def median(runs: Iterable[Run]) -> Run:
    """Return the median of every figure over runs of the same processes."""
    every = list(runs)
    return Run({name: _median([run.rows[name] for run in every]) for name in every[0].rows},
               _median([run.loop for run in every]))


def _median(figures: list[Figures]) -> Figures:
    return type(figures[0])(*map(float, np.median(np.array(figures, dtype=float), axis=0)))
