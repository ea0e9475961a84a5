# SPDX-License-Identifier: Apache-2.0
"""The Python class of a message type that is known by its name only."""

from __future__ import annotations

import importlib
from typing import Any

from adaptive_blf_control.errors import BagError

__all__ = ['message_class']


def message_class(type_name: str) -> Any:
    """Return the class of a message type, e.g. ``sensor_msgs/msg/JointState``.

    Raises:
        BagError: it is not installed here.
    """
    package, _, name = type_name.partition('/msg/')
    try:
        return getattr(importlib.import_module(f'{package}.msg'), name)
    except (ImportError, AttributeError, ValueError):
        raise BagError(f'message type {type_name!r} is not installed here') from None
