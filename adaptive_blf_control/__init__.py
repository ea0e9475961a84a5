# SPDX-License-Identifier: Apache-2.0
"""Adaptive control of a robot arm with guaranteed safety and performance sets."""

__version__ = '0.1.0'
