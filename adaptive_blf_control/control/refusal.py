# SPDX-License-Identifier: Apache-2.0
"""Why something that was received is not used."""

from __future__ import annotations

from typing import NamedTuple

__all__ = ['Refusal']


class Refusal(NamedTuple):
    """A reason that is counted, and what it was this time.

    Attributes:
        reason: The same words each time, e.g. ``joint state out of order``.
        detail: With the numbers.
        fault: Whether the sender is at fault in a way that has to be remembered.
    """

    reason: str
    detail: str
    fault: bool = False
