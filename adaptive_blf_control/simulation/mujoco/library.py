# SPDX-License-Identifier: Apache-2.0
"""MuJoCo, which only its plant needs."""

from __future__ import annotations

from typing import Any

from adaptive_blf_control.errors import MissingExtra

__all__ = ['load_mujoco']


def load_mujoco() -> Any:
    """Import MuJoCo.

    Raises:
        MissingExtra: It is not installed.
    """
    try:
        import mujoco
    except ImportError as error:
        raise MissingExtra('mujoco', 'mujoco', 'arm_driver.plant: mujoco') from error
    mujoco.set_mju_user_warning(_ignore)
    return mujoco


def _ignore(warning: str) -> None:
    """Take a warning that MuJoCo would write to a file: what it is about is looked at instead."""
