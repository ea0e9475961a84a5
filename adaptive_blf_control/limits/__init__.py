# SPDX-License-Identifier: Apache-2.0
"""Limits beyond the paper: velocities and obstacles, for every θ that is possible.

`safety_filter` is what the controller takes; `filter_step` the torque that is let through,
`governor` the reference that is followed; docs/limits.md says what is sure.
"""
