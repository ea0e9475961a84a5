# SPDX-License-Identifier: Apache-2.0
"""``precompile [CONFIG...]``: compile the laws for this machine, so that no first run has to."""

from __future__ import annotations

import argparse
from importlib import util
from pathlib import Path
import sys

from adaptive_blf_control.compilation_notice import CompilationNotice
from adaptive_blf_control.compiled import COMPILED
from adaptive_blf_control.configuration.build import build_closed_loop
from adaptive_blf_control.configuration.parameter_file import load_yaml
from adaptive_blf_control.errors import BlfError
from adaptive_blf_control.runtime.processes import scenario

__all__ = ['main']

CLOSED_FORM = ('two_link.yaml', 'three_link.yaml')
FROM_URDF = ('panda.yaml',)  # one for all: every URDF arm is the same compiled code


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='precompile', description=__doc__)
    parser.add_argument('config', type=Path, nargs='*',
                        help='parameter files (default: one for each kind of arm)')
    return parser


def _one_of_each_kind() -> list[Path]:
    urdf = all(util.find_spec(name) for name in ('pinocchio', 'example_robot_data'))
    return [scenario(name) for name in CLOSED_FORM + (FROM_URDF if urdf else ())]


def main(args: list[str] | None = None) -> int:
    """Run the command; 0 also where numba is not installed, 2 on bad input."""
    options = _parser().parse_args(args)
    if not COMPILED:
        print('precompile: numba is not installed: the laws run as plain Python', file=sys.stderr)
        return 0
    try:
        with CompilationNotice():
            for config in options.config or _one_of_each_kind():
                build_closed_loop(load_yaml(config)).warm_up()
    except BlfError as error:
        print(f'precompile: {error}', file=sys.stderr)
        return 2
    return 0


if __name__ == '__main__':
    sys.exit(main())
