# SPDX-License-Identifier: Apache-2.0
"""The table of executables, which ``ros2 run``, ``python -m`` and ``setup.py`` all read.

It imports nothing, because ``setup.py`` reads it on machines where numpy is not installed yet.
"""

from __future__ import annotations

__all__ = ['BENCHES', 'COMPOSED', 'EXECUTABLES', 'NODES', 'TOOLS', 'console_scripts', 'entry_of']

NODES: dict[str, str] = {
    'arm_driver': 'simulated arm: takes torque commands, publishes joint states',
    'identifier': 'learns the arm parameters from joint states, publishes theta_hat',
    'controller': 'barrier Lyapunov law: keeps every joint inside its sets',
    'recorder': 'writes every topic of the run into a rosbag2 MCAP bag',
}
"""Nodes: name to one line of help. Function: ``adaptive_blf_control.nodes.start.<name>``."""

COMPOSED: dict[str, str] = {
    'arm_control': 'controller and identifier in one process: the fastest answer',
}
"""Several nodes in one process: name to one line of help, function as of a node."""

TOOLS: dict[str, str] = {
    'demo': "the four nodes as separate processes on the paper's two-link task",
    'configure': 'a parameter file for any URDF arm, with the reason of each gain',
    'excite': 'a motion to record, from which a model can be learned',
    'simulate': 'the closed loop of a scenario without ROS, as fast as it runs',
    'campaign': 'thousands of runs of a scenario with parameters that vary',
    'identify': 'learn the parameters of a measured robot from its log',
    'play': 'publish a bag again with its clock, on machines without rosbag2',
    'recover': 'make a bag that a crash left unfinished readable again',
    'report': 'an HTML page, or figures for a paper, from bags alone',
    'precompile': 'compile the laws for this machine, so that no first run has to',
    'parameters': 'the parameter tables of the nodes as Markdown',
    'topics': 'the topics of the nodes as Markdown, or as an SROS 2 policy',
}
"""Command line tools: name to one line of help. Module: ``adaptive_blf_control.tools.<name>``."""

BENCHES: dict[str, str] = {
    'compare': 'our law against other laws, and the study of sensor noise',
    'attack': 'strangers attack the four processes while an observer judges the commands',
    'soak': 'the four processes for an hour: memory, latency, every message accounted for',
    'bench': 'measure every figure of docs/benchmarks.md on this machine',
}
"""Benchmarks and studies: name to one line of help, in ``adaptive_blf_control.bench.<name>``."""

EXECUTABLES: dict[str, str] = {**NODES, **COMPOSED, **TOOLS, **BENCHES}
"""All executables: name to one line of help."""


def entry_of(executable: str) -> tuple[str, str]:
    """Return the dotted module and the function in it, ``(args) -> int``, of an executable.

    Args:
        executable: A key of :data:`EXECUTABLES`.

    Raises:
        KeyError: No such executable.
    """
    if executable in {**NODES, **COMPOSED}:
        return 'adaptive_blf_control.nodes.start', executable
    if executable not in EXECUTABLES:
        raise KeyError(executable)
    room = 'tools' if executable in TOOLS else 'bench'
    return f'adaptive_blf_control.{room}.{executable}', 'main'


def console_scripts() -> list[str]:
    """Return the entry points in the form ``name = module:function`` that setuptools wants."""
    return [f'{name} = {":".join(entry_of(name))}' for name in EXECUTABLES]
