# SPDX-License-Identifier: Apache-2.0
"""A node's parameter table in ROS: declared, validated at start and while the node runs."""

from __future__ import annotations

import array
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
import math
from pathlib import Path
from typing import Any, TypeVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    ParameterType,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
import yaml

from adaptive_blf_control.bounded_yaml import load_yaml_text, read_yaml_text
from adaptive_blf_control.configuration.node_settings import RuntimeSettings, TABLES
from adaptive_blf_control.configuration.parameter_file import (
    known_elsewhere,
    load_yaml,
    node_values,
    ROS_OWN,
)
from adaptive_blf_control.configuration.section_names import (
    check_sections_reach,
    reaches,
    unknown_sections,
)
from adaptive_blf_control.errors import BlfError, ParameterError, UnknownParameter
from adaptive_blf_control.parameters.table import (
    LONGEST_LIST,
    Parameter,
    per_joint,
    validated,
    value_problem,
)
from adaptive_blf_control.runtime.rclpy_internals import overrides_of

__all__ = ['check_all_reached', 'check_files', 'declare', 'descriptor', 'explain_files',
           'ill_formed', 'on_change', 'refuse_untyped']

NodeSettings = TypeVar('NodeSettings', bound=RuntimeSettings)
ROS_TYPES = {
    'bool': ParameterType.PARAMETER_BOOL,
    'int': ParameterType.PARAMETER_INTEGER,
    'double': ParameterType.PARAMETER_DOUBLE,
    'string': ParameterType.PARAMETER_STRING,
    'double_array': ParameterType.PARAMETER_DOUBLE_ARRAY,
    'string_array': ParameterType.PARAMETER_STRING_ARRAY,
}
SIM_TIME = 'use_sim_time'  # rclpy's own, and writable there
LARGEST_INT = 2**31 - 1  # rqt's sliders hold no more


def descriptor(parameter: Parameter) -> ParameterDescriptor:
    """Return the ROS descriptor of a declaration: text, unit, range, read-only."""
    message = ParameterDescriptor(name=parameter.name, type=ROS_TYPES[parameter.kind],
                                  read_only=parameter.read_only,
                                  dynamic_typing=parameter.source)
    unit = f' [{parameter.unit}]' if parameter.unit else ''
    message.description = parameter.description + unit
    message.additional_constraints = ', '.join(filter(None, [
        parameter.range_text(),
        f'one of {parameter.choices_text()}' if parameter.choices else '',
        f'length 1 or one for each of the {parameter.length}'
        if isinstance(parameter.length, str) else '']))
    low, high = parameter.minimum, parameter.maximum
    # Ranges apply to scalars only; arrays are checked by our own validation.
    if parameter.kind == 'double' and (low is not None or high is not None):
        message.floating_point_range = [FloatingPointRange(
            from_value=float(-math.inf if low is None else low),
            to_value=float(math.inf if high is None else high), step=0.0)]
    if parameter.kind == 'int' and (low is not None or high is not None):
        message.integer_range = [IntegerRange(
            from_value=int(-LARGEST_INT if low is None else low),
            to_value=int(LARGEST_INT if high is None else high), step=1)]
    return message


def _plain(value: Any) -> Any:
    """Return an array of a request as a list, unless it is refused for its length anyway.

    A million numbers as objects of Python would leave their memory in pieces.
    """
    copied = isinstance(value, (array.array, tuple)) and len(value) <= LONGEST_LIST
    return list(value) if copied else value


def declare(node: Node, kind: str, settings_class: type[NodeSettings]) -> NodeSettings:
    """Declare the parameters of node kind ``kind`` and return its settings.

    The node has to be made with ``automatically_declare_parameters_from_overrides=True``, so that
    every given parameter is visible here and a misspelt name is refused rather than ignored.

    Raises:
        ParameterError: names the parameter, the value and what is expected.
    """
    given = {name: _plain(node.get_parameter(name).value)
             for name in node.get_parameters_by_prefix('') if not name.startswith(ROS_OWN)}
    for name in [n for n in given if known_elsewhere(n, kind)]:
        node.undeclare_parameter(name)  # of a shared section, meant for other nodes
        del given[name]
    table = per_joint(TABLES[kind], given.get('joints') or _default_joints(kind))
    values = validated(table.values(), given, node.get_name(), _sizes(table, given))
    for name, parameter in table.items():
        if name in given:
            node.set_descriptor(name, descriptor(parameter))
        else:
            node.declare_parameter(name, values[name], descriptor(parameter))
    return settings_class.from_values(values)


def _default_joints(kind: str) -> list[str]:
    return next((list(p.default) for p in TABLES[kind]  # type: ignore[arg-type]
                 if p.name == 'joints'), [])


def _sizes(table: Mapping[str, Parameter], given: Mapping[str, Any]) -> dict[str, int]:
    if 'joints' not in table:
        return {}
    joints = given.get('joints', table['joints'].default)
    return {'joints': len(joints)} if isinstance(joints, list) else {}


