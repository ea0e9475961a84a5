# SPDX-License-Identifier: Apache-2.0
"""The scenarios that come with the package."""

from __future__ import annotations

import os
from pathlib import Path
import sys

from adaptive_blf_control.calls import checked_call

__all__ = ['found', 'list_scenarios', 'scenario', 'shipped_names']


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


def found(path: str | Path) -> Path:
    """Return the parameter file that is meant: one that there is, else a shipped one of the name.

    Args:
        path: Where it is; ``two_link`` and ``config/two_link.yaml`` may be shipped ones.
    """
    path = Path(path)
    if not path.is_file() and str(path.parent) in ('.', 'config'):
        shipped = scenario(f'{path.name.removesuffix(".yaml")}.yaml')
        if shipped.is_file():
            return shipped
    return path


def shipped_names() -> list[str]:
    """Return the names of the scenarios that `found` finds: files with something to drive."""
    return sorted(path.stem for path in scenario('two_link.yaml').parent.glob('*.yaml')
                  if 'arm_driver:' in path.read_text(encoding='utf-8'))


@checked_call
def list_scenarios() -> tuple[str, ...]:
    """Return the names of the scenarios that come with the package.

    ``simulate('two_link')`` runs one; it is the parameter file ``config/two_link.yaml``, whose
    first lines say what it shows. Arms without a scenario are those of `list_arms`.

    Returns:
        Their names, in the order of the alphabet.
    """
    return tuple(shipped_names())
