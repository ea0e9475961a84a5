# SPDX-License-Identifier: Apache-2.0
"""``compare [CONFIG...]``: our law against other laws, or ``--noise``: what protects the estimate.

Every law has the plant, reference, sensors and torque limit of the scenario and gains derived from
the scenario's (control/laws/linear_gains.py).
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
import sys
from typing import Any

from adaptive_blf_control.bench.comparison import FIXED, LAWS, run_law
from adaptive_blf_control.bench.law_figures import COLUMNS, law_figures, markdown_row
from adaptive_blf_control.command_line import seconds
from adaptive_blf_control.compilation_notice import announce_compilation
from adaptive_blf_control.configuration.node_settings import DriverSettings
from adaptive_blf_control.configuration.parameter_file import (
    apply_settings,
    load_yaml,
    node_settings,
)
from adaptive_blf_control.errors import BlfError

__all__ = ['main']

DEFAULT = ('config/three_link.yaml', 'config/three_link_encoder.yaml')


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='compare', description=__doc__)
    parser.add_argument('config', type=Path, nargs='*', default=[Path(name) for name in DEFAULT],
                        help=f'parameter files; default: {" ".join(DEFAULT)}')
    parser.add_argument('--duration', type=seconds, metavar='S',
                        help="length of each run [s]; default: the driver's duration, else 20")
    parser.add_argument('--set', action='append', default=[], metavar='NODE.NAME=VALUE',
                        dest='settings', help='change a parameter of every run')
    parser.add_argument('--json', action='store_true', help='print the figures as JSON')
    parser.add_argument('--noise', nargs='*', metavar='PART', default=None,
                        help='the study of docs/noise.md instead; parts: filters, stack, payloads,'
                        ' alarms, detection; without a name all, about half an hour')
    return parser


def _compare(config: Path, options: argparse.Namespace) -> dict[str, Any]:
    data = apply_settings(load_yaml(config, 'CONFIG'), options.settings)
    duration = options.duration or node_settings(data, DriverSettings).duration or 20.0
    if not options.json:
        print(f'## {config.stem}, {duration:g} s\n\n| {" | ".join(COLUMNS)} |\n'
              + '|---' * len(COLUMNS) + '|', flush=True)
    table: dict[str, Any] = {}
    for name in LAWS:
        table[name] = law_figures(run_law(data, name, duration))
        if not options.json:
            print(markdown_row(name, table[name], name not in FIXED), flush=True)
    if not options.json:
        print()
    return {'duration_s': duration, 'laws': table}


def main(args: list[str] | None = None) -> int:
    """Run the command; 2 on bad input."""
    options = _parser().parse_args(args)
    announce_compilation()
    try:
        if options.noise is not None:
            from adaptive_blf_control.bench.noise_study import run_study
            return run_study(options.noise)
        figures = {config.stem: _compare(config, options) for config in options.config}
    except BlfError as error:
        print(f'compare: {error}', file=sys.stderr)
        return 2
    if options.json:
        print(json.dumps(figures, indent=2))
    return 0


if __name__ == '__main__':
    sys.exit(main())
