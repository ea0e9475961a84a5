# SPDX-License-Identifier: Apache-2.0
"""A parameter file written out in full: every parameter of every node with its declaration."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
import json
from typing import Any

from adaptive_blf_control.arms.settings import ArmSettings
from adaptive_blf_control.configuration.node_settings import RuntimeSettings
from adaptive_blf_control.parameters.settings import Settings
from adaptive_blf_control.parameters.table import declares, Parameter, Table

__all__ = ['written_file']

WIDTH = 99
STEP = '  '


def written_file(nodes: Mapping[str, RuntimeSettings], title: str = '',
                 reasons: Mapping[str, str] | None = None) -> str:
    """Return a parameter file with every parameter of the given nodes.

    Each has its description, unit and range above it, as in docs/parameters.md. What describes
    the arm is written once, in the section ``/**`` of all nodes.

    Args:
        nodes: Settings by node; those that have an arm have the same.
        title: Comment at the head of the file, any number of lines.
        reasons: Why a value is what it is, by ``node.parameter``.
    """
    reasons = reasons or {}
    lines = [f'# {line}'.rstrip() for line in title.splitlines()]
    arm = next((each for each in nodes.values() if isinstance(each, ArmSettings)), None)
    shared = {row.name for row in ArmSettings.table()} if arm is not None else set()
    if arm is not None:
        lines += _section('/**', arm, shared, {})
    for node, settings in nodes.items():
        own = {name for name in settings.values() if name not in shared}
        lines += _section(f'/**/{node}', settings, own, {
            name.partition('.')[2]: text for name, text in reasons.items()
            if name.startswith(f'{node}.')})
    return '\n'.join(lines) + '\n'


def _section(key: str, settings: Settings, names: set[str],
             reasons: Mapping[str, str]) -> list[str]:
    table, explained = type(settings).table(), set[str]()
    before: tuple[str, ...] = ()
    lines = [f'{key}:', f'{STEP}ros__parameters:']
    for name, value in settings.values().items():
        if name not in names:
            continue
        *groups, last = name.split('.')
        for depth in range(len(groups)):
            if before[:depth + 1] != tuple(groups[:depth + 1]):
                lines.append(f'{STEP * (depth + 2)}{_text(groups[depth])}:')
        before, indent = (*groups, ''), STEP * (len(groups) + 2)
        row = _declaration(table, name)
        if row.name not in explained:
            lines += _comment(row, reasons.get(name, ''), indent)
            explained.add(row.name)
        lines += _entry(f'{indent}{last}: ', value)
    return lines


def _declaration(table: Table, name: str) -> Parameter:
    exact = (row for row in table if row.name == name)  # before one that has it as a <joint>
    return next(exact, None) or next(row for row in table if declares(row, name))


def _comment(row: Parameter, reason: str, indent: str) -> list[str]:
    unit = f' [{row.unit}]' * bool(row.unit)
    facts = ', '.join(filter(None, [row.range_text(), 'live' if not row.read_only else '']))
    text = f'{row.description.rstrip(".")}{unit}{f"; {facts}" * bool(facts)}.'
    lines = [line for part in (text, reason) if part for line in _wrapped(part, indent)]
    return lines


def _wrapped(text: str, indent: str) -> Iterator[str]:
    line = f'{indent}#'
    for word in text.split():
        if len(line) + 1 + len(word) > WIDTH:
            yield line
            line = f'{indent}#'
        line += f' {word}'
    yield line


def _entry(head: str, value: Any) -> Iterator[str]:
    if not isinstance(value, list):
        yield f'{head}{_text(value)}'
        return
    line = f'{head}['
    inside = ' ' * len(line)
    for i, each in enumerate(value):
        item = _text(each) + (']' if i == len(value) - 1 else ',')
        if len(line) + 1 + len(item) > WIDTH and line.strip() and not line.endswith('['):
            yield line.rstrip()
            line = inside
        line += item + ' ' * item.endswith(',')
    yield line


def _text(value: Any) -> str:
    if isinstance(value, str):
        return value if value.isidentifier() and value not in _WORDS else json.dumps(
            value, ensure_ascii=False)
    if isinstance(value, float):
        text = repr(value)
        return text.replace('e', '.0e') if 'e' in text and '.' not in text else text
    return json.dumps(value)


_WORDS = ('true', 'false', 'null', 'yes', 'no', 'on', 'off', 'y', 'n')
