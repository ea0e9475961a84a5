# SPDX-License-Identifier: Apache-2.0
"""``recover``: make a bag that a crash left unfinished readable again.

If the .mcap files of a folder are complete, its metadata.yaml is rebuilt. If a file breaks off, a
finished copy of everything before the break is written. The .mcap files are never changed.

Exit status: 0 a finished bag is at the printed path and no loss is known; 1 a finished bag is
there up to a break that is printed; 2 nothing could be recovered.
"""

from __future__ import annotations

import argparse
from pathlib import Path
import sys

from adaptive_blf_control.bags.recovery import KEPT_NAME, recover_bag
from adaptive_blf_control.errors import BlfError

__all__ = ['main']


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='recover', description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument('bag', type=Path, help='bag folder, or a single .mcap file')
    parser.add_argument('--output', type=Path, metavar='DIR', default=None,
                        help='always write a finished copy, to this new folder\n'
                        '(default: BAG_recovered, only if a file breaks off or is compressed)')
    return parser


def main(args: list[str] | None = None) -> int:
    """Run the command; see the module for the exit status."""
    options = _parser().parse_args(args)
    try:
        done = recover_bag(options.bag, options.output)
    except BlfError as error:
        print(f'recover: {error}', file=sys.stderr)
        return 2
    what = {'whole': 'is complete, nothing to do',
            'metadata': f'metadata.yaml rebuilt (an old one is kept as {KEPT_NAME})',
            'copy': 'finished copy written'}[done.what]
    print(f'{done.path}: {what}; {done.messages} messages')
    if done.problem is None:
        return 0
    print(f'recover: everything after this break is lost: {done.problem}', file=sys.stderr)
    return 1


if __name__ == '__main__':
    sys.exit(main())
