# SPDX-License-Identifier: Apache-2.0
"""``play``: publish a bag again with its clock, byte for byte, on machines without rosbag2.

QoS is offered as recorded. Ctrl-C ends it; so do SIGTERM and SIGHUP. ROS arguments, e.g.
``--ros-args -r /joint_states:=/recorded/joint_states``, come last.
"""

from __future__ import annotations

import argparse
from importlib import util
import sys

from adaptive_blf_control.errors import BlfError, MissingExtra

__all__ = ['main']


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='play', description=__doc__)
    parser.add_argument('bag', help='bag folder, or a lone .mcap or .db3 file')
    parser.add_argument('--rate', type=float, default=1.0, metavar='R',
                        help='bag seconds per second (default: 1)')
    parser.add_argument('--topics', nargs='+', default=[], metavar='TOPIC',
                        help='play only these')
    parser.add_argument('--loop', action='store_true', help='begin again at the end')
    parser.add_argument('--wait', type=float, default=5.0, metavar='S',
                        help='wait at most so long until each topic has a subscriber (default: 5)')
    parser.add_argument('--clock', type=float, default=100.0, metavar='HZ',
                        help='ticks on /clock per bag second, 0 for none (default: 100); a bag '
                        'that has /clock plays its own')
    return parser


def main(args: list[str] | None = None) -> int:
    """Run the command; 0 at the end of the bag or when stopped, 2 where it cannot be played."""
    arguments = sys.argv[1:] if args is None else args
    split = arguments.index('--ros-args') if '--ros-args' in arguments else len(arguments)
    options = _parser().parse_args(arguments[:split])
    try:
        if util.find_spec('rclpy') is None:
            raise MissingExtra('rclpy', 'ros', 'playing a bag')
        from adaptive_blf_control.nodes.player import play, PlaySettings
        settings = PlaySettings(options.rate, tuple(options.topics), options.loop, options.wait,
                                options.clock)
        player = play(options.bag, settings, arguments[split:])
    except (BlfError, RuntimeError) as error:
        print(f'play: {error}', file=sys.stderr)
        return 2
    print(f'{sum(player.sent.values())} messages on {len(player.sent)} topics, '
          f'{player.ticks} ticks of the clock')
    return 0


if __name__ == '__main__':
    sys.exit(main())
