# SPDX-License-Identifier: Apache-2.0
"""``bench log_memory``: does memory grow with the log that a command reads?

A simulated run is repeated with growing stamps until a CSV file and a bag have a size, and each
command reads it in a process of its own. Between two repetitions lies a pause in which the filters
restart, since the end of the run is not its begin.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
import shutil
import struct
import subprocess
import sys
import tempfile
import time
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.bags.logs import read_log
from adaptive_blf_control.bags.reader import Bag, BagMessage, read_bag
from adaptive_blf_control.bags.writer import BagWriter
from adaptive_blf_control.errors import BlfError
from adaptive_blf_control.messages.cdr_cursor import BYTE_ORDERS, HEADER_SIZE

__all__ = ['COMMANDS', 'Peak', 'add_options', 'grown_bag', 'grown_csv', 'measured', 'run']

DURATION = 40.0  # s of the run that is repeated
_PAUSE = 10.0  # s, longer than any filter.gap
_LEAST = 3  # repetitions, whatever the size: the spans need two
_LOOK = 0.02  # s between two looks at a process
_MIB = 1024.0  # KiB
_BROKEN_OFF = 5000  # bytes that are cut off the bag that is recovered
_SPANS = ('--train', '0:40', '--test', '40:80')
_IDENTIFIED = ('--config', '{config}', '--force', '--output', '{folder}/theta_hat.yaml',
               '--overwrite')
COMMANDS = {
    'identify CSV': ('identify', '{csv}', *_IDENTIFIED),
    'identify CSV, 40 s learned, 40 s tested':
        ('identify', '{csv}', *_IDENTIFIED, *_SPANS),
    'identify BAG': ('identify', '{bag}', *_IDENTIFIED),
    'identify BAG, 40 s learned, 40 s tested':
        ('identify', '{bag}', *_IDENTIFIED, *_SPANS),
    'recover BROKEN.mcap': ('recover', '{broken}', '--output', '{folder}/recovered'),
    'play BAG --rate 100000': ('play', '{bag}', '--rate', '100000', '--wait', '0.1'),
}
"""What is measured, by name; words in braces are paths."""


class Peak(NamedTuple):
    """The memory that a process needed at most.

    Attributes:
        resident: Largest resident size [MiB].
        own: Of it at most, without mapped files and shared libraries [MiB].
        seconds: How long the process took [s].
    """

    resident: float
    own: float
    seconds: float


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this part."""
    parser.add_argument('--size', type=float, nargs='+', default=[100.0, 400.0], metavar='MB',
                        help='log_memory: sizes of the grown logs (default: 100 400)')
    parser.add_argument('--reads', nargs='+', default=['identify', 'recover', 'play'],
                        choices=['identify', 'recover', 'play'],
                        help='log_memory: commands that read them (default: all)')
    parser.add_argument('--set-back', action='store_true',
                        help='log_memory: the clock of the log begins again with each repetition')


def run(options: argparse.Namespace) -> None:
    """Print a Markdown table: a row for each command and size."""
    config = options.config / 'panda_mujoco.yaml'
    chosen = {name: words for name, words in COMMANDS.items() if words[0] in options.reads}
    print(f'{config.stem}, {DURATION:g} s, again and again. MiB, of it without mapped files.\n')
    print('| command | MB | rows | largest resident size | without files | s |')
    print('|---|---|---|---|---|---|')
    with tempfile.TemporaryDirectory() as folder:
        once = Path(folder) / 'once'
        _finish(['simulate', str(config), '--duration', f'{DURATION:g}', '--bag', str(once)])
        bag = read_bag(once)
        for size in options.size:
            for kind in ('csv', 'bag'):
                words = {name: each for name, each in chosen.items()
                         if any(f'{{{word}}}' in each for word in _FILES[kind])}
                _of_one(kind, bag, words, config, size, Path(folder), options.set_back)


_FILES = {'csv': ('csv',), 'bag': ('bag', 'broken')}


def _of_one(kind: str, bag: Bag, commands: dict[str, tuple[str, ...]], config: Path,
            size: float, parent: Path, set_back: bool) -> None:
    """Print what commands need for one log, which is deleted then."""
    if not commands:
        return
    folder = parent / f'{kind}_{size:g}'
    folder.mkdir()
    paths = {'csv': folder / 'log.csv', 'bag': folder / 'bag', 'broken': folder / 'broken.mcap',
             'config': config, 'folder': folder}
    bytes_of_it = round(size * 1e6)
    rows = (grown_csv(bag, paths['csv'], bytes_of_it, set_back) if kind == 'csv' else
            grown_bag(bag, paths['bag'], bytes_of_it, set_back))
    for name, command in commands.items():
        if '{broken}' in command:
            _break(next(paths['bag'].glob('*.mcap')), paths['broken'])
        peak = measured([word.format(**paths) for word in command])
        print(f'| {name} | {size:g} | {rows} | {peak.resident:.0f} | {peak.own:.0f} | '
              f'{peak.seconds:.0f} |', flush=True)
        paths['broken'].unlink(missing_ok=True)
    shutil.rmtree(folder)


