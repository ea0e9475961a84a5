# SPDX-License-Identifier: Apache-2.0
"""A bar that shows on a terminal how far a command is; elsewhere, and without tqdm, nothing."""

from __future__ import annotations

import sys
from types import TracebackType
from typing import Any

__all__ = ['ProgressBar']


class ProgressBar:
    """A context that is called with how much is done, and how much there is.

    Nothing is shown of what is over within a second.
    """

    def __init__(self, unit: str) -> None:
        """Take what is counted, as one word."""
        self._unit = unit
        self._bar: Any = None

    def __enter__(self) -> ProgressBar:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        if self._bar is not None:
            self._bar.close()

    def __call__(self, done: int, total: int) -> None:
        """Show that ``done`` of ``total`` are done."""
        if self._bar is None:
            self._bar = _bar(total, self._unit)
        if self._bar is not None:
            self._bar.update(done - self._bar.n)


def _bar(total: int, unit: str) -> Any:
    try:
        from tqdm import tqdm
    except ImportError:  # it comes with the extra `campaign`; a log is read without it as well
        return None
    return tqdm(total=total, unit=unit, file=sys.stderr, disable=None, delay=1.0, leave=False,
                unit_scale=True)
