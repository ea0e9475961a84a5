# SPDX-License-Identifier: Apache-2.0
"""Which nodes a section of a parameter file reaches, by ROS's rules, and which reach none."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
import difflib
import re

from adaptive_blf_control.configuration.node_settings import TABLES
from adaptive_blf_control.errors import ParameterError

__all__ = ['check_sections_reach', 'meant_node', 'reaches', 'unknown_sections']

_TOKEN = r'/[^/]+'
_ANY = '**'


def reaches(key: str, node: str) -> bool:
    """Return whether a section applies to the node of this full name.

    ``*`` stands for one name in the path, ``**`` for any number of them; a key without a leading
    slash has one.
    """
    if key in (_ANY, f'/{_ANY}'):
        return True
    parts = key.strip('/').split('/')
    pattern = ''.join(f'({_TOKEN})*' if part == _ANY else _TOKEN if part == '*' else
                      '/' + re.escape(part) for part in parts)
    return re.fullmatch(pattern, node) is not None


def check_sections_reach(keys: Iterable[str], node: str) -> None:
    """Check that no section was meant for a node and does not reach it.

    A file may have sections for other nodes, ours and foreign ones, and for a node of this name in
    other namespaces beside its own. One of this name where none reaches the node, or with nearly
    the name of one of ours, is a mistake: ROS would leave it out without a word, and a limit with
    it.

    Args:
        keys: Of the sections.
        node: Full name of the node.

    Raises:
        ParameterError: names the section, the node and what would reach it.
    """
    own = node.rpartition('/')[2]
    keys = list(keys)
    fine = {*TABLES} - {own}  # names that a section may have without reaching the node
    if any(key.rpartition('/')[2] == own and reaches(key, node) for key in keys):
        fine.add(own)
    for key in keys:
        last = key.rpartition('/')[2]
        if reaches(key, node) or last in ('*', _ANY) or last in fine:
            continue
        if last == own:
            raise ParameterError('params-file', key,
                                 f'a section that reaches {node}, as /**/{own} does')
        if close := meant_node(key, own):
            raise ParameterError('params-file', key,
                                 f'the name of a node: did you mean {close}?')


def meant_node(key: str, *others: str) -> str | None:
    """Return the node whose name that of a section nearly is; None where it is one, or none.

    Args:
        key: Of the section.
        others: Names of nodes beside ours.
    """
    last, names = key.rpartition('/')[2], [*TABLES, *others]
    close = [] if last in names else difflib.get_close_matches(last, names, cutoff=0.8)
    return close[0] if close else None


def unknown_sections(keys: Iterable[str], node: str) -> Iterator[str]:
    """Yield the sections that reach neither this node nor, by their name, another of ours."""
    for key in keys:
        if not reaches(key, node) and key.rpartition('/')[2] not in (*TABLES, '*', _ANY):
            yield key
