# SPDX-License-Identifier: Apache-2.0
"""Benchmarks and studies: the figures of docs/benchmarks.md, baselines.md and noise.md."""
