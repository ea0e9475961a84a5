# SPDX-License-Identifier: Apache-2.0
"""The report of a run: numbers, plots and an animation from its bag alone."""
