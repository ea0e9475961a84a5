# SPDX-License-Identifier: Apache-2.0
"""``bench excite``: designed motions against random ones inside the same limits.

Random motions have the same period, harmonics and rest at both ends, weights that are normally
distributed, and are as large as the limits allow.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from adaptive_blf_control.arms.load import load_arm
from adaptive_blf_control.experiment.design import best_motion, random_motions
from adaptive_blf_control.experiment.expectation import expectation
from adaptive_blf_control.experiment.statement import Statement, task_of
from adaptive_blf_control.runs.subject import REAL_ROBOT

__all__ = ['ROBOTS', 'add_options', 'run']

ROBOTS = {
    'panda': ('package://panda_description/urdf/panda.urdf',
              [f'panda_joint{i}' for i in range(1, 8)]),
    'ur10': ('package://ur_description/urdf/ur10_robot.urdf', None),
}
CORRELATION = 0.05  # s


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `run`."""
    parser.add_argument('--random', type=int, default=20, metavar='N',
                        help='excite: random motions of each robot; default: 20')


def run(options: argparse.Namespace) -> None:
    """Print a Markdown table of conditions and of the time they take."""
    print('| robot | parameters | condition | random: median, best | ratio of medians | time '
          'needed [s] | random, median [s] | bodies apart [m] | processor time [s] |')
    print('|---|---|---|---|---|---|---|---|---|')
    stated = Statement()
    for name, (urdf, joints) in ROBOTS.items():
        task, _ = task_of(load_arm(urdf, joints, **REAL_ROBOT['friction']), stated)
        random = random_motions(task, options.random)
        begin = time.process_time()
        best = best_motion(task)
        seconds = time.process_time() - begin
        others = np.array([each.condition for each in random])
        needed = [expectation(task, each, stated.rate, CORRELATION).needed
                  for each in (best, *random)]
        print(f'| {name} | {task.arm.m} | {best.condition:.1f} | {np.median(others):.1f}, '
              f'{others.min():.1f} | {np.median(others) / best.condition:.2f} | {needed[0]:.0f} | '
              f'{np.median(needed[1:]):.0f} | {best.distance:.3f} | {seconds:.0f} |', flush=True)
