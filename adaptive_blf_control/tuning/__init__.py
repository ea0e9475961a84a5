# SPDX-License-Identifier: Apache-2.0
"""Gains, filters and limits that follow from an arm, its reference and the delay of its loop."""
