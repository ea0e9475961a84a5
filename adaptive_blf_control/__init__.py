# SPDX-License-Identifier: Apache-2.0
"""Adaptive control of a robot arm with guaranteed safety and performance sets."""

import os

# The matrices here are small: BLAS threads cost more than they give, and their busy waiting
# takes the cores from the other nodes. Works where numpy is not loaded yet; a set value stays.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

__version__ = '0.1.0'
