# SPDX-License-Identifier: Apache-2.0
"""Where the machine code of compiled functions is kept between two processes.

numba keeps the machine code of a function with the functions that it calls in it, but looks only
at the file of the function itself before it uses what it kept: after an update it would still run
the old barrier inside the new law. Here each module has a folder of its own, whose name is the
digest of every source that its machine code can come from.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager, ExitStack, suppress
import fcntl
from functools import cache
import hashlib
import os
from pathlib import Path
import re
import shutil

__all__ = ['alone_with', 'cache_folder']

PACKAGE = Path(__file__).parent
# Where the compiled functions are.
ROOMS = ('arms', 'control', 'identification', 'limits', 'messages', 'simulation')
# What checks, names and says things for Python callers; no compiled function has anything of it.
NEVER_COMPILED = ('bounded_yaml', 'calls', 'errors', 'parameters', 'spelling', 'synonyms',
                  'time_units')

_IMPORT = re.compile(r'^\s*from adaptive_blf_control\.?(\S*) import (\(?)([^#\n(]*)', re.MULTILINE)
_BY_TYPE = re.compile(r'^@by_type\ndef (\w+)', re.MULTILINE)
_REGISTERED = re.compile(r'(\w+)\.register\(')


def cache_folder(module: str) -> str:
    """Return the folder for the machine code of a module's functions, '' where none can be had.

    It is beside the package where that can be written, so that it goes with the package, and else
    in the cache folder of the user (``XDG_CACHE_HOME``). There it begins as a copy of what the
    installation of the package compiled, if it did.

    Args:
        module: Full name of the module; one outside of this package depends on all sources.
    """
    for root in (PACKAGE / '__pycache__' / 'machine_code', _of_user()):
        folder = root / f'{module.removeprefix("adaptive_blf_control.")}_{_digest(module)}'
        try:
            made = not folder.is_dir()
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if not os.access(folder, os.W_OK):
            continue
        if made:
            _tidy(folder)
            _take_over(PACKAGE / '__pycache__' / 'machine_code' / folder.name, folder)
        return str(folder)
    return ''


@contextmanager
def alone_with(folder: str, name: str) -> Iterator[None]:
    """Keep other processes from compiling the same function meanwhile.

    Four nodes that start together need much of the same: who comes second finds it compiled.

    Args:
        folder: That of `cache_folder`; '' where nothing is kept.
        name: Of the function.
    """
    with ExitStack() as stack:
        with suppress(OSError):  # a full disk, or a file system without locks: everybody compiles
            if folder:
                lock = stack.enter_context(Path(folder, f'{name}.lock').open('w'))
                fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def _of_user() -> Path:
    place = os.environ.get('XDG_CACHE_HOME') or os.path.expanduser('~/.cache')
    installation = hashlib.sha256(str(PACKAGE).encode()).hexdigest()[:8]
    return Path(place) / 'adaptive_blf_control' / installation


def _tidy(folder: Path) -> None:
    """Remove what older sources of the same module left beside its new ``folder``."""
    name = folder.name.rpartition('_')[0]
    for other in folder.parent.glob(f'{name}_' + '[0-9a-f]' * 16):
        if other != folder:
            shutil.rmtree(other, ignore_errors=True)


def _take_over(source: Path, folder: Path) -> None:
    """Copy what a read-only installation compiled; numba takes no folder it cannot write."""
    if source != folder and source.is_dir():
        with suppress(OSError, shutil.Error):  # what could not be copied is compiled
            shutil.copytree(source, folder, dirs_exist_ok=True)


@cache
def _digest(module: str) -> str:
    """Return the digest of all sources that the machine code of a module can come from."""
    path = _path(module.removeprefix('adaptive_blf_control.'))
    known = path is not None and path.relative_to(PACKAGE).parts[0] in ROOMS
    sources = _reached([path]) if path is not None and known else _all_sources()
    digest = hashlib.sha256()
    for source in sorted(sources.union((PACKAGE / 'compiled').glob('*.py'))):
        digest.update(str(source.relative_to(PACKAGE)).encode() + b'\0' + _text(source).encode())
    return digest.hexdigest()[:16]


def _reached(start: Iterable[Path]) -> set[Path]:
    """Return ``start``, the sources that it imports, and those that they call by type.

    A function by type has its implementations in modules that import it, not the other way round.
    """
    reached: set[Path] = set()
    ahead = list(start)
    while ahead:
        source = ahead.pop()
        if source in reached:
            continue
        reached.add(source)
        ahead += _imports(source)
        by_type = _names(_BY_TYPE, source)
        ahead += [other for other in _all_sources() if by_type and source in _imports(other)
                  and by_type & _names(_REGISTERED, other)]
    return reached


@cache
def _names(pattern: re.Pattern[str], source: Path) -> frozenset[str]:
    """Return what a pattern finds in a source: each is asked about for many modules."""
    return frozenset(pattern.findall(_text(source)))


@cache
def _all_sources() -> frozenset[Path]:
    return frozenset(source for room in ROOMS for source in (PACKAGE / room).rglob('*.py'))


@cache
def _imports(source: Path) -> frozenset[Path]:
    """Return the sources of this package that ``source`` imports from."""
    found: set[Path] = set()
    for module, parenthesis, names in _IMPORT.findall(_text(source)):
        path = _path(module)
        if module.partition('.')[0] in NEVER_COMPILED:
            continue
        if path is not None:
            found.add(path)
        elif parenthesis:  # the names are on the next lines: any module of that room
            found.update((PACKAGE / module.replace('.', '/')).glob('*.py'))
        else:
            parts = (_path(f'{module}.{name.split()[0]}') for name in names.split(',') if name)
            found.update(part for part in parts if part is not None)
    return frozenset(found)


def _path(module: str) -> Path | None:
    path = PACKAGE / f'{module.replace(".", "/")}.py'
    return path if path.is_file() else None


@cache
def _text(source: Path) -> str:
    return source.read_text(encoding='utf-8')
