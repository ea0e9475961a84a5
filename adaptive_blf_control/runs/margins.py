# SPDX-License-Identifier: Apache-2.0
"""Distances to the bounds of the constraints along a run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.control.constraints import Constraints, MarginName, MotionState

__all__ = ['Margins', 'closest_by_unit', 'least_per_body', 'least_per_joint', 'margin_figures',
           'margins_along', 'published_margins', 'violated_at']


class Margins(NamedTuple):
    """Margins of one constraint over time.

    Attributes:
        constraint: Its name.
        unit: Its unit.
        bodies: Joint or body of each margin, length k.
        t: Shape (N,) [s].
        values: Distances to the nearer bound, shape (N, k).
    """

    constraint: str
    unit: str
    bodies: tuple[str, ...]
    t: np.ndarray
    values: np.ndarray


def _by_constraint(names: Sequence[MarginName], t: np.ndarray,
                   values: np.ndarray) -> tuple[Margins, ...]:
    """Split columns of margins, shape (N, K), by constraint, in the order of the names."""
    found = []
    for constraint, unit in dict.fromkeys((name.constraint, name.unit) for name in names):
        own = [i for i, name in enumerate(names) if name[1:] == (constraint, unit)]
        found.append(Margins(constraint, unit, tuple(names[i].body for i in own), t,
                             values[:, own]))
    return tuple(found)


def margins_along(constraints: Constraints, states: MotionState) -> tuple[Margins, ...]:
    """Return the margins of each constraint along a run of N samples."""
    return _by_constraint(constraints.names, np.asarray(states.t),
                          constraints.margins_along(states))


def published_margins(names: Sequence[str], t: np.ndarray,
                      values: np.ndarray) -> tuple[Margins, ...]:
    """Return the margins in what ``controller/barrier`` held: the smallest between two messages.

    Args:
        names: Names in the messages, length C; those that name no margin are passed over.
        t: Times, shape (N,) [s].
        values: Shape (N, C).
    """
    parsed = [(i, name) for i, name in enumerate(map(MarginName.parse, names)) if name]
    return _by_constraint([name for _, name in parsed], t, values[:, [i for i, _ in parsed]])


def violated_at(t: np.ndarray, margins: Iterable[Margins]) -> np.ndarray:
    """Return which of the samples at ``t``, (N,) [s] ascending, are not inside, shape (N,), bool.

    Margins at other times, as they were published, count for the sample at or before them.
    """
    violated = np.zeros(t.size, dtype=bool)
    for each in margins:
        outside = ~(each.values > 0.0).all(axis=1)
        if each.t.size == t.size and (each.t == t).all():
            violated |= outside
        else:
            at = np.searchsorted(t, each.t[outside] + 1e-9, side='right') - 1
            violated[np.maximum(at, 0)] = True
    return violated


def least_per_body(margins: Sequence[Margins]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return the smallest margin of each body over time: t (N,) [s] and margins (N,).

    Margins known at other times than the first ones keep the name of their constraint.
    """
    least: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    for each in margins:
        same = np.array_equal(each.t, margins[0].t)
        for body, values in zip(each.bodies, each.values.T):
            key = body if same else f'{body} {each.constraint}'
            known = least.get(key)
            least[key] = each.t, values if known is None else np.minimum(known[1], values)
    return least


def least_per_joint(joints: Sequence[str], margins: Iterable[Margins]) -> list[float]:
    """Return the smallest margin of each joint [rad] over all constraints in rad; inf for none."""
    least = dict.fromkeys(joints, np.inf)
    for each in margins:
        if each.unit != 'rad':
            continue
        for body, value in zip(each.bodies, np.fmin.reduce(each.values, axis=0)):
            if body in least:
                least[body] = float(np.fmin(least[body], value))
    return list(least.values())


def margin_figures(margins: Iterable[Margins]) -> list[dict[str, Any]]:
    """Return for each constraint the closest approach and the smallest margin of each body."""
    figures = []
    for each in margins:
        if not np.isfinite(each.values).any():
            continue
        k, i = np.unravel_index(np.nanargmin(each.values), each.values.shape)
        least = np.fmin.reduce(each.values, axis=0)
        figures.append({
            'constraint': each.constraint, 'unit': each.unit, 'body': each.bodies[i],
            'margin': float(each.values[k, i]), 't': float(each.t[k]),
            'least': dict(zip(each.bodies, least.tolist()))})
    return figures


def closest_by_unit(figures: Iterable[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Return of the figures of `margin_figures` the least in each unit: units do not compare."""
    least: dict[str, Mapping[str, Any]] = {}
    for each in figures:
        known = least.setdefault(each['unit'], each)
        if each['margin'] < known['margin']:
            least[each['unit']] = each
    return list(least.values())
