# SPDX-License-Identifier: Apache-2.0
"""Parameters: one table per node drives ROS declaration, offline loading and validation."""