def on_change(node: Node, kind: str, present: Callable[[], NodeSettings],
              apply: Callable[[NodeSettings, set[str]], None]) -> None:
    """Validate every set request as a whole and hand the new values to ``apply``.

    ``present`` returns the settings in force. ``apply`` gets the new ones and the names of those
    parameters that change. It raises a BlfError to refuse;
    then nothing is changed and the reason is returned. Several parameters of one atomic request
    are accepted or refused together.
    """
    table = per_joint(TABLES[kind], present().values().get('joints', []))

    def changed(parameters: Sequence[RosParameter]) -> SetParametersResult:
        new = {p.name: _plain(p.value) for p in parameters if p.name in table}
        if any(p.name == SIM_TIME and p.value != node.get_parameter(SIM_TIME).value
               for p in parameters):
            return SetParametersResult(successful=False, reason=(
                f'{SIM_TIME} is read-only while the node runs: start it with the other value'))
        if not new:
            return SetParametersResult(successful=True)
        try:
            values = present().values()
            candidate = validated(table.values(), {**values, **new}, node.get_name(),
                                  _sizes(table, values))
            apply(type(present()).from_values(candidate),
                  {name for name in new if new[name] != values[name]})
        except BlfError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    node.add_on_set_parameters_callback(changed)


def ill_formed(node: Node, kind: str, parameters: Sequence[RosParameter]) -> BlfError | None:
    """Return what is wrong with the name or the type of one of the parameters, None where nothing.

    For rclpy, which refuses them with neither the names that there are nor the value to write.
    """
    table = per_joint(TABLES[kind], node.get_parameter('joints').value if node.has_parameter(
        'joints') else [])
    for parameter in parameters:
        where, value = f'{node.get_name()}.{parameter.name}', _plain(parameter.value)
        if not node.has_parameter(parameter.name):
            return UnknownParameter(where, value, table)
        ours = table.get(parameter.name)
        if ours is None or ours.read_only or parameter.type_ == RosParameter.Type.NOT_SET:
            continue
        if parameter.type_.value != ROS_TYPES[ours.kind]:
            problem = value_problem(ours, value, {})
            if problem:
                return ParameterError(where, value, problem)
    return None


def refuse_untyped(node: Node, kind: str) -> None:
    """Raise ParameterError for a given value that has no type in ROS: an empty list."""
    for name, parameter in overrides_of(node).items():
        if parameter.type_ == RosParameter.Type.NOT_SET:
            raise ParameterError(f'{kind}.{name}', [],
                                 'at least one element: an empty list has no type in ROS')


def check_files(args: Sequence[str]) -> None:
    """Raise ParameterError for a parameter file that is not a YAML mapping.

    ROS would take a file of other content for an empty one, and the node would run on defaults.
    """
    for path in _files(args):
        try:
            content = load_yaml_text(read_yaml_text(Path(path)))
        except (OSError, UnicodeDecodeError, yaml.YAMLError):
            content = None
        if not isinstance(content, dict):
            load_yaml(path, '--params-file')  # names file, line and reason


def explain_files(args: Sequence[str], kind: str) -> None:
    """Raise ParameterError for what our own reader finds wrong in the parameter files.

    For files that ROS has refused: its message has the line at best, this one has name, value and
    what is expected.
    """
    for path in _files(args):
        node_values(load_yaml(path, '--params-file'), kind)


def check_all_reached(node: Node, kinds: Collection[str], args: Sequence[str]) -> None:
    """Raise ParameterError for a parameter that was given and reached no node.

    ROS leaves it out without a word: a section of another namespace, a misspelt name of a node, a
    parameter of another kind of node on this one's command line.

    Args:
        node: The node.
        kinds: Its kind, and those of the nodes beside it in the process.
        args: The command line.
    """
    full_name = node.get_fully_qualified_name()
    given = dict(rule.partition(':=')[::2] for rule in _rules(args))  # of equal names the last
    for name, value in given.items():
        target, colon, own = name.rpartition(':')
        if colon and target != node.get_name() and target in TABLES:
            continue  # for another node that is started with the same arguments
        if colon and not reaches(target, full_name):
            raise ParameterError(f'-p {name}', value, (
                f'a name that reaches {full_name}: -p {own}:={value}, or a section '
                f'/**/{node.get_name()} of a parameter file'))
        if all(known_elsewhere(own, kind) for kind in kinds):
            raise ParameterError(f'-p {name}', value,
                                 f'a parameter of {" or ".join(sorted(kinds))}; another kind of '
                                 'node has this one')
        _check_in_force(node, name, value)
    for path in _files(args):
        sections = load_yaml(path)
        check_sections_reach(sections, full_name)
        for key in unknown_sections(sections, full_name):
            node.get_logger().warning(f'{path}: section {key!r} is for none of our nodes')


def _check_in_force(node: Node, name: str, text: str) -> None:
    """Raise ParameterError where a value of the command line gives way to a section of a file."""
    target, _, own = name.rpartition(':')
    if not node.has_parameter(own):
        return
    given, present = load_yaml_text(text), _plain(node.get_parameter(own).value)
    if type(given) is type(present) and given != present:
        raise ParameterError(f'-p {name}', text, (
            f'--params-file before every -p {target}:, because a section of the file says '
            f'{present} and has precedence over names that came before it' if target else
            f'-p {node.get_name()}:{own}:={text}, because a section of a file says {present} and '
            'has precedence over a plain -p; under a namespace another section'))


def _rules(args: Sequence[str]) -> Iterator[str]:
    begin = list(args).index('--ros-args') if '--ros-args' in args else len(args)
    given = args[begin:]
    return (rule for flag, rule in zip(given, given[1:]) if flag in ('-p', '--param'))


def _files(args: Sequence[str]) -> Iterator[str]:
    return (path for flag, path in zip(args, args[1:]) if flag == '--params-file')
