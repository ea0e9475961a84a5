# SPDX-License-Identifier: Apache-2.0
"""Parts for limits beyond the paper: velocities and obstacles, for every θ that is possible.

The controller does not use them yet.
"""
