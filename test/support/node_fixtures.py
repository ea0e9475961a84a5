# SPDX-License-Identifier: Apache-2.0
"""Fixtures of `real_nodes`; a test that asks for one is skipped where there is no ROS."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import importlib
from pathlib import Path
from types import ModuleType
from typing import Any, TYPE_CHECKING

import pytest

from patience import wait_until as wait_for

if TYPE_CHECKING:
    from real_nodes import Graph, Processes


@pytest.fixture(scope='session')
def real_nodes() -> ModuleType:
    """Return the module of that name, imported when the first test needs it."""
    pytest.importorskip('rclpy', reason='no ROS 2 here: the nodes cannot run')
    return importlib.import_module('real_nodes')


@pytest.fixture(scope='session')
def wait_until() -> Callable[..., Any]:
    """Return ``wait_until(condition, what='')``: a limit instead of a sleep."""
    return wait_for


@pytest.fixture
def pair_urdf(real_nodes: ModuleType) -> str:
    """Return the URDF of an arm with the joints shoulder and elbow."""
    return real_nodes.pair_urdf()


@pytest.fixture
def graph(real_nodes: ModuleType) -> Iterator[Graph]:
    """Return a private graph for nodes in threads."""
    graph = real_nodes.Graph()
    yield graph
    graph.close()


@pytest.fixture(scope='module')
def graph_of_all(real_nodes: ModuleType) -> Iterator[Graph]:
    """Return a private graph that the tests of a module share."""
    graph = real_nodes.Graph()
    yield graph
    graph.close()


@pytest.fixture
def graph_of(real_nodes: ModuleType) -> Iterator[Callable[[int], Graph]]:
    """Return ``graph_of(domain)``: the test's nodes in the domain of some processes."""
    graphs: list[Graph] = []

    def make(domain: int) -> Graph:
        graphs.append(real_nodes.Graph(domain))
        return graphs[-1]

    yield make
    for graph in graphs:
        graph.close()


@pytest.fixture
def processes(real_nodes: ModuleType, tmp_path: Path) -> Iterator[Processes]:
    """Return a starter of processes in a private domain."""
    processes = real_nodes.Processes(tmp_path)
    yield processes
    processes.close()
