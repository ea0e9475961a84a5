# SPDX-License-Identifier: Apache-2.0
"""The bag that a recorder writes, with an account of what the disk did not take."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any

import yaml

from adaptive_blf_control.bags.writer import BagWriter
from adaptive_blf_control.configuration.parameter_file import PARAMETERS_KEY
from adaptive_blf_control.errors import BagError
from adaptive_blf_control.runtime.fault_log import FaultLog

__all__ = ['BagOutput']

LATEST = 2**63 - 2  # ns; a message with a wild time is one message, not the end of the recording


class BagOutput:
    """An open bag. After a first error nothing more is written, and what comes is counted.

    Attributes:
        bag: The writer.
        failure: Why recording stopped, '' while it goes on.
        unwritten: Messages by topic that the disk did not take.
    """

    def __init__(self, path: str, faults: FaultLog, failed: Callable[[str], None]) -> None:
        """Open the bag.

        Args:
            path: Folder of the bag.
            faults: Where what the disk did not take is counted, under ``disk``.
            failed: Called once with the reason where the disk cannot be written.

        Raises:
            BagError: the folder exists or cannot be made.
        """
        self.bag = BagWriter(path)
        self.failure = ''
        self.unwritten: dict[str, int] = {}
        self._faults = faults
        self._failed = failed
        self._parameters: dict[str, dict[str, Any]] = {}
        self._parameters_changed = False

    @property
    def nodes(self) -> set[str]:
        """Full names of the nodes whose parameters are kept."""
        return set(self._parameters)

    def keep_parameters(self, node: str, values: Mapping[str, Any]) -> None:
        """Keep the parameters of a node until the next flush writes them.

        May be called from any thread; the bag itself belongs to that of the loop.
        """
        plain = {name: list(value) if hasattr(value, '__len__') and not isinstance(value, str)
                 else value for name, value in values.items()}
        self._parameters[node] = {'ros__parameters': plain}
        self._parameters_changed = True

    def write(self, topic: str, type_name: str, qos: Callable[[], list[dict[str, Any]]],
              data: bytes, log_ns: int, publish_ns: int) -> None:
        """Write one message.

        Args:
            topic: Its topic, new to the bag or not.
            type_name: Type of the topic.
            qos: Returns what its publishers offer; called where the topic is new.
            data: CDR bytes.
            log_ns: When it was received [ns]; a time that the format cannot hold is brought to
                the nearest that it can.
            publish_ns: When it was sent [ns], likewise.
        """
        if self.failure:
            self._count_unwritten(topic, 1)
            return
        try:
            if topic not in self.bag.counts:
                self.bag.add_topic(topic, type_name, qos=qos())
            self.bag.write(topic, data, *(min(max(t, 0), LATEST) for t in (log_ns, publish_ns)))
        except BagError as error:
            self._count_unwritten(topic, 1)
            self._fail(str(error))

    def flush(self) -> None:
        """Bring everything to the disk."""
        if not self.failure:
            try:
                self._write_parameters()
                self.bag.flush()
            except BagError as error:
                self._fail(str(error))

    def close(self) -> None:
        """Close file, index and metadata."""
        for step in (self._write_parameters, self.bag.close):
            try:
                step()
            except BagError as error:
                self._fail(str(error))

    def discard(self) -> None:
        """Remove the bag, as if it had not been begun."""
        self.bag.discard()

    def _write_parameters(self) -> None:
        if self._parameters_changed:
            self._parameters_changed = False
            self.bag.set_custom_data(
                {PARAMETERS_KEY: yaml.safe_dump(dict(self._parameters), sort_keys=False)})

    def _count_unwritten(self, topic: str, count: int) -> None:
        self._faults.drops['disk'] = self._faults.drops.get('disk', 0) + count
        self.unwritten[topic] = self.unwritten.get(topic, 0) + count

    def _fail(self, reason: str) -> None:
        if not self.failure:
            self.failure = reason
            self._failed(reason)
            with suppress(BagError):  # which says the same again
                self.bag.close()
            for topic, count in self.bag.overcounted.items():
                self._count_unwritten(topic, count)
