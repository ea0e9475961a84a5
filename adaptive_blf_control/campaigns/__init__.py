# SPDX-License-Identifier: Apache-2.0
"""Campaigns: thousands of runs of a scenario with parameters that vary."""
