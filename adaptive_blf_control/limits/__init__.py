# SPDX-License-Identifier: Apache-2.0
"""Limits beyond the paper: velocities, torques and obstacles, for every θ that the data allow."""
