# SPDX-License-Identifier: Apache-2.0
"""The load over time, as an identifier has published it into a bag."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.bags.reader import Bag
from adaptive_blf_control.errors import BagError
from adaptive_blf_control.messages.inertia import decode_inertia
from adaptive_blf_control.messages.topics import PAYLOAD, PAYLOAD_STD
from adaptive_blf_control.runs.bag_run import topic_named

__all__ = ['payload_masses']


def payload_masses(bag: Bag) -> tuple[np.ndarray, np.ndarray] | None:
    """Return stamps (N,) [ns] and mass with its standard deviation (N, 2) [kg].

    None where no load was looked for: the topics are missing or have no message.

    Raises:
        BagError: a message cannot be read.
    """
    masses, stds = (_masses(bag, topic) for topic in (PAYLOAD, PAYLOAD_STD))
    both = sorted(set(masses) & set(stds))
    if not both:
        return None
    return (np.array(both, dtype=np.int64),
            np.array([[masses[stamp], stds[stamp]] for stamp in both]))


def _masses(bag: Bag, topic: str) -> dict[int, float]:
    """Return the masses of a topic by stamp; none where the topic is missing."""
    try:
        name = topic_named(bag, topic)
    except BagError:
        return {}
    found = (decode_inertia(message.data) for message in bag.messages((name,)))
    return {each.stamp_ns: each.mass for each in found}
