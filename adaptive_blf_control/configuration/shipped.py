# SPDX-License-Identifier: Apache-2.0
"""The scenarios that come with the package."""

from __future__ import annotations

import os
from pathlib import Path
import sys

__all__ = ['scenario']


def scenario(name: str) -> Path:
    """Find ``config/<name>`` in the source tree or in an installed share folder."""
    package = Path(__file__).resolve().parents[1]
    for folder in (package.parent / 'config',
                   Path(sys.prefix) / 'share/adaptive_blf_control/config',
                   *(Path(prefix) / 'share/adaptive_blf_control/config'
                     for prefix in os.environ.get('AMENT_PREFIX_PATH', '').split(':') if prefix)):
        if (folder / name).is_file():
            return folder / name
    return Path('config') / name
