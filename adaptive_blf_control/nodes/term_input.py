# SPDX-License-Identifier: Apache-2.0
"""The identifier's side of ``controller/adaptation_term``: each term is kept for its states."""

from __future__ import annotations

from collections import deque

import numpy as np

from adaptive_blf_control.compiled import all_finite
from adaptive_blf_control.configuration.node_settings import IdentifierNodeSettings
from adaptive_blf_control.control.source_gate import SourceGate
from adaptive_blf_control.errors import BagError
from adaptive_blf_control.messages.topics import ADAPTATION_TERM
from adaptive_blf_control.messages.usual_joint_state import UsualJointStateReader
from adaptive_blf_control.runtime.data_node import DataNode
from adaptive_blf_control.runtime.data_topics import QUEUE_DEPTH
from adaptive_blf_control.runtime.heard_topic import HeardTopic

__all__ = ['TermInput']


class TermInput:
    """Adaptation terms Xᵀe2 of (37); each acts over the interval that follows its stamp.

    Attributes:
        terms: The latest, as stamp [ns] and term, shape (m,). Several, because each state of a
            backlog needs the term of its own time.
        heard: Whose terms are believed.
    """

    def __init__(self, node: DataNode[IdentifierNodeSettings],
                 parameters: tuple[str, ...]) -> None:
        """Take the node, for its settings and its faults, and the names of the parameters."""
        self.terms: deque[tuple[int, np.ndarray]] = deque(maxlen=QUEUE_DEPTH)
        self._node = node
        all_finite(np.zeros(len(parameters)))  # compile here, not between two samples
        self._reader = UsualJointStateReader(parameters)
        self.heard = HeardTopic(node, ADAPTATION_TERM, SourceGate('adaptation term'),
                                lambda: node.settings.adaptation_term_timeout)

    def receive(self, data: bytes, info: dict[str, int]) -> None:
        """Keep a term; one that is not finite or of another arm is dropped."""
        try:
            stamp, term, _, _ = self._reader.read(data)
        except BagError as error:
            self._node.faults.drop('unusable adaptation term', str(error))
            return
        second = None if self._node.lockstep else self.heard.refuse(self._reader.source, info)
        if second is not None:
            self._node.faults.refuse(second)
        else:
            self.take(stamp, term)

    def take(self, stamp: int, term: np.ndarray) -> None:
        """Keep a term, shape (m,), of the state of ``stamp`` [ns]; drop one that is not finite."""
        if all_finite(term):
            self.terms.append((stamp, term))
        else:
            self._node.faults.drop('non-finite adaptation term', 'the last one is kept')

    def held(self, stamp: int) -> np.ndarray | None:
        """Return the newest term sent before ``stamp`` [ns], which was held until then.

        None if there is none, or if it is older than ``adaptation_term_timeout``.
        """
        for sent, term in reversed(self.terms):
            if sent < stamp:
                timeout = self._node.settings.adaptation_term_timeout
                return term if (stamp - sent) * 1e-9 <= timeout else None
        return None

    def misses(self, before: int, stamp: int) -> bool:
        """Whether the state of ``stamp`` has to wait for the term of the one before it (lockstep).

        That term comes no more once a later one has arrived, nor for a state that is sent again
        or at which time starts again.

        Args:
            before: Stamp of the state before [ns]; 0 if there was none.
            stamp: Stamp of this state [ns].
        """
        return (0 < before < stamp and all(sent < before for sent, _ in self.terms)
                and self._node.count_publishers(ADAPTATION_TERM) > 0)

    def forget_from(self, stamp: int) -> None:
        """Forget the terms from ``stamp`` [ns] on: time starts again, they are of another run."""
        self.terms = deque((term for term in self.terms if term[0] < stamp), maxlen=QUEUE_DEPTH)
