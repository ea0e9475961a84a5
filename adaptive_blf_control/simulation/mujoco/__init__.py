# SPDX-License-Identifier: Apache-2.0
"""A plant that shares no dynamics with ours: the arm in MuJoCo, from a URDF or an MJCF."""
