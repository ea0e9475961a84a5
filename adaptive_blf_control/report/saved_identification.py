# SPDX-License-Identifier: Apache-2.0
"""An identification that was saved before: the figures in its page, or what ``--json`` printed."""

from __future__ import annotations

from contextlib import suppress
import json
from pathlib import Path
import re
from typing import Any

from adaptive_blf_control.bags.metadata import METADATA_NAME
from adaptive_blf_control.errors import LogError

__all__ = ['MAKES_PAGE', 'saved_identification']

MAKES_PAGE = 'identify LOG --urdf FILE --html page.html --png FOLDER'
"""The command that makes page and pictures of an identification."""
_PAGES, _MODELS = ('.html', '.htm'), ('.yaml', '.yml', '.urdf')
_FIGURES = re.compile(r'<script type="application/json" id="figures">(.*?)</script>', re.DOTALL)
_NEEDED = ('joints', 'theta_hat', 'history_rank', 'test_rmse')


def saved_identification(path: Path) -> dict[str, Any] | None:
    """Return the figures of an identification, None where the path may be a bag.

    Args:
        path: A page of ``identify --html`` or a file with the output of ``identify --json``.

    Raises:
        LogError: it is a page or a file of another kind, or it cannot be read; says what to call.
    """
    suffix = path.suffix.lower()
    if path.is_dir() or path.name == METADATA_NAME or suffix not in (*_PAGES, *_MODELS, '.json'):
        return None
    if suffix in _MODELS:
        raise LogError(f'{path} holds a model, not how well it predicts: {MAKES_PAGE} shows that')
    try:
        text = path.read_text(encoding='utf-8')
    except (OSError, UnicodeError) as exc:
        raise LogError(f'{path}: cannot be read: {getattr(exc, "strerror", None) or exc}') from exc
    if suffix in _PAGES:
        match = _FIGURES.search(text)
        text = match[1] if match else ''
    figures: Any = None
    with suppress(ValueError, RecursionError):
        figures = json.loads(text)
    if isinstance(figures, dict) and all(name in figures for name in _NEEDED):
        return figures
    if suffix in _PAGES and isinstance(figures, dict) and 'bags' in figures:
        raise LogError(f'{path} is the page of a run: open it in a browser; report BAG makes '
                       'another')
    raise LogError(f'{path} has no figures of an identification: expected a bag, or what '
                   f'{MAKES_PAGE} or identify ... --json has written')
