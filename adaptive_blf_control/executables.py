# SPDX-License-Identifier: Apache-2.0
"""The one table of executables: ``ros2 run``, ``python -m`` and ``setup.py`` all read it.

It imports nothing, because ``setup.py`` reads it on machines where numpy is not installed yet.
"""

from __future__ import annotations

__all__ = ['EXECUTABLES', 'NODES', 'TOOLS', 'console_scripts', 'module_of']

NODES: dict[str, str] = {
    'arm_driver': 'simulated arm: takes torque commands, publishes joint states',
    'identifier': 'learns the arm parameters from joint states, publishes theta_hat',
    'controller': 'barrier Lyapunov law: keeps every joint inside its sets',
    'recorder': 'writes every topic of the run into a rosbag2 MCAP bag',
}
"""Nodes: name to one line of help. Module: ``adaptive_blf_control.nodes.<name>``."""

TOOLS: dict[str, str] = {
    'demo': "the four nodes as separate processes on the paper's two-link task",
    'simulate': 'the closed loop of a scenario without ROS, as fast as it runs',
    'compare': 'our law against other laws, and the study of sensor noise',
    'identify': 'learn the parameters of a measured robot from its log',
    'play': 'publish a bag again with its clock, where there is no rosbag2',
    'recover': 'make a bag that a crash left unfinished readable again',
    'report': 'a page to look at, or figures for a paper, from bags alone',
    'parameters': 'the parameter tables of the nodes as Markdown',
    'soak': 'the four processes for an hour: memory, latency, every message accounted for',
    'bench': 'measure every figure of docs/benchmarks.md on this machine',
}
"""Command line tools: name to one line of help. Module: ``adaptive_blf_control.tools.<name>``."""

EXECUTABLES: dict[str, str] = {**NODES, **TOOLS}
"""All executables: name to one line of help."""


def module_of(executable: str) -> str:
    """Return the dotted module whose ``main(args) -> int`` is the executable.

    Args:
        executable: A key of :data:`EXECUTABLES`.

    Raises:
        KeyError: No such executable.
    """
    if executable not in EXECUTABLES:
        raise KeyError(executable)
    room = 'nodes' if executable in NODES else 'tools'
    return f'adaptive_blf_control.{room}.{executable}'


def console_scripts() -> list[str]:
    """Return the entry points in the form ``name = module:main`` that setuptools wants."""
    return [f'{name} = {module_of(name)}:main' for name in EXECUTABLES]
