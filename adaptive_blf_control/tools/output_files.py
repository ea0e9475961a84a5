# SPDX-License-Identifier: Apache-2.0
"""Files that a command writes: looked at before the work, and never replaced unasked."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from adaptive_blf_control.errors import ParameterError

__all__ = ['check_writable', 'write_output']


def check_writable(paths: Mapping[str, Path | None], overwrite: bool) -> None:
    """Refuse paths that cannot be written.

    Args:
        paths: Files, or folders, to be written later, by the option that gives them.
        overwrite: Whether they may be replaced.

    Raises:
        ParameterError: a folder is missing, a path exists and may not be replaced, or two options
            give the same one.
    """
    given: dict[Path, str] = {}
    for option, path in paths.items():
        if path is None:
            continue
        if not path.parent.is_dir():
            raise ParameterError(option, str(path), 'a file in a folder that exists')
        if path.exists() and not overwrite:
            raise ParameterError(option, str(path), 'a file that is not there yet: --overwrite '
                                 f'replaces it, {option} FILE names another')
        other = given.setdefault(path.resolve(), option)
        if other != option:
            raise ParameterError(option, str(path), f'another file than {other}')


def write_output(option: str, path: Path, content: str | Callable[[Path], Any]) -> None:
    """Write a text, or call what writes the path; ParameterError where it cannot be written."""
    try:
        if isinstance(content, str):
            path.write_text(content, encoding='utf-8')
        else:
            content(path)
    except OSError as error:
        raise ParameterError(option, str(path), f'a file that can be written '
                             f'({error.strerror})') from None
