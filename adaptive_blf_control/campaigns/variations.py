# SPDX-License-Identifier: Apache-2.0
"""What varies in a campaign: parameters of a scenario, and their values in each run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from adaptive_blf_control.bounded_yaml import load_yaml_text, read_yaml_text
from adaptive_blf_control.campaigns.distributions import (
    Distribution,
    read_distribution,
    unit_numbers,
)
from adaptive_blf_control.configuration.build import build_arm
from adaptive_blf_control.configuration.node_settings import DriverSettings, NODE_SETTINGS, TABLES
from adaptive_blf_control.configuration.parameter_file import node_settings, node_values
from adaptive_blf_control.errors import ParameterError, UnknownParameter
from adaptive_blf_control.parameters.table import Parameter, per_joint, value_problem
from adaptive_blf_control.simulation.true_arm import true_theta

__all__ = ['SAMPLINGS', 'Variation', 'draw', 'read_vary_file', 'variations']

NUMERIC = ('double', 'int', 'double_array')
SAMPLINGS = ('independent', 'latin_hypercube')
TRUE_PARAMETERS = 'arm_driver.true_parameters'


@dataclass(frozen=True)
class Variation:
    """How one parameter varies.

    Attributes:
        name: ``node.parameter``.
        row: Its declaration.
        distribution: Of the value, or of what the scenario's value is changed by.
        relative: ``scale`` and ``offset`` change the scenario's value, '' replaces it.
        nominal: The scenario's value, one number for each element.
        together: One number for all elements instead of one for each.
    """

    name: str
    row: Parameter
    distribution: Distribution
    relative: str
    nominal: tuple[float, ...]
    together: bool

    def values(self, columns: Sequence[Sequence[Any]]) -> list[Any]:
        """Return the value in each run.

        Args:
            columns: Drawn values of each element, or of all together, over the runs.
        """
        return [self._value(drawn) for drawn in zip(*columns)]

    def _value(self, drawn: tuple[Any, ...]) -> Any:
        if isinstance(drawn[0], (list, tuple)):
            return list(drawn[0])
        if self.row.kind not in NUMERIC:
            return [drawn[0]] if self.row.is_array else drawn[0]
        elements = [self._element(drawn[i % len(drawn)], nominal)
                    for i, nominal in enumerate(self.nominal)]
        return elements if self.row.is_array else elements[0]

    def _element(self, drawn: float, nominal: float) -> float | int:
        value = {'scale': nominal * drawn, 'offset': nominal + drawn, '': drawn}[self.relative]
        return int(round(value)) if self.row.kind == 'int' else float(value)


def read_vary_file(path: Path) -> dict[str, Any]:
    """Read what varies; ParameterError where the file cannot be read or is no mapping."""
    try:
        given = load_yaml_text(read_yaml_text(path))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ParameterError('--vary', str(path), f'a readable YAML file ({error})') from None
    if not isinstance(given, Mapping) or set(given) - {'sampling', 'vary'} or not isinstance(
            given.get('vary'), Mapping) or not given['vary']:
        raise ParameterError('--vary', str(path),
                             'a mapping with vary: distributions by parameter, and sampling')
    return dict(given)


def variations(given: Mapping[str, Any], data: Mapping[str, Any]) -> list[Variation]:
    """Return what a vary file says of a scenario.

    Args:
        given: What `read_vary_file` returned.
        data: The scenario's parameter file.

    Raises:
        ParameterError: a parameter is not known, or a distribution cannot be used for it.
    """
    if given.get('sampling', 'independent') not in SAMPLINGS:
        raise ParameterError('sampling', given['sampling'], f'one of {", ".join(SAMPLINGS)}')
    return [_variation(str(name), entry, data) for name, entry in given['vary'].items()]


def _variation(name: str, entry: Any, data: Mapping[str, Any]) -> Variation:
    row = _declared(name, data)
    if not isinstance(entry, Mapping):
        raise ParameterError(name, entry, 'a distribution, e.g. {uniform: [0.5, 2.0]}')
    rest = dict(entry)
    together = rest.pop('together', False)
    if not isinstance(together, bool):
        raise ParameterError(f'{name}.together', together, 'true or false')
    relative = next((key for key in ('scale', 'offset') if key in rest), '')
    distribution = read_distribution(name, rest[relative] if relative else rest)
    numeric = row.kind in NUMERIC
    if relative and (len(rest) != 1 or not numeric):
        raise ParameterError(name, dict(entry), f'{relative} alone, of a parameter of numbers')
    nominal = tuple(_nominal(name, row, data)) if numeric else (math.nan,)
    return Variation(name, row, distribution, relative, nominal,
                     together or distribution.kind in ('choice', 'grid') or not row.is_array)


def _declared(name: str, data: Mapping[str, Any]) -> Parameter:
    node, _, key = name.partition('.')
    if node not in TABLES or not key:
        raise ParameterError(name, name, f'NODE.PARAMETER with one of {", ".join(TABLES)}')
    joints = node_values(data, node).get('joints', [])
    table = per_joint(TABLES[node], joints)
    if key not in table:
        raise UnknownParameter(name, name, table)
    return table[key]


def _nominal(name: str, row: Parameter, data: Mapping[str, Any]) -> list[float]:
    """Return the scenario's value of a parameter of numbers, one for each element."""
    node, _, key = name.partition('.')
    driver = node_settings(data, DriverSettings)
    arm = build_arm(driver)
    if name == TRUE_PARAMETERS:
        return list(map(float, true_theta(driver.replace(payload=0.0), arm)))
    settings = node_settings(data, NODE_SETTINGS[node])
    value = settings.resolved(joints=arm.n, parameters=arm.m).values()[key]
    return [float(each) for each in np.atleast_1d(np.asarray(value, dtype=float))]


def draw(varied: Sequence[Variation], runs: int, seed: int,
         sampling: str = 'independent') -> list[dict[str, Any]]:
    """Return the varied parameters of each run, by name.

    Run i of a seed has the same values on every worker. A ``grid`` runs through all
    combinations with the other grids, over and over.

    Raises:
        ParameterError: a drawn value is one that the parameter does not take.
    """
    columns: dict[str, list[Any]] = {}
    period = 1
    for each in varied:
        if grid := each.distribution.grid:
            drawn = [[grid[i // period % len(grid)] for i in range(runs)]]
            period *= len(grid)
        else:
            parts = [''] if each.together else [f'[{i}]' for i in range(len(each.nominal))]
            drawn = [each.distribution.quantile(unit_numbers(
                runs, seed, each.name + part, sampling == 'latin_hypercube')) for part in parts]
        columns[each.name] = each.values(drawn)
        _check(each, columns[each.name])
    changes = [dict(zip(columns, row)) for row in zip(*columns.values())]
    if TRUE_PARAMETERS in columns:
        for change in changes:
            change['arm_driver.true_model'] = 'given'
    return changes


def _check(varied: Variation, values: Sequence[Any]) -> None:
    for run, value in enumerate(values):
        problem = value_problem(varied.row, value, {})
        if problem:
            raise ParameterError(f'{varied.name} of run {run}', value,
                                 f'{problem}: change its distribution')