def _break(whole: Path, broken: Path) -> None:
    shutil.copyfile(whole, broken)
    with broken.open('r+b') as file:
        file.truncate(whole.stat().st_size - _BROKEN_OFF)


def grown_csv(bag: Bag, path: Path, size: int, set_back: bool = False) -> int:
    """Write the states of a bag again and again until a CSV file has ``size`` bytes.

    Args:
        bag: The bag.
        path: The file.
        size: Its size in bytes.
        set_back: Whether the clock begins again each time.

    Returns:
        The number of rows; the run is there three times at least.
    """
    log = read_log(bag)
    names = [f'{kind}{i + 1}' for kind in ('q', 'qd', 'tau') for i in range(log.q.shape[1])]
    values = np.hstack([log.q, log.qd, log.tau])
    texts = [','.join(f'{value:.9g}' for value in row) for row in values]
    span, rows = 0.0 if set_back else float(log.t[-1]) + _PAUSE, 0
    with path.open('w', encoding='ascii') as file:
        file.write(','.join(['t', *names]) + '\n')
        while rows < _LEAST * len(texts) or file.tell() < size:
            begin = span * (rows // len(texts))
            for t, text in zip(begin + log.t, texts, strict=True):
                file.write(f'{t:.6f},{text}\n')
            rows += len(texts)
    return rows


def grown_bag(bag: Bag, path: Path, size: int, set_back: bool = False) -> int:
    """Write the messages of a bag again and again until a new one has ``size`` bytes.

    Args:
        bag: The bag.
        path: The new one.
        size: Its size in bytes.
        set_back: Whether the stamps begin again each time.

    Returns:
        The number of states; the run is there three times at least.
    """
    messages = list(bag.messages())
    times = [message.log_time_ns for message in messages]
    span, again = max(times) - min(times) + round(1e9 * _PAUSE), 0
    states = sum(message.topic.endswith('joint_states') for message in messages)
    with BagWriter(path) as writer:
        for topic in bag.topics.values():
            writer.add_topic(topic.name, topic.type_name)
        while again < _LEAST or writer.file.stat().st_size < size:
            for message in messages:
                writer.write(message.topic, _later(message, 0 if set_back else again * span),
                             message.log_time_ns + again * span)
            again += 1
    return again * states


def _later(message: BagMessage, by: int) -> bytes:
    """Return the bytes of a message ``by`` ns later; those without a header as they are."""
    data = message.data
    if message.type_name != 'sensor_msgs/msg/JointState':
        return data
    time_format = f'{BYTE_ORDERS[data[:2]]}iI'
    seconds, nanoseconds = struct.unpack_from(time_format, data, HEADER_SIZE)
    moved = divmod(10**9 * seconds + nanoseconds + by, 10**9)
    end = HEADER_SIZE + struct.calcsize(time_format)
    return data[:HEADER_SIZE] + struct.pack(time_format, *moved) + data[end:]


def measured(arguments: Sequence[str]) -> Peak:
    """Return what a command of the package needs.

    Raises:
        BlfError: it fails.
    """
    begin, resident, own = time.perf_counter(), 0.0, 0.0
    with tempfile.TemporaryFile('w+') as said, subprocess.Popen(
            _command(arguments), stdout=subprocess.DEVNULL, stderr=said) as process:
        while process.poll() is None:
            sizes = dict(_sizes(process.pid))
            # The kernel keeps the peak of the one, not of the other.
            resident = max(resident, sizes.get('VmHWM', 0.0))
            own = max(own, sizes.get('RssAnon', 0.0))
            time.sleep(_LOOK)
        said.seek(0)
        _check(arguments, process.returncode, said.read())
    return Peak(resident, own, time.perf_counter() - begin)


def _sizes(pid: int) -> Iterator[tuple[str, float]]:
    """Yield what the kernel says of the memory of a process [MiB]."""
    with suppress(OSError):  # it has just ended
        for line in Path(f'/proc/{pid}/status').read_text().splitlines():
            name, *rest = line.split()
            if rest and rest[-1] == 'kB':
                yield name.rstrip(':'), float(rest[0]) / _MIB


def _command(arguments: Sequence[str]) -> list[str]:
    return [sys.executable, '-m', 'adaptive_blf_control', *arguments]


def _finish(arguments: Sequence[str]) -> None:
    done = subprocess.run(_command(arguments), capture_output=True, text=True, check=False)
    _check(arguments, done.returncode, done.stderr)


def _check(arguments: Sequence[str], status: int | None, said: str) -> None:
    broken_off = arguments[0] == 'recover' and status == 1  # as documented, docs/bags.md
    if status != 0 and not broken_off:
        raise BlfError(f'{" ".join(arguments)}: {said.strip()}')
