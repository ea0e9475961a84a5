# SPDX-License-Identifier: Apache-2.0
"""Asks other nodes for all their parameters, each node once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from rclpy.task import Future

__all__ = ['ParameterSurvey']


class ParameterSurvey:
    """Parameter clients of one node; the answers come in the thread of its executor.

    Attributes:
        clients: By full name of the node that is asked.
    """

    def __init__(self, node: Node, answered: Callable[[str, dict[str, Any]], None]) -> None:
        """Ask nobody yet.

        Args:
            node: Which asks.
            answered: Called with the full name of a node and its parameters by name.
        """
        self.clients: dict[str, AsyncParameterClient] = {}
        self._node = node
        self._answered = answered
        self._asked: set[str] = set()

    def ask(self, name: str) -> None:
        """Ask the node of this full name once it is there; call it again until then."""
        if name in self._asked:
            return
        client = self.clients.get(name)
        if client is None:
            client = self.clients[name] = AsyncParameterClient(self._node, name)
        if client.services_are_ready():
            self._asked.add(name)
            client.list_parameters([], 0).add_done_callback(
                lambda future: self._on_names(name, client, future))

    def _on_names(self, node: str, client: AsyncParameterClient, future: Future) -> None:
        listed: ListParameters.Response = future.result()
        names = list(listed.result.names)
        client.get_parameters(names).add_done_callback(
            lambda answer: self._on_values(node, names, answer))

    def _on_values(self, node: str, names: list[str], future: Future) -> None:
        answer: GetParameters.Response = future.result()
        self._answered(node, {name: parameter_value_to_python(value)
                              for name, value in zip(names, answer.values)})
