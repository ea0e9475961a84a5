# SPDX-License-Identifier: Apache-2.0
"""``excite URDF -o trajectory.csv``: a motion to record, from which a model can be learned.

A periodic motion, from rest to rest, inside the limits of positions, speeds, accelerations and
torques for every arm that the URDF may stand for, whose bodies do not come near each other. It is
optimised to tell the parameters apart that `identify` learns.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
import sys
from typing import Any

from adaptive_blf_control.arms.load import load_arm
from adaptive_blf_control.command_line import joint_names, seconds
from adaptive_blf_control.compilation_notice import CompilationNotice
from adaptive_blf_control.errors import BlfError, ParameterError
from adaptive_blf_control.experiment.design import best_motion
from adaptive_blf_control.experiment.expectation import expectation
from adaptive_blf_control.experiment.motion_text import motion_text
from adaptive_blf_control.experiment.statement import Statement, task_of
from adaptive_blf_control.experiment.written_motion import (
    csv_lines,
    joint_trajectory,
    reference_parameters,
)
from adaptive_blf_control.runs.subject import REAL_ROBOT
from adaptive_blf_control.tools.output_files import check_writable, write_output

__all__ = ['main']

_OF_STATEMENT = ('duration', 'rate', 'amplitude', 'speed', 'mass_error', 'payload', 'collisions',
                 'distance', 'floor')
_FILES = ('output', 'trajectory', 'reference')
_PER_JOINT = ('centre', 'acceleration', 'torque_limit', 'noise')


def _parser() -> argparse.ArgumentParser:
    usual = Statement()
    parser = argparse.ArgumentParser(prog='excite', description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('urdf', help='path or package://package/path of the URDF')
    parser.add_argument('--joints', nargs='+', metavar='JOINT',
                        help='joints to move, separated by spaces or commas, the others are '
                        'locked; default: all')
    parser.add_argument('--duration', type=seconds, default=usual.duration, metavar='S',
                        help='period of the motion [s] (default %(default)g)')
    parser.add_argument('--rate', type=float, default=usual.rate, metavar='HZ',
                        help='samples per second that are recorded, and rows of the CSV '
                        '(default %(default)g)')
    parser.add_argument('--seed', type=int, default=0, help='of the optimisation (default 0)')
    files = parser.add_argument_group('files')
    files.add_argument('-o', '--output', type=Path, metavar='FILE.csv',
                       help='a period as t and, per joint, position, velocity, acceleration and '
                       'the effort that the URDF predicts')
    files.add_argument('--trajectory', type=Path, metavar='FILE.yaml',
                       help='a period as trajectory_msgs/JointTrajectory')
    files.add_argument('--lead', type=seconds, default=5.0, metavar='S',
                       help='time that the JointTrajectory takes to get to its start '
                       '(default %(default)g)')
    files.add_argument('--reference', type=Path, metavar='FILE.yaml',
                       help="the motion as the controller's reference, to be given after the "
                       "arm's own parameter file")
    files.add_argument('--overwrite', action='store_true', help='replace files that exist')
    _add_limits(parser.add_argument_group('limits'), usual)
    noise = parser.add_argument_group('the noise of the torque')
    noise.add_argument('--torque-noise', type=float, nargs='+', metavar='NM', dest='noise',
                       help='its standard deviation, what no model explains included, one for '
                       'all joints or one for each [N·m]; default: 0.5 %% of the torque limits')
    noise.add_argument('--correlation', type=float, default=0.05, metavar='S',
                       help='how long it is alike [s] (default %(default)g)')
    return parser


def _add_limits(limits: argparse._ArgumentGroup, usual: Statement) -> None:
    limits.add_argument('--centre', type=float, nargs='+', metavar='RAD',
                        help='posture around which to stay; default: the middle of the limits')
    limits.add_argument('--amplitude', type=float, default=usual.amplitude, metavar='RAD',
                        help='largest distance from the centre (default %(default)g)')
    limits.add_argument('--speed', type=float, default=usual.speed, metavar='PART',
                        help='part of the speed limits that is used (default %(default)g)')
    limits.add_argument('--acceleration', type=float, nargs='+', metavar='A',
                        help='one for all joints or one for each [rad/s²]; default: full speed '
                        'after a quarter of a second')
    limits.add_argument('--torque-limit', type=float, nargs='+', metavar='NM',
                        help="one for all joints or one for each [N·m]; default: the URDF's")
    limits.add_argument('--mass-error', type=float, default=usual.mass_error, metavar='PART',
                        help='how wrong the mass of any link may be (default %(default)g)')
    limits.add_argument('--payload', type=float, default=usual.payload, metavar='KG',
                        help='largest mass at the tip (default 0)')
    limits.add_argument('--distance', type=float, default=usual.distance, metavar='M',
                        help='how far apart bodies stay (default %(default)g)')
    limits.add_argument('--floor', type=float, metavar='M',
                        help='height of a floor in the base frame')
    limits.add_argument('--srdf', type=Path, metavar='FILE',
                        help='pairs of links that may touch')
    limits.add_argument('--package-dir', action='append', default=[], metavar='DIR',
                        help='where packages with meshes are, besides the usual places')
    limits.add_argument('--no-collisions', action='store_false', dest='collisions',
                        help='do not look at collision bodies')


def _stated(options: argparse.Namespace) -> Statement:
    given = {name: getattr(options, name) for name in _PER_JOINT}
    several: dict[str, Any] = {name: None if values is None else tuple(values)
                               for name, values in given.items()}
    srdf = None
    if options.srdf is not None:
        try:
            srdf = options.srdf.read_text(encoding='utf-8')
        except (OSError, UnicodeDecodeError) as error:
            raise ParameterError('--srdf', str(options.srdf),
                                 f'a file that can be read ({error})') from None
    return Statement(srdf=srdf, package_dirs=options.package_dir, **several,
                     **{name: getattr(options, name) for name in _OF_STATEMENT})


def _excite(options: argparse.Namespace) -> str:
    check_writable({f'--{name}': getattr(options, name) for name in _FILES}, options.overwrite)
    stated, friction = _stated(options), REAL_ROBOT['friction']
    if not options.correlation >= 0.0:
        raise ParameterError('--correlation', options.correlation, 'a time >= 0 s')
    arm = load_arm(options.urdf, joint_names(options.joints), **friction)
    task, assumed = task_of(arm, stated)
    for text in assumed:
        print(f'excite: note: {text}', file=sys.stderr)
    design = best_motion(task, seed=options.seed, report=_say if sys.stderr.isatty() else None)
    expected = expectation(task, design, stated.rate, options.correlation)
    motion = design.motion
    texts: dict[str, Callable[[], str]] = {
        'output': lambda: '\n'.join(csv_lines(arm, motion, stated.rate)) + '\n',
        'trajectory': lambda: joint_trajectory(arm, motion, options.lead),
        'reference': lambda: reference_parameters(arm, motion)}
    for name in _FILES:
        if (path := getattr(options, name)) is not None:
            write_output(f'--{name}', path, texts[name]())
    return motion_text(task, design, expected, stated.rate, options.correlation)


def _say(step: int, value: float) -> None:
    sys.stderr.write(f'\r\x1b[Kexcite: step {step}, objective {value:.3f}')
    sys.stderr.flush()


def main(args: list[str] | None = None) -> int:
    """Run the command; 0 if a motion was found, 2 on bad input."""
    options = _parser().parse_args(args)
    try:
        with CompilationNotice():
            text = _excite(options)
    except BlfError as error:
        print(f'excite: {" ".join(str(error).split())}', file=sys.stderr)
        return 2
    if sys.stderr.isatty():
        sys.stderr.write('\r\x1b[K')
    print(text)
    for name in _FILES:
        if getattr(options, name) is not None:
            print(f'{name:<12}{getattr(options, name)}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
