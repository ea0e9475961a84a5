# SPDX-License-Identifier: Apache-2.0
"""Asks other nodes for all their parameters, each node once."""

from __future__ import annotations

from collections.abc import Callable, Collection
import time
from typing import Any, NamedTuple

from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.client import Client
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.task import Future

__all__ = ['ParameterSurvey']

ANSWER_TIMEOUT = 10.0  # s until a node that has not answered is asked once more: it may have ended


class _Clients(NamedTuple):
    names: Client
    values: Client

    @property
    def ready(self) -> bool:
        return self.names.service_is_ready() and self.values.service_is_ready()


class ParameterSurvey:
    """Parameter clients of one node; it asks, and gets the answers, in the thread of its executor.

    Attributes:
        clients: By full name of the node that is asked, until it has answered or is gone: each
            takes 0.1 MB, and more with every node of that name that starts later.
    """

    def __init__(self, node: Node, answered: Callable[[str, dict[str, Any]], None]) -> None:
        """Prepare; no node is asked yet.

        Args:
            node: Which asks.
            answered: Called with the full name of a node and its parameters by name.
        """
        self.clients: dict[str, _Clients] = {}
        self._node = node
        self._answered = answered
        self._asked: dict[str, float] = {}  # since when, monotonic [s]
        self._done: set[str] = set()

    def ask(self, there: Collection[str]) -> None:
        """Ask the nodes of these full names, all that are there; call it again now and then.

        Hidden ones, those of command lines for example, serve no parameters and are not asked.
        """
        for name in [name for name in self.clients if name in self._done or name not in there]:
            self._end(name)
            if name not in self._done:
                self._asked.pop(name, None)
        for name in sorted(there):
            if not name.rpartition('/')[2].startswith('_'):
                self._ask(name)

    def _ask(self, name: str) -> None:
        if name in self._asked:
            if name not in self._done and time.monotonic() - self._asked[name] > ANSWER_TIMEOUT:
                self._end(name)
                del self._asked[name]
            return
        if name not in self.clients:
            self.clients[name] = _Clients(
                self._node.create_client(ListParameters, f'{name}/list_parameters'),
                self._node.create_client(GetParameters, f'{name}/get_parameters'))
        clients = self.clients[name]
        if clients.ready:
            self._asked[name] = time.monotonic()
            clients.names.call_async(ListParameters.Request()).add_done_callback(
                lambda future: self._on_names(name, clients, future))

    def _end(self, name: str) -> None:
        """Destroy the clients of a node; not in the answer to one of them."""
        for client in self.clients.pop(name, ()):
            self._node.destroy_client(client)

    def _on_names(self, node: str, clients: _Clients, future: Future) -> None:
        listed: ListParameters.Response = future.result()
        names = list(listed.result.names)
        clients.values.call_async(GetParameters.Request(names=names)).add_done_callback(
            lambda answer: self._on_values(node, names, answer))

    def _on_values(self, node: str, names: list[str], future: Future) -> None:
        answer: GetParameters.Response = future.result()
        self._done.add(node)
        self._answered(node, {name: parameter_value_to_python(value)
                              for name, value in zip(names, answer.values)})
