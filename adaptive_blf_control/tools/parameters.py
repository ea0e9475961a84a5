# SPDX-License-Identifier: Apache-2.0
"""``parameters``: the parameter tables of the nodes as Markdown, as in docs/parameters.md."""

from __future__ import annotations

import argparse
import json
import sys

from adaptive_blf_control.arms.settings import ArmSettings
from adaptive_blf_control.configuration.node_settings import TABLES
from adaptive_blf_control.parameters.table import Parameter

__all__ = ['main', 'markdown']

HEAD = """# Parameters

`python -m adaptive_blf_control parameters` writes this page. A test keeps it equal to the settings
classes in `adaptive_blf_control/configuration/node_settings.py` and in `arms/`, `control/`,
`identification/` and `simulation/`, from which declaration, descriptors and checks follow, too.

For a list of length n (joints) or m (parameters) one element may stand for all. Parameters marked
"live" can be changed with `ros2 param set` while the node runs; the others are read-only. Doubles
need a decimal point in YAML (`1.0`, not `1`).
"""


def _row(parameter: Parameter) -> str:
    accepted = parameter.range_text() or parameter.choices_text()
    length = f' x {parameter.length}' if parameter.length is not None else ''
    default = json.dumps(parameter.default)
    return (f'| `{parameter.name}` | {parameter.kind}{length} | `{default}` | {parameter.unit} | '
            f'{accepted} | {"" if parameter.read_only else "live"} | {parameter.description} |')


def _section(title: str, table: tuple[Parameter, ...]) -> str:
    head = ('| name | type | default | unit | accepted | | meaning |\n'
            '|---|---|---|---|---|---|---|')
    return '\n'.join([f'\n## {title}\n', head, *map(_row, table)]) + '\n'


def markdown() -> str:
    """Return the page."""
    arm = ArmSettings.table()
    shared = {parameter.name for parameter in arm}
    text = HEAD + _section('The arm (arm_driver, identifier, controller)', arm)
    for node, table in TABLES.items():
        text += _section(node, tuple(p for p in table if p.name not in shared))
    return text


def main(args: list[str] | None = None) -> int:
    """Print the page."""
    argparse.ArgumentParser(prog='parameters', description=__doc__).parse_args(args)
    print(markdown(), end='')
    return 0


if __name__ == '__main__':
    sys.exit(main())
