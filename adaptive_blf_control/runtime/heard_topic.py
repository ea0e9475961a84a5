# SPDX-License-Identifier: Apache-2.0
"""A topic of which one publisher is believed, and who else publishes on it."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
import time

from adaptive_blf_control.control.refusal import Refusal
from adaptive_blf_control.control.source_gate import SourceGate
from adaptive_blf_control.runtime.data_node import DataNode
from adaptive_blf_control.runtime.endpoints import Endpoints, UNNAMED

__all__ = ['HeardTopic']

RECENT = 3.0  # s for which the diagnostics name a refused publisher


class HeardTopic:
    """What a node hears on one topic.

    Attributes:
        gate: Chooses whom to believe.
    """

    def __init__(self, node: DataNode, topic: str, gate: SourceGate,
                 timeout: Callable[[], float], *, others_belong: bool = False) -> None:
        """Take what tells the publishers apart.

        Args:
            node: That hears the topic.
            topic: Its name.
            gate: For its messages.
            timeout: Returns the silence after which another source may follow [s].
            others_belong: Whether others may publish other things there, as a gripper does with
                its joint states; then only a refused message shows a second source.
        """
        self.gate = gate
        self._node = node
        self._topic = topic
        self._timeout = timeout
        self._others_belong = others_belong
        self._publishers = Endpoints(partial(node.get_publishers_info_by_topic, topic))

    def refuse(self, source: bytes, info: dict[str, int]) -> Refusal | None:
        """Return why a message that says it is of ``source`` is not believed; None where it is."""
        return self.gate.refuse(source, info.get('publication_sequence_number'), time.monotonic(),
                                self._timeout(), self.alone,
                                self._node.listening_since)

    def alone(self) -> bool:
        """Whether the topic has one publisher at most."""
        return self._node.count_publishers(self._topic) <= 1

    def second_source(self) -> str:
        """Return which nodes publish where one is to be heard; '' where there is no second one."""
        refused = time.monotonic() - self.gate.refused_at < RECENT
        names = [name or UNNAMED for name in self._publishers.names()]
        if len(names) > 1 and (refused or not self._others_belong):
            return f'several publishers of {self._topic}: {", ".join(sorted(names))}'
        return f'a second publisher of {self._topic}, gone by now' if refused else ''
