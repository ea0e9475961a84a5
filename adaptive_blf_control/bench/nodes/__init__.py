# SPDX-License-Identifier: Apache-2.0
"""Nodes that ours are compared with and attacked by."""
