# SPDX-License-Identifier: Apache-2.0
"""Whether the history stack is large enough for Assumption 2: rank(H Hᵀ) = m."""

from __future__ import annotations

from adaptive_blf_control.identification.settings import IdentifierSettings

__all__ = ['rank_warning']


def rank_warning(settings: IdentifierSettings, n: int, m: int) -> str | None:
    """Return what is wrong with P = ``history.size``, None where P ≥ m as section IV-B asks.

    P pairs are P n rows of rank m at most: below m rows full rank is out of reach, between m/n and
    m pairs it is possible but leaves Algorithm 1 little to choose from.

    Args:
        settings: Gains of the identifier.
        n: Number of joints.
        m: Number of parameters.
    """
    size = settings.history.size
    if size >= m:
        return None
    rows = size * n
    reach = (f'the rank cannot exceed {rows} of {m}, so that theta_hat need not converge'
             if rows < m else f'full rank is possible with its {rows} rows, but P >= {m} is asked')
    return (f'identifier.history.size: P = {size} pairs of {n} rows for m = {m} parameters: '
            f'{reach} (Assumption 2)')
