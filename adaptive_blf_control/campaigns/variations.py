# SPDX-License-Identifier: Apache-2.0
"""What varies in a campaign: parameters of a scenario, and their values in each run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math
from pathlib import Path
import re
from typing import Any, NamedTuple

import numpy as np
import yaml

from adaptive_blf_control.bounded_yaml import load_yaml_text, read_yaml_text
from adaptive_blf_control.campaigns.distributions import (
    Distribution,
    read_distribution,
    unit_numbers,
)
from adaptive_blf_control.configuration.build_arm import build_arm
from adaptive_blf_control.configuration.node_settings import DriverSettings, NODE_SETTINGS, TABLES
from adaptive_blf_control.configuration.parameter_file import node_settings, node_values
from adaptive_blf_control.errors import ParameterError, UnknownParameter
from adaptive_blf_control.parameters.table import Parameter, per_joint, value_problem
from adaptive_blf_control.simulation.true_arm import true_theta

__all__ = ['Drawn', 'SAMPLINGS', 'Variation', 'draw', 'read_vary_file', 'variations']

NUMERIC = ('double', 'int', 'double_array')
SAMPLINGS = ('independent', 'latin_hypercube')
TRUE_PARAMETERS = 'arm_driver.true_parameters'
_SOME_ELEMENTS = re.compile(r'(.+)\[(\d+)(?::(\d+))?\]')


@dataclass(frozen=True)
class Variation:
    """How one parameter, or some elements of it, vary.

    Attributes:
        name: As in the file: ``node.parameter``, for some elements with [i] or [i:j] behind it.
        parameter: ``node.parameter``.
        elements: Those that vary.
        row: Its declaration.
        distribution: Of the value, or of what the scenario's value is changed by.
        relative: ``scale`` and ``offset`` change the scenario's value, '' replaces it.
        nominal: The scenario's value, one number for each element.
        together: One number for all elements instead of one for each.
    """

    name: str
    parameter: str
    elements: range
    row: Parameter
    distribution: Distribution
    relative: str
    nominal: tuple[float, ...]
    together: bool

    def values(self, columns: Sequence[Sequence[Any]], before: Sequence[Any] | None) -> list[Any]:
        """Return the value in each run.

        Args:
            columns: Drawn values of each element, or of all together, over the runs.
            before: The value in each run as other variations of this parameter left it, None
                where there are none.
        """
        return [self._value(drawn, self.nominal if before is None else before[run])
                for run, drawn in enumerate(zip(*columns))]

    def _value(self, drawn: tuple[Any, ...], before: Sequence[float]) -> Any:
        if isinstance(drawn[0], (list, tuple)):
            return list(drawn[0])
        if self.row.kind not in NUMERIC:
            return [drawn[0]] if self.row.is_array else drawn[0]
        value: list[Any] = list(before)
        for place, i in enumerate(self.elements):
            value[i] = self._element(drawn[place % len(drawn)], self.nominal[i])
        return value if self.row.is_array else value[0]

    def shown(self, columns: Sequence[Sequence[Any]], values: Sequence[Any]) -> dict[str, Any]:
        """Return what varied as columns over the runs, by name.

        That is a factor or an offset of several elements, else the value of each element.

        Args:
            columns: As drawn, see `values`.
            values: What `values` made of them.
        """
        if self.relative and self.together and len(self.elements) > 1:
            return {f'{self.name} {self.relative}': list(columns[0])}
        if not isinstance(values[0], list):
            return {self.name: list(values)}
        places = self.elements if self.row.kind in NUMERIC else range(len(values[0]))
        if max(map(len, values)) != min(map(len, values)) or len(places) > len(values[0]):
            return {self.name: list(map(str, values))}  # lists of different lengths
        one = len(values[0]) == 1
        return {self.parameter if one else f'{self.parameter}[{i}]': [
            value[i] for value in values] for i in places}

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
    varied = [_variation(str(name), entry, data) for name, entry in given['vary'].items()]
    for i, each in enumerate(varied):
        for other in varied[:i]:
            if each.parameter == other.parameter and set(each.elements) & set(other.elements):
                raise ParameterError(each.name, each.name,
                                     f'elements that {other.name} does not vary')
    return varied


def _split(name: str) -> tuple[str, slice | None]:
    """Return the parameter of a name, and the elements that it names."""
    some = _SOME_ELEMENTS.fullmatch(name)
    if some is None:
        return name, None
    first = int(some[2])
    return some[1], slice(first, first + 1 if some[3] is None else int(some[3]))


def _chosen(name: str, some: slice | None, nominal: Sequence[float]) -> range:
    """Return the elements that vary of those that a parameter has."""
    whole = range(len(nominal))
    if some is None:
        return whole
    if not 0 <= some.start < some.stop <= len(nominal):
        raise ParameterError(name, name, f'[i] or [i:j] with 0 <= i < j <= {len(nominal)}, the '
                             'number of elements')
    return whole[some]


def _variation(name: str, entry: Any, data: Mapping[str, Any]) -> Variation:
    whole, some = _split(name)
    row = _declared(whole, data)
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
    nominal = tuple(_nominal(whole, row, data)) if numeric else (math.nan,)
    if some is not None and not (numeric and row.is_array):
        raise ParameterError(name, name, f'{whole} as a whole')
    if some is not None and any(isinstance(value, (list, tuple))
                                for value in distribution.arguments):
        raise ParameterError(name, list(distribution.arguments), 'numbers for single elements')
    return Variation(name, whole, _chosen(name, some, nominal), row, distribution, relative,
                     nominal, together or distribution.kind in ('choice', 'grid')
                     or not row.is_array)


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


class Drawn(NamedTuple):
    """What was drawn for the runs of a campaign.

    Attributes:
        changes: The parameters of each run that differ from the scenario, by name.
        shown: The same as columns to look at, see `Variation.shown`: values over the runs.
    """

    changes: list[dict[str, Any]]
    shown: dict[str, list[Any]]


def draw(varied: Sequence[Variation], runs: int, seed: int,
         sampling: str = 'independent') -> Drawn:
    """Draw the varied parameters of each run.

    Run i of a seed has the same values on every worker. A ``grid`` runs through all
    combinations with the other grids, over and over.

    Raises:
        ParameterError: a drawn value, or an end of a distribution that has ends, is one that the
            parameter does not take.
    """
    columns: dict[str, list[Any]] = {}
    shown: dict[str, list[Any]] = {}
    period = 1
    for each in varied:
        if grid := each.distribution.grid:
            drawn = [[grid[i // period % len(grid)] for i in range(runs)]]
            period *= len(grid)
        else:
            names = [each.name] if each.together else [f'{each.parameter}[{i}]'
                                                       for i in each.elements]
            drawn = [each.distribution.quantile(unit_numbers(
                runs, seed, name, sampling == 'latin_hypercube')) for name in names]
        values = each.values(drawn, columns.get(each.parameter))
        _check(each, values, 'of run {}')
        ends = each.values([each.distribution.ends()] * len(drawn), None)
        _check(each, ends, 'at an end of its distribution')
        shown.update(each.shown(drawn, values))
        columns[each.parameter] = values
    changes = [dict(zip(columns, row)) for row in zip(*columns.values())]
    if TRUE_PARAMETERS in columns:
        for change in changes:
            change['arm_driver.true_model'] = 'given'
    return Drawn(changes, shown)


def _check(varied: Variation, values: Sequence[Any], what: str) -> None:
    for number, value in enumerate(values):
        problem = value_problem(varied.row, value, {})
        if problem:
            raise ParameterError(f'{varied.name} {what.format(number)}', value,
                                 f'{problem}: change its distribution')
