# SPDX-License-Identifier: Apache-2.0
"""The storage files of a bag: which belong together, and what is in them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path
import re

from adaptive_blf_control.bags import mcap_file, sqlite_file
from adaptive_blf_control.bags.compression import is_packed, PACKED_SUFFIXES, unpack_file
from adaptive_blf_control.bags.mcap_file import McapFile
from adaptive_blf_control.bags.metadata import load_metadata
from adaptive_blf_control.bags.sqlite_file import SqliteFile
from adaptive_blf_control.errors import BagError, GIT_LFS_POINTER

__all__ = ['check_contiguous', 'listed', 'named_file', 'open_file', 'storage_files']

OVERLAP, PAUSE = 10**9, 60 * 10**9  # ns between two parts of a recording
_START = 40  # bytes that tell what a file is


def open_file(path: Path) -> McapFile | SqliteFile:
    """Return the reader of a storage file, which may be compressed.

    Raises:
        BagError: names the file and what it is instead.
    """
    if path.exists() and not path.is_file():
        raise BagError(f'{path} is not a regular file: expected a bag')
    try:
        with path.open('rb') as stream:
            start = stream.read(_START)
    except OSError as exc:
        raise BagError(f'{path}: cannot be read: {exc.strerror}') from exc
    unpacked = None
    if is_packed(start):
        unpacked = unpack_file(path)
        unpacked.seek(0)
        start = unpacked.read(_START)
    if start.startswith(mcap_file.MAGIC):
        return McapFile(path, unpacked)
    if start.startswith(sqlite_file.MAGIC):
        return SqliteFile(path, unpacked)
    if not start:
        raise BagError(f'{path} is an empty file: expected a bag')
    if start.startswith(GIT_LFS_POINTER):
        raise BagError(f'{path} is a Git LFS pointer, not the file: fetch it with "git lfs pull"')
    if start.startswith(b'\x1f\x8b'):
        raise BagError(f'{path} is packed with gzip: unpack it with "gunzip"')
    what = 'a ROS 1 bag' if start.startswith(b'#ROSBAG') else f'first bytes {start[:8]!r}'
    raise BagError(f'{path} is not a ROS 2 bag ({what}): expected a rosbag2 folder, an .mcap or '
                   'a .db3 file')


def named_file(folder: Path, name: str) -> Path | None:
    """Return the file that metadata.yaml names, else its unpacked or packed twin, or None.

    ``ros2 bag play`` leaves the unpacked file beside the one it unpacks.
    """
    name = Path(name).name  # before version 4 the paths began with the folder's name
    plain = _plain(name)
    candidates = (plain, name, *(plain + suffix for suffix in PACKED_SUFFIXES))
    return next((folder / each for each in candidates if (folder / each).exists()), None)


def storage_files(folder: Path) -> list[Path]:
    """Return the storage files of a folder in the order of their numbers.

    Raises:
        BagError: there is none, or they are of several recordings: without a metadata.yaml that
            lists them all, their names may differ in the number only.
    """
    found: dict[str, Path] = {}
    for file in sorted(folder.iterdir()):
        if Path(_plain(file.name)).suffix in ('.mcap', '.db3') and file.is_file():
            found.setdefault(_plain(file.name), file)  # an unpacked file sorts before a packed one
    if not found:
        raise BagError(f'{folder} is not a bag: it has no .mcap or .db3 file')
    recordings = {re.sub(r'_\d+(?=\.\w+$)', '', name) for name in found}
    if len(recordings) > 1 and not set(found) <= listed(folder):
        raise BagError(f'{folder} holds several recordings: {", ".join(sorted(found))}: expected '
                       'files of one bag, whose names differ in their number only: name one file')

    def number(name: str) -> tuple[int, str]:
        match = re.search(r'_(\d+)$', Path(name).stem)
        return (int(match[1]) if match else 0, name)

    return [found[name] for name in sorted(found, key=number)]


def check_contiguous(spans: Iterable[tuple[Path, int, int]]) -> None:
    """Refuse files that cannot be parts of one recording, by their times.

    rosbag2 begins a file with the message after the last one of the file before.

    Args:
        spans: File, first and last time of reception [ns], in order; of files with messages.

    Raises:
        BagError: a file begins long after, or before, the end of the one before it.
    """
    before: tuple[Path, int] | None = None
    for path, first, last in spans:
        if before is not None and not -OVERLAP <= first - before[1] <= PAUSE:
            raise BagError(f'{path.parent} holds several recordings: {path.name} begins '
                           f'{(first - before[1]) / 1e9:.7g} s after the end of '
                           f'{before[0].name}: name one file')
        before = path, last


def listed(folder: Path) -> set[str]:
    """Return the files that metadata.yaml lists, without suffixes of compression; maybe none."""
    names: Sequence[str] = ()
    with suppress(BagError):  # it may be missing or damaged
        names = [item.path for item in load_metadata(folder).files]
    return {_plain(Path(name).name) for name in names}


def _plain(name: str) -> str:
    """Return the name of a file without the suffix of its compression."""
    return Path(name).stem if name.endswith(PACKED_SUFFIXES) else name


