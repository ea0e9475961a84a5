# SPDX-License-Identifier: Apache-2.0
"""A run or a log as arrays, and the figures that are computed from it."""
