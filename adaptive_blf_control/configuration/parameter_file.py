# SPDX-License-Identifier: Apache-2.0
"""ROS parameter files read without ROS, by the same rules: later sections win.

A section applies to a node when its key is ``/**``, the node's name, or ends in ``/NAME``. Our
files use ``/**/NAME``, which ROS also matches under a namespace. A name in ``/**`` has to be known
to at least one node; a name in a node's own section to that node.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
import copy
from pathlib import Path
import re
from typing import Any, TypeVar

import yaml

from adaptive_blf_control.bounded_yaml import BoundedLoader, load_yaml_text, read_yaml_text
from adaptive_blf_control.configuration.node_settings import NODE_SETTINGS, RuntimeSettings, TABLES
from adaptive_blf_control.configuration.section_names import meant_node
from adaptive_blf_control.configuration.shipped import found, shipped_names
from adaptive_blf_control.errors import close_names, ParameterError, UnknownParameter
from adaptive_blf_control.parameters.settings import Settings
from adaptive_blf_control.parameters.table import (
    bounds_of,
    declares,
    JOINT,
    Parameter,
    per_joint,
    plain,
    validated,
    value_problem,
)

__all__ = ['PARAMETERS_KEY', 'ROS_OWN', 'apply_changes', 'apply_settings', 'checked_sections',
           'declared_in', 'flattened', 'given_values', 'known_elsewhere', 'load_yaml',
           'load_yamls', 'node_settings', 'node_values']


Kind = TypeVar('Kind', bound=RuntimeSettings)
PARAMETERS_KEY = 'ros__parameters'  # a run's parameter file in a bag's custom_data
# What ROS itself declares on every node; accepted everywhere, used by nothing here.
ROS_OWN = ('use_sim_time', 'start_type_description_service', 'qos_overrides.')


class _Loader(BoundedLoader):
    """Takes ``1e-5`` for a number, as YAML 1.2 and the parameter files of ROS do."""


_Loader.add_implicit_resolver(
    'tag:yaml.org,2002:float', re.compile(r'[-+]?(\.\d+|\d+(\.\d*)?)[eE][-+]?\d+$'),
    list('-+.0123456789'))


def _loaded(text: str) -> Any:
    return load_yaml_text(text, _Loader)


def load_yaml(path: str | Path, name: str = 'parameter file') -> dict[str, Any]:
    """Read a parameter file; ParameterError names the file and line where it is malformed.

    Args:
        path: Where it is, or the name of a shipped one, see `found`.
        name: What the caller calls it, for the message.
    """
    path = found(path)
    try:
        data = _loaded(read_yaml_text(path))
    except OSError as error:
        raise ParameterError(name, str(path), f'a readable YAML file ({error.strerror})'
                             + _or_shipped(path)) from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ParameterError(name, str(path), f'well-formed YAML: {error}') from None
    return checked_sections(data, name, str(path))


def _or_shipped(path: Path) -> str:
    """Return which scenarios are shipped, where a name alone was given."""
    names = shipped_names()
    if path.exists() or not names or str(path.parent) != '.':
        return ''
    close = close_names(path.stem, names)
    return (f', did you mean {" or ".join(close)}?' if close else
            f', or a scenario that is shipped: {", ".join(names)}')


def load_yamls(paths: Iterable[str | Path], name: str = 'parameter file') -> dict[str, Any]:
    """Read parameter files of which later ones change what earlier ones say, as ROS takes them."""
    merged: dict[str, Any] = {}
    for path in paths:
        _merge(merged, load_yaml(path, name))
    return merged


def _merge(into: dict[str, Any], changes: Mapping[str, Any]) -> None:
    for key, value in changes.items():
        if isinstance(value, Mapping) and isinstance(into.get(key), dict):
            _merge(into[key], value)
        else:
            into[key] = value


def checked_sections(data: Any, name: str, source: object) -> dict[str, Any]:
    """Return a parameter file's data; ParameterError where it is not what ROS takes.

    Args:
        data: Sections by node, each with one key ``ros__parameters``.
        name: What the caller calls it, for the message.
        source: Where it comes from, likewise.
    """
    if not isinstance(data, Mapping):
        raise ParameterError(name, source, 'a mapping of node names to ros__parameters')
    for key, section in data.items():
        if not isinstance(key, str):
            raise ParameterError(name, source, f'a name of a node, not {key!r}')
        if close := meant_node(key):
            raise ParameterError(name, source, f'names of nodes, not {key!r}: did you mean '
                                 f'{close}?')
        if not isinstance(section, Mapping) or set(section) != {'ros__parameters'} or \
                not isinstance(section['ros__parameters'], Mapping):
            raise ParameterError(name, source,
                                 f'under {key!r} one key ros__parameters with a mapping')
    return dict(data)


def flattened(mapping: Mapping[str, Any], prefix: str = '', *,
              empty: bool = False) -> Iterator[tuple[str, Any]]:
    """Yield what nested mappings and settings hold, each value with its dotted name.

    Args:
        mapping: Values, mappings and settings by name.
        prefix: What the names begin with.
        empty: Whether a mapping without members is a value.
    """
    for key, value in mapping.items():
        if isinstance(value, Settings):
            value = value.values()
        if isinstance(value, Mapping) and (value or not empty):
            yield from flattened(value, f'{prefix}{key}.', empty=empty)
        else:
            yield f'{prefix}{key}', value


def _applies(key: str, node: str) -> bool:
    return key in ('/**', node) or key.endswith(f'/{node}')


def given_values(data: Mapping[str, Any], node: str) -> dict[str, Any]:
    """Return what a parameter file gives to ``node``, flat, without what only others know.

    Raises:
        ParameterError: a name that the section's nodes do not declare.
    """
    joints = _joints(data, node)
    given: dict[str, Any] = {}
    for key, section in data.items():
        if not _applies(key, node):
            continue
        for name, value in flattened(section['ros__parameters']):
            if key == '/**' and not _knows(TABLES[node], name, joints):
                if not any(_knows(table, name, joints) for table in TABLES.values()):
                    raise UnknownParameter(name, value, _all_names(joints))
                continue
            given[name] = value
    return given


def _all_names(joints: list[str]) -> list[str]:
    """Return the parameters of all nodes; one that a single node has, with its name."""
    owners: dict[str, list[str]] = {}
    for node, table in TABLES.items():
        for name in per_joint(table, joints):
            owners.setdefault(name, []).append(node)
    return [f'{nodes[0]}.{name}' if len(nodes) == 1 else name for name, nodes in owners.items()]


def _joints(data: Mapping[str, Any], node: str) -> list[str]:
    joints: Any = None
    for key, section in data.items():
        if _applies(key, node):
            joints = section['ros__parameters'].get('joints', joints)
    if joints is None:
        joints = next((p.default for p in TABLES[node] if p.name == 'joints'), [])
    return [j for j in joints if isinstance(j, str)] if isinstance(joints, list) else []


def known_elsewhere(name: str, node: str) -> bool:
    """Return whether ``node`` does not declare ``name`` while another node does."""
    return not _knows(TABLES[node], name, []) and any(
        _knows(table, name, []) for table in TABLES.values())


def _knows(table: tuple[Parameter, ...], name: str, joints: list[str]) -> bool:
    return name.startswith(ROS_OWN) or name in per_joint(table, joints) or any(
        p.name.split(JOINT)[0] == name.split('.')[0] + '.' and JOINT in p.name for p in table)


def node_settings(data: Mapping[str, Any], kind: type[Kind]) -> Kind:
    """Return the settings of one kind of node from a parameter file, e.g. `DriverSettings`.

    Raises:
        ParameterError: names the parameter, the value and what is expected.
    """
    node = next(name for name, cls in NODE_SETTINGS.items() if cls is kind)
    return kind.from_values(node_values(data, node))


def node_values(data: Mapping[str, Any], node: str) -> dict[str, Any]:
    """Return all validated parameters of one node from a parameter file, by name."""
    given = given_values(data, node)
    given = {name: value for name, value in given.items() if not name.startswith(ROS_OWN)}
    table = per_joint(TABLES[node], _joints(data, node))
    joints = given.get('joints', next((p.default for p in table.values() if p.name == 'joints'),
                                      []))
    problem = value_problem(table['joints'], joints, {}) if 'joints' in table else None
    if problem:  # said first: most other names and lengths hang on it
        raise ParameterError(f'{node}.joints', joints, problem)
    return validated(table.values(), given, node, {'joints': len(joints)})


def apply_settings(data: Mapping[str, Any], settings: Iterable[str]) -> dict[str, Any]:
    """Apply ``[node.]name=value`` settings to a parameter file's data.

    Without a node's name a setting goes to every node that knows it. Values are YAML, and a number
    is taken where a list or a floating-point number is meant: ``controller.k2=30``.

    Returns:
        Changed data; what was given stays as it is.
    """
    changed = copy.deepcopy(dict(data))
    for setting in settings:
        name, equals, text = setting.partition('=')
        if not equals or not name:
            raise ParameterError('--set', setting, 'NODE.NAME=VALUE')
        try:
            value = _loaded(text)
        except yaml.YAMLError:
            raise ParameterError('--set', setting, 'a YAML value after =') from None
        _put(changed, *_change(name, value))
    return changed


def apply_changes(data: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Apply changes as a Python program writes them to a parameter file's data.

    Args:
        data: A parameter file's data; it stays as it is.
        changes: Values by ``[node.]name``, or nested as in YAML: scalars, integers and arrays
            are taken where a list of doubles is meant, settings where a group is meant, and
            ``(-1.0, 1.0)`` for ``lower`` and ``upper``.

    Raises:
        UnknownParameter: a group is given without members, which would change nothing.
    """
    changed = copy.deepcopy(dict(data))
    for name, value in flattened(changes, empty=True):
        if name in TABLES and value == {}:
            continue  # a node all of whose parameters stay
        bounds = bounds_of(value) or {}
        if bounds and all(_rows(f'{name}.{end}') for end in bounds):
            for end, bound in bounds.items():
                _put(changed, *_change(f'{name}.{end}', bound))
        else:
            _put(changed, *_change(name, value))
    return changed


