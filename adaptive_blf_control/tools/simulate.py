# SPDX-License-Identifier: Apache-2.0
"""``simulate CONFIG``: run a scenario offline, the very objects of the nodes in lockstep."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
import sys

from adaptive_blf_control.command_line import seconds
from adaptive_blf_control.compilation_notice import CompilationNotice
from adaptive_blf_control.configuration.build_closed_loop import build_closed_loop
from adaptive_blf_control.configuration.parameter_file import apply_settings, load_yamls
from adaptive_blf_control.errors import BlfError
from adaptive_blf_control.runs.simulation import duration_of, simulate
from adaptive_blf_control.runs.start_check import start_warnings

__all__ = ['main']


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='simulate', description=__doc__)
    parser.add_argument('config', type=Path, nargs='+', metavar='CONFIG',
                        help='parameter file, or a shipped one by name: two_link; of several, '
                        'later ones change what earlier ones say')
    parser.add_argument('--duration', type=seconds, metavar='S',
                        help="length of the run [s]; default: the driver's duration, else 20")
    parser.add_argument('--set', action='append', default=[], metavar='NODE.NAME=VALUE',
                        dest='settings', help='change a parameter, e.g. controller.k2=[30.0]')
    parser.add_argument('--bag', type=Path, metavar='DIR', help='write the run as a bag')
    parser.add_argument('--json', action='store_true', help='print the figures as JSON')
    return parser


def main(args: list[str] | None = None) -> int:
    """Run the command; 0 if no set was left, 1 if one was, 2 on bad input."""
    options = _parser().parse_args(args)
    try:
        data = apply_settings(load_yamls(options.config, 'CONFIG'), options.settings)
        duration = duration_of(data, options.duration)
        with CompilationNotice() as notice:
            loop = build_closed_loop(data)
            for warning in start_warnings(data, loop):
                notice.aside(f'simulate: warning: {warning}')
            if options.bag is None:
                run = simulate(loop, duration)
            else:
                from adaptive_blf_control.runs.bag_observer import BagObserver
                with BagObserver(options.bag, loop, data) as observer:
                    run = simulate(loop, duration, observer=observer)
    except BlfError as error:
        print(f'simulate: {error}', file=sys.stderr)
        return 2
    if options.json:
        print(json.dumps(run.figures, indent=2))
    else:
        print(repr(run) + (f'\nbag                  {options.bag}' if options.bag else ''))
    return 0 if run.kept else 1


if __name__ == '__main__':
    sys.exit(main())
