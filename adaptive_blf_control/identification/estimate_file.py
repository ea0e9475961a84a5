# SPDX-License-Identifier: Apache-2.0
"""θ̂ as a YAML file that a later run can start from, matched by parameter name."""

from __future__ import annotations

from collections.abc import Mapping
import contextlib
from datetime import datetime, timezone
import json
import os
from pathlib import Path
import re
import threading
from typing import Any

import numpy as np

from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.given_parameters import load_estimate, theta_of
from adaptive_blf_control.identification.knowledge import Snapshot

__all__ = ['estimate_path', 'recent_estimate', 'write_estimate', 'write_text']

FOLDER = 'adaptive_blf_control'
FILE = 'theta_hat.yaml'
LONGEST_HEAD = 4096  # bytes within which theta_hat begins
OURS = re.compile(rb'^theta_hat:', re.MULTILINE)
PLAIN = re.compile(r'(?!(?i:y|yes|n|no|on|off|true|false|null)$)[A-Za-z][A-Za-z0-9_]*$')


def estimate_path(text: str, namespace: str, environment: Mapping[str, str],
                  name: str = 'identifier.estimate_file', file: str = FILE) -> Path:
    """Return the file that a parameter as ``estimate_file`` stands for.

    Args:
        text: The parameter; a leading ``~`` is the home folder. Empty: ``file`` in
            ``adaptive_blf_control/NAMESPACE`` below ``ROS_HOME``, ``~/.ros`` where that is not
            set, so that neither the present folder is littered nor an estimate lost.
        namespace: Of the node, e.g. ``/left``.
        environment: ``ROS_HOME`` and ``HOME`` are looked at.
        name: Of the parameter, for messages.
        file: Name of the file where the parameter is empty.

    Raises:
        ParameterError: a home folder is needed and not known.
    """
    ros_home = environment.get('ROS_HOME', '')
    if not text:
        folder = _at_home(ros_home or '~/.ros', environment, name)
        return folder.joinpath(FOLDER, *filter(None, namespace.split('/')), file)
    return _at_home(text, environment, name)


def _at_home(text: str, environment: Mapping[str, str], name: str) -> Path:
    if text != '~' and not text.startswith('~/'):
        return Path(text)
    home = environment.get('HOME', '')
    if not home:
        raise ParameterError(name, text,
                             'a path without ~ where HOME is not set')
    return Path(home, text[2:])


def _number(value: float) -> str:
    # Shortest text that comes back to the last bit; YAML 1.1 takes 1e-05 for a string.
    text = repr(float(value))
    if text == 'inf':
        return '.inf'
    return text.replace('e', '.0e') if 'e' in text and '.' not in text else text


def _content(snapshot: Snapshot, written_at: str, std: np.ndarray | None) -> str:
    # yaml.safe_dump takes milliseconds and holds the interpreter meanwhile.
    names = [name if PLAIN.match(name) else json.dumps(name, ensure_ascii=False)
             for name in snapshot.parameters]

    def mapping(key: str, values: np.ndarray) -> list[str]:
        return [f'{key}:', *(f'  {name}: {_number(value)}'
                             for name, value in zip(names, values.tolist(), strict=True))]

    return '\n'.join([
        *([f'written_at: {json.dumps(written_at, ensure_ascii=False)}'] if written_at else []),
        *mapping('theta_hat', snapshot.theta),
        *([] if std is None else mapping('theta_std', std)),
        f'history_rank: {snapshot.rank}', f'history_sigma_min: {_number(snapshot.sigma_min)}',
        f'insertions: {snapshot.insertions}', ''])


def write_estimate(path: Path, snapshot: Snapshot, written_at: str = '', *,
                   std: np.ndarray | None = None, make_folder: bool = False) -> None:
    """Write θ̂ with the state of its history so that a reader never sees half a file.

    When it returns the file is on the disk: it survives a crash of the machine. May be called
    from any thread; where it fails, the file of before is left and nothing beside it.

    Args:
        path: The file; replaced if it exists and is an estimate or empty.
        snapshot: From :meth:`Identifier.snapshot`.
        written_at: The present time in ISO 8601 with its offset from UTC, '' for none.
        std: Standard deviation of each parameter, shape (m,), infinite where it is not
            determined; None writes none.
        make_folder: Make the folders above ``path`` if they are missing.

    Raises:
        OSError: the file cannot be written, or is none that may be replaced.
    """
    if make_folder:
        _make_folder(path.parent)
    _check_replaceable(path)
    write_text(path, _content(snapshot, written_at, std))


def _check_replaceable(path: Path) -> None:
    """Raise OSError for a file that is no estimate: a wrong path must not cost what is there."""
    if not os.path.exists(path) or path.is_dir():  # which cannot be replaced
        return
    if path.is_file() and path.stat().st_size == 0:
        return
    if not path.is_file():
        raise OSError(None, 'exists and is not a regular file', str(path))
    with path.open('rb') as file:
        start = file.read(LONGEST_HEAD)
    if not OURS.search(start):
        raise OSError(None, 'exists and holds no estimate: it is not replaced', str(path))


def write_text(path: Path, text: str) -> None:
    """Write a file so that a reader sees all of it or that of before; otherwise as above."""
    temporary = path.with_name(f'.{path.name}.{os.getpid()}.{threading.get_ident()}')
    try:
        with temporary.open('w', encoding='utf-8') as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    _sync_folder(path.parent)


def _make_folder(folder: Path) -> None:
    if not folder.is_dir():
        _make_folder(folder.parent)
        folder.mkdir(exist_ok=True)
        _sync_folder(folder.parent)


def _sync_folder(folder: Path) -> None:
    with contextlib.suppress(OSError):  # some network file systems know no such thing
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def recent_estimate(path: Path, parameters: tuple[str, ...], now: str,
                    within: float) -> np.ndarray | None:
    """Read θ̂ of an identifier that was killed a moment ago, to go on from there.

    Args:
        path: Its file.
        parameters: Names in the order wanted.
        now: The present time in ISO 8601 with its offset from UTC.
        within: Largest age of the file [s], by what is written in it; 0 for never. The clock may
            have been set meanwhile: a file from the future is as old as it is ahead.

    Returns:
        θ̂, shape (m,); None where there is no such file or it is too old.

    Raises:
        ParameterError: the file cannot be read, does not tell when it was written, or is recent
            and lacks a parameter.
    """
    name = 'identifier.estimate_file'
    if within <= 0.0 or not os.path.exists(path):
        return None
    content = load_estimate(path, name)
    age = _seconds(now) - _written_at(content, path, name)
    return theta_of(content, path, parameters, name) if abs(age) <= within else None


def _written_at(content: Any, path: Path, name: str) -> float:
    try:
        return _seconds(str(content['written_at']))
    except (KeyError, TypeError, ValueError):
        raise ParameterError(name, str(path),
                             "an entry 'written_at' with a time in ISO 8601") from None


def _seconds(time: str) -> float:
    moment = datetime.fromisoformat(time)
    return (moment if moment.tzinfo else moment.replace(tzinfo=timezone.utc)).timestamp()