def _change(name: str, value: Any) -> tuple[str, str, Any]:
    """Return the node (``**`` for every one), the parameter and the value that are meant."""
    if isinstance(value, Mapping) and not value:
        raise UnknownParameter(name, value, _all_names([]))
    rows = _rows(name)
    return *_place(name), plain(rows[0].kind, value) if rows else value


def _place(name: str) -> tuple[str, str]:
    """Return the node that ``[node.]name`` is for, ``**`` for every one, and the name in it."""
    head, _, tail = name.partition('.')
    return (head, tail) if head in TABLES and tail else ('**', name)


def _rows(name: str) -> list[Parameter]:
    return [row for _, row in declared_in(name)]


def declared_in(name: str) -> list[tuple[str, Parameter]]:
    """Return the declarations that ``[node.]name`` may mean, each with its node."""
    node, key = _place(name)
    nodes = [node] if node in TABLES else list(TABLES)
    return [(each, row) for each in nodes for row in TABLES[each] if declares(row, key)]


def _put(data: dict[str, Any], node: str, key: str, value: Any) -> None:
    home = data.setdefault('/**' if node == '**' else f'/**/{node}', {'ros__parameters': {}})
    # Other sections that apply to the node may come later in the file, and later ones win.
    others = [section for name, section in data.items()
              if (node == '**' or name == node or name.endswith(f'/{node}'))
              and key in dict(flattened(section['ros__parameters']))]
    for section in (home, *others):
        _merge(section['ros__parameters'], _nested(key, value))


def _nested(name: str, value: Any) -> dict[str, Any]:
    for part in reversed(name.split('.')):
        value = {part: value}
    return dict(value)

