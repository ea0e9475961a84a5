# SPDX-License-Identifier: Apache-2.0
"""YAML of strangers: a regular file of bounded size, whose content is bounded, too.

A few hundred bytes of aliases of aliases stand for gigabytes, and brackets in brackets for more
calls than Python makes.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

__all__ = ['BoundedLoader', 'load_yaml_text', 'read_yaml_text']

LARGEST_FILE = 8_000_000  # bytes; a parameter file has thousands
LARGEST_CONTENT = 200_000  # nodes, those that aliases repeat counted each time
DEEPEST = 64  # mappings and sequences in one another


class BoundedLoader(yaml.SafeLoader):
    """Refuses what is too deep, or too large once aliases are followed."""

    def __init__(self, stream: Any) -> None:
        """Take the text."""
        super().__init__(stream)
        self._depth = 0
        self._sizes: dict[int, int] = {}  # of the nodes that are complete, by identity

    def compose_node(self, parent: Any, index: Any) -> Any:
        """Compose one node and everything in it; YAMLError where that is too much."""
        self._depth += 1
        if self._depth > DEEPEST:
            raise yaml.YAMLError(f'expected at most {DEEPEST} levels in one another')
        alias = self.check_event(yaml.AliasEvent)  # type: ignore[no-untyped-call]
        node: Any = super().compose_node(parent, index)  # type: ignore[no-untyped-call]
        self._depth -= 1
        if not alias:
            self._measure(node)
        elif not isinstance(node, yaml.ScalarNode) and id(node) not in self._sizes:
            raise yaml.YAMLError('expected no alias of what it is in')
        return node

    def _measure(self, node: Any) -> None:
        if isinstance(node, yaml.ScalarNode):
            return
        parts = node.value
        if isinstance(node, yaml.MappingNode):
            parts = [part for pair in node.value for part in pair]
        self._sizes[id(node)] = size = 1 + sum(
            1 if isinstance(part, yaml.ScalarNode) else self._sizes[id(part)] for part in parts)
        if size > LARGEST_CONTENT:
            raise yaml.YAMLError(f'expected at most {LARGEST_CONTENT} values, aliases followed')


def load_yaml_text(text: str, loader: type[BoundedLoader] = BoundedLoader) -> Any:
    """Return the content of a YAML text; YAMLError where it is malformed or beyond bounds."""
    try:
        return yaml.load(text, loader)  # a SafeLoader
    except (ValueError, RecursionError, OverflowError) as error:  # of a date or a number
        raise yaml.YAMLError(str(error)) from None


def read_yaml_text(path: Path) -> str:
    """Return the text of a YAML file.

    Raises:
        OSError: it cannot be read, is no regular file, or too large.
        UnicodeDecodeError: it is not UTF-8.
    """
    if path.exists() and not path.is_file() and not path.is_dir():
        raise OSError(None, 'not a regular file', str(path))
    if path.exists() and path.stat().st_size > LARGEST_FILE:
        raise OSError(None, f'larger than {LARGEST_FILE} bytes', str(path))
    return path.read_text(encoding='utf-8')
