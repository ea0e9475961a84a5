# SPDX-License-Identifier: Apache-2.0
"""The nodes as processes, each begun before the laws that it runs are loaded.

Loading them takes longer than anything else at the start. Meanwhile DDS finds the other nodes, so
that a node knows soon after whether it is the only one of its kind.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

from adaptive_blf_control.runtime.process import run_node, Runnable

__all__ = ['arm_control', 'arm_driver', 'controller', 'identifier', 'recorder']


def _main(kind: str, class_name: str) -> Callable[[list[str] | None], int]:
    """Return the main function of a class in the module ``kind`` beside this one."""
    def make(**options: Any) -> Runnable:
        module = import_module(f'{__package__}.{kind}')
        node: Runnable = getattr(module, class_name)(**options)
        return node

    def main(args: list[str] | None = None) -> int:
        return run_node(kind, make, args)

    return main


arm_control = _main('arm_control', 'ArmControl')
arm_driver = _main('arm_driver', 'ArmDriver')
controller = _main('controller', 'ControllerNode')
identifier = _main('identifier', 'IdentifierNode')
recorder = _main('recorder', 'Recorder')
