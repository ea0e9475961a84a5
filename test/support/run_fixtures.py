# SPDX-License-Identifier: Apache-2.0
"""Fixtures of `made_up_runs` and `browser`, imported when the first test needs them."""

from __future__ import annotations

from collections.abc import Callable
import importlib
from pathlib import Path
import shutil
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from browser import Visit


@pytest.fixture(scope='session')
def make_bag() -> Callable[..., Path]:
    """Return the function that writes a made-up run."""
    return importlib.import_module('made_up_runs').write_run


@pytest.fixture(scope='session')
def bag(make_bag: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a whole bag of 2 s."""
    return make_bag(tmp_path_factory.mktemp('whole') / 'run')


@pytest.fixture(scope='session')
def other_bag(make_bag: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a bag of a run that leaves its performance set."""
    return make_bag(tmp_path_factory.mktemp('left') / 'left_run', error=0.25)


@pytest.fixture(scope='session')
def browse(tmp_path_factory: pytest.TempPathFactory) -> Callable[[Path, str], Visit]:
    """Return a function that opens a page in headless Chromium and runs a script in it."""
    program = next(filter(None, map(shutil.which, (
        'chromium', 'chromium-browser', 'google-chrome'))), None)
    if program is None:
        pytest.skip('no Chromium is installed')
    browser = importlib.import_module('browser')
    return browser.Browser(program, tmp_path_factory.mktemp('browser')).visit
