# SPDX-License-Identifier: Apache-2.0
"""``play``: publish a bag again with its clock, byte for byte, on machines without rosbag2.

QoS is offered as recorded. With ``--lockstep`` each state waits until the previous one has been
answered. Ctrl-C, SIGTERM and SIGHUP end it. ROS arguments, e.g.
``--ros-args -r /joint_states:=/recorded/joint_states``, come last.
"""

from __future__ import annotations

import argparse
from importlib import util
import sys

from adaptive_blf_control.errors import BlfError, MissingExtra
from adaptive_blf_control.messages.topics import THETA_HAT

__all__ = ['main']


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='play', description=__doc__)
    parser.add_argument('bag', help='bag folder, or a single .mcap or .db3 file')
    pace = parser.add_mutually_exclusive_group()
    pace.add_argument('--rate', type=float, default=1.0, metavar='R',
                      help='bag seconds per second (default: 1)')
    pace.add_argument('--lockstep', action='store_true',
                      help='as fast as the joint states are answered, whatever their times')
    parser.add_argument('--topics', nargs='+', default=[], metavar='TOPIC',
                        help='play only these topics')
    parser.add_argument('--loop', action='store_true', help='start again at the end')
    parser.add_argument('--wait', type=float, default=5.0, metavar='S',
                        help='longest wait until each topic has a subscriber (default: 5)')
    parser.add_argument('--clock', type=float, default=100.0, metavar='HZ',
                        help='ticks on /clock per bag second, 0 for none (default: 100); a bag '
                        'that contains /clock plays its own')
    parser.add_argument('--answers', nargs='+', default=[THETA_HAT], metavar='TOPIC',
                        help='in lockstep, topics on which a state is answered with its stamp; '
                        f'names are relative to those of the states (default: {THETA_HAT})')
    parser.add_argument('--timeout', type=float, default=10.0, metavar='S',
                        help='in lockstep, longest wait for an answer (default: 10)')
    return parser


def main(args: list[str] | None = None) -> int:
    """Run the command; 0 at the end of the bag or when stopped.

    1 where a state was not answered, 2 where the bag cannot be played.
    """
    arguments = sys.argv[1:] if args is None else args
    split = arguments.index('--ros-args') if '--ros-args' in arguments else len(arguments)
    options = _parser().parse_args(arguments[:split])
    try:
        if util.find_spec('rclpy') is None:
            raise MissingExtra('rclpy', 'ros', 'playing a bag')
        from adaptive_blf_control.nodes.play_settings import PlaySettings
        from adaptive_blf_control.nodes.player import account, play
        settings = PlaySettings(options.rate, tuple(options.topics), options.loop, options.wait,
                                options.clock, options.lockstep, tuple(options.answers),
                                options.timeout)
        player = play(options.bag, settings, arguments[split:])
    except (BlfError, RuntimeError) as error:
        print(f'play: {error}', file=sys.stderr)
        return 1 if isinstance(error, TimeoutError) else 2
    print(account(player))
    return 0


if __name__ == '__main__':
    sys.exit(main())
