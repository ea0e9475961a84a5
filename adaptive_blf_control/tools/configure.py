# SPDX-License-Identifier: Apache-2.0
"""``configure URDF -o my_arm.yaml``: a complete parameter file for an arm, and why it is so.

Sets and reference lie inside the limits of the URDF. The gains follow from the inertia that each
joint sees along the reference and from the delay of the loop, the filters from the sensors.
"""

from __future__ import annotations

import argparse
from pathlib import Path
import sys

from adaptive_blf_control.command_line import joint_names, seconds
from adaptive_blf_control.compilation_notice import announce_compilation
from adaptive_blf_control.configuration.written_file import written_file
from adaptive_blf_control.errors import BlfError
from adaptive_blf_control.tools.output_files import check_writable, write_output
from adaptive_blf_control.tuning.node_values import node_settings_of, reasons_of
from adaptive_blf_control.tuning.recipe import recipe
from adaptive_blf_control.tuning.recipe_text import recipe_text
from adaptive_blf_control.tuning.robot import Robot
from adaptive_blf_control.tuning.stated_friction import arm_with_friction, sliding_velocity

__all__ = ['main']


def _parser() -> argparse.ArgumentParser:
    usual = Robot()
    parser = argparse.ArgumentParser(
        prog='configure', description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('urdf', help='path or package://package/path of the URDF')
    parser.add_argument('--joints', nargs='+', metavar='JOINT',
                        help='joints of the arm, from the base on, separated by spaces or commas; '
                        'default: all')
    parser.add_argument('--coulomb', action=argparse.BooleanOptionalAction,
                        help='learn a Coulomb friction per joint as well; default: where the URDF '
                        'states any')
    parser.add_argument('--rotor-inertia', type=_inertia, nargs='*', metavar='KGM2',
                        help="learn the inertia of each joint's rotor as well; numbers state it, "
                        'seen from the joint (gear ratio squared times the rotor), one for '
                        'all joints or one for each [kg m2]')
    parser.add_argument('--from-zero', action='store_true',
                        help="begin to learn from nothing rather than from the URDF's values")
    parser.add_argument('-o', '--output', type=Path, metavar='FILE',
                        help='parameter file to write; without it nothing is written')
    parser.add_argument('--overwrite', action='store_true', help='replace FILE if it exists')
    loop = parser.add_argument_group('the loop')
    loop.add_argument('--rate', type=float, default=usual.rate, metavar='HZ',
                      help='joint states per second (default %(default)g)')
    loop.add_argument('--delay', type=float, default=usual.delay, metavar='S',
                      help='from the sample of a state until its command acts [s] (default 0)')
    loop.add_argument('--encoder', type=int, metavar='COUNTS', dest='encoder_counts',
                      help='counts per turn of a joint, velocities from their differences; '
                      'default: exact sensors')
    loop.add_argument('--velocity-filter', type=seconds, metavar='S',
                      default=usual.velocity_time_constant, dest='velocity_time_constant',
                      help='time constant of the filter on those velocities [s] '
                      '(default %(default)g)')
    loop.add_argument('--torque-noise', type=float, default=usual.torque_noise, metavar='NM',
                      help='standard deviation of the measured torques [N m] (default 0)')
    arm = parser.add_argument_group('the arm')
    arm.add_argument('--payload', type=float, default=usual.payload, metavar='KG',
                     help='largest mass at the tip [kg] (default 0)')
    arm.add_argument('--torque-limit', type=float, nargs='+', metavar='NM',
                     help="one for all joints or one for each [N m]; default: the URDF's")
    motion = parser.add_argument_group('the motion')
    motion.add_argument('--centre', type=float, nargs='+', metavar='RAD',
                        help='posture around which the reference moves; default: the middle of '
                        'the limits, or another where the arm is nearly singular there')
    motion.add_argument('--amplitude', type=float, default=usual.amplitude, metavar='RAD',
                        help='largest distance from the centre (default %(default)g)')
    motion.add_argument('--width', type=float, default=usual.width, metavar='RAD',
                        help='largest performance bound (default %(default)g)')
    return parser


_OF_ROBOT = ('rate', 'delay', 'encoder_counts', 'velocity_time_constant', 'torque_noise',
             'payload', 'amplitude', 'width', 'from_zero')


def main(args: list[str] | None = None) -> int:
    """Run the command; 0 if all went well, 2 on bad input."""
    options = _parser().parse_args(args)
    announce_compilation()
    try:
        check_writable({'--output': options.output}, options.overwrite)
        robot = Robot(torque_limit=_several(options.torque_limit),
                      centre=_several(options.centre),
                      **{name: getattr(options, name) for name in _OF_ROBOT})
        found = recipe(arm_with_friction(
            options.urdf, joint_names(options.joints), coulomb=options.coulomb,
            rotor_inertia=_rotors(options.rotor_inertia),
            coulomb_velocity=sliding_velocity(robot)), robot)
        text = written_file(node_settings_of(found, _address(options.urdf)),
                            _title(sys.argv[1:] if args is None else args), reasons_of(found))
        if options.output is not None:
            write_output('--output', options.output, text)
    except BlfError as error:
        print(f'configure: {error}', file=sys.stderr)
        return 2
    print(recipe_text(found))
    if options.output is not None:
        print(f'\nwritten to {options.output}; next: simulate {options.output}')
    return 0


def _inertia(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(
            f'{text!r} is no number [kg m2]; the URDF goes before it') from None


def _rotors(values: list[float] | None) -> bool | list[float]:
    """Return the stated inertias; True where they are only to be learned."""
    return values or values is not None


def _several(values: list[float] | None) -> tuple[float, ...] | None:
    return None if values is None else tuple(values)


def _address(urdf: str) -> str:
    """Return a URDF's address as it is found from any folder."""
    path = Path(urdf)
    return urdf if urdf.startswith('package://') or not path.exists() else str(path.resolve())


def _title(args: list[str]) -> str:
    return (f'configure {" ".join(args)}\n'
            'Every parameter of every node; docs/configure.md says how the values follow.\n'
            'Keys /**/NODE match the node under any namespace.')


if __name__ == '__main__':
    sys.exit(main())
