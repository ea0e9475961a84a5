# SPDX-License-Identifier: Apache-2.0
"""``precompile [CONFIG...]``: compile the laws for this machine, so that no first run has to."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
import sys

from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.compilation_notice import CompilationNotice
from adaptive_blf_control.compiled import COMPILED
from adaptive_blf_control.configuration.build_closed_loop import build_closed_loop
from adaptive_blf_control.configuration.parameter_file import load_yaml
from adaptive_blf_control.configuration.shipped import scenario
from adaptive_blf_control.errors import ArmError, BlfError, MissingExtra
from adaptive_blf_control.runs.simulation import simulate
from adaptive_blf_control.simulation.closed_loop import ClosedLoop
from adaptive_blf_control.tuning.recipe import recipe
from adaptive_blf_control.tuning.robot import Robot

__all__ = ['main']

CLOSED_FORM = ('two_link.yaml', 'three_link.yaml')
SENSORS = Robot(encoder_counts=4096, torque_noise=0.05)
"""Of a robot that `configure` is asked about: with a state filter."""
FROM_URDF = ('panda.yaml', 'panda_obstacles.yaml')
"""One for all: every URDF arm is the same compiled code; and one with a safety filter."""


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='precompile', description=__doc__)
    parser.add_argument('config', type=Path, nargs='*',
                        help='parameter files (default: one for each kind of arm)')
    return parser


def _loops(configs: list[Path]) -> Iterator[ClosedLoop]:
    """Return the loops of some files, or of one for each kind of arm that can be built here."""
    if configs:
        yield from (build_closed_loop(load_yaml(config)) for config in configs)
        return
    yield from (build_closed_loop(load_yaml(scenario(name))) for name in CLOSED_FORM)
    with suppress(MissingExtra, ArmError):  # no Pinocchio, or not the robot of the file
        yield from (build_closed_loop(load_yaml(scenario(name))) for name in FROM_URDF)


def main(args: list[str] | None = None) -> int:
    """Run the command; 0 also where numba is not installed, 2 on bad input."""
    options = _parser().parse_args(args)
    if not COMPILED:
        print('precompile: numba is not installed: the laws run as plain Python', file=sys.stderr)
        return 0
    try:
        with CompilationNotice():
            for loop in _loops(options.config):
                loop.warm_up_parts()
                loop.identifier.warm_up(log=True)
                repr(simulate(loop, 2.0 * loop.period))  # the figures, too
                if isinstance(loop.arm, UrdfArm):
                    with suppress(BlfError):  # what it finds does not matter
                        recipe(loop.arm, SENSORS)
    except BlfError as error:
        print(f'precompile: {error}', file=sys.stderr)
        return 2
    return 0


if __name__ == '__main__':
    sys.exit(main())
