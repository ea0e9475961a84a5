# SPDX-License-Identifier: Apache-2.0
"""The arm over time as a skeleton of points, with few enough frames for a page."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.errors import BlfError
from adaptive_blf_control.runs.lyapunov import arm_of
from adaptive_blf_control.runs.recording import Recording, Series

__all__ = ['FRAMES', 'Animation', 'animate', 'skeleton']

FRAMES = 300
STEP = 0.05  # s between two marks of the tip
Points = Callable[[np.ndarray], np.ndarray]


class Animation(NamedTuple):
    """Skeletons over time.

    Attributes:
        t: Times of the frames, shape (F,) [s].
        arms: For each bag the measured points (F, k, 3) [m], or None.
        references: For each bag the points of the reference posture, likewise.
        planar: Whether every point has z = 0.
        notes: How an arm is drawn where its geometry is not known.
        disturbed: For each bag the tip while an external torque was beyond its bound, (K, 3) [m],
            or None.
    """

    t: np.ndarray
    arms: list[np.ndarray | None]
    references: list[np.ndarray | None]
    planar: bool
    notes: list[str]
    disturbed: list[np.ndarray | None]


def skeleton(recording: Recording) -> tuple[Points, str | None]:
    """Return q ↦ points of the arm, (k, 3) [m], and a note where its geometry is not known."""
    try:
        return arm_of(recording).link_points, None
    except BlfError as error:
        note = f'{recording.name}: drawn as a planar chain of links of 1 m ({error})'
        return _unit_chain, note


def _unit_chain(q: np.ndarray) -> np.ndarray:
    angle = np.cumsum(q)
    steps = np.column_stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)])
    return np.vstack([np.zeros((1, 3)), np.cumsum(steps, axis=0)])


def animate(recordings: Sequence[Recording], frames: int = FRAMES) -> Animation | None:
    """Return at most ``frames`` skeletons per bag; None where no bag has positions."""
    moving = [r for r in recordings if _usable(r.q)]
    if not moving:
        return None
    begin = min(float(r.q.t[0]) for r in moving if r.q)
    end = max(float(r.q.t[-1]) for r in moving if r.q)
    t = np.linspace(max(begin, 0.0), end, frames)
    arms: list[np.ndarray | None] = []
    references: list[np.ndarray | None] = []
    notes = []
    disturbed: list[np.ndarray | None] = []
    for recording in recordings:
        if not _usable(recording.q):
            arms.append(None)
            references.append(None)
            disturbed.append(None)
            continue
        points, note = skeleton(recording)
        notes += [note] if note else []
        arms.append(_frames(recording.q, t, points))
        references.append(_frames(recording.reference, t, points))
        disturbed.append(_tips(recording, points))
    drawn = [a for a in arms if a is not None]
    planar = all(float(np.abs(a[..., 2]).max()) < 1e-9 for a in drawn)
    return Animation(t, arms, references, planar, notes, disturbed)


def _tips(recording: Recording, points: Points) -> np.ndarray | None:
    spans = recording.disturbed
    if not spans:
        return None
    times = np.concatenate([np.arange(begin, end + 1e-9, STEP) for begin, end in spans])
    times = times[::-(-times.size // FRAMES)]
    frames = _frames(recording.q, times, points)
    return None if frames is None else frames[:, -1]


def _usable(series: Series | None) -> bool:
    return series is not None and bool(np.isfinite(series.values).all(axis=1).any())


def _frames(series: Series | None, t: np.ndarray, points: Points) -> np.ndarray | None:
    """Points at the last sample before each frame, shape (F, k, 3)."""
    if series is None or not _usable(series):
        return None
    good = np.isfinite(series.values).all(axis=1)
    times, values = series.t[good], series.values[good]
    at = np.clip(np.searchsorted(times, t, side='right') - 1, 0, times.size - 1)
    return np.array([np.asarray(points(values[i]), dtype=float) for i in at])
