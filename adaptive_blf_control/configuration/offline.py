# SPDX-License-Identifier: Apache-2.0
"""Which parameters a run without nodes looks at: the others would be accepted without effect."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from adaptive_blf_control.arms.settings import ArmSettings
from adaptive_blf_control.configuration.node_settings import TABLES
from adaptive_blf_control.configuration.parameter_file import declared_in, flattened
from adaptive_blf_control.control.settings import ControllerSettings
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.settings import IdentifierSettings
from adaptive_blf_control.parameters.settings import Settings
from adaptive_blf_control.simulation.settings import PlantSettings

__all__ = ['refuse_unused']

# The core of each node, and what else of its parameters the closed loop and its bag depend on.
_CORE: dict[str, tuple[type[Settings], ...]] = {
    'arm_driver': (PlantSettings, ArmSettings), 'controller': (ControllerSettings, ArmSettings),
    'identifier': (IdentifierSettings, ArmSettings), 'recorder': ()}
_BESIDES = {
    'arm_driver': ('rate', 'duration'),
    'controller': ('model', 'known_parameters', 'initial_estimate', 'monitor_decimation', 'loop.'),
    'identifier': ('initial_estimate_file', 'external_torque_decimation', 'payload.'),
    'recorder': ()}
_INSTEAD = {'bag': ": simulate(..., bag='run') writes a bag"}


_OF_ARM = {row.name for row in ArmSettings.table()}
_OF_PLANT = {row.name for row in PlantSettings.table()}


def _used(node: str) -> set[str]:
    core = {row.name for kind in _CORE[node] for row in kind.table()}
    return core | {row.name for row in TABLES[node] if row.name.startswith(_BESIDES[node])}


def refuse_unused(changes: Mapping[str, Any], *, arm: object = None, plant: object = None) -> None:
    """Raise ParameterError for a change that nothing in the run would look at.

    Args:
        changes: As `apply_changes` takes them; names that nobody knows are left to it.
        arm: The arm where it is given as an object.
        plant: The plant, where it is given as an object that has been made.
    """
    for name, value in flattened(changes):
        nodes = declared_in(name)
        key = name.partition('.')[2] if name.partition('.')[0] in TABLES else name
        if nodes and not any(row.name in _used(node) for node, row in nodes):
            raise ParameterError(name, value, f'nothing: only the node {nodes[0][0]} uses it, '
                                 f'and simulate runs no nodes{_INSTEAD.get(key, "")}')
        names = {row.name for _, row in nodes}
        if arm is not None and names and names <= _OF_ARM:
            raise ParameterError(name, value, 'nothing: the arm is given as it is, by '
                                 f'{type(arm).__name__}')
        if plant is not None and names and names <= _OF_PLANT and {
                node for node, _ in nodes} == {'arm_driver'}:
            raise ParameterError(name, value, 'nothing: the plant is given as it is, by '
                                 f'{type(plant).__name__}')
