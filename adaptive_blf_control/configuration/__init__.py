# SPDX-License-Identifier: Apache-2.0
"""From parameter files to the objects of the core: the settings of every node."""
