# SPDX-License-Identifier: Apache-2.0
"""The way on which all joints stop.

After a sample with the acceleration a every joint decelerates with a_b until it stands: the stop
path. An arm may go on because that path is free (`stop_clearance`); where it may not, it follows
the path, see `Stop`; the joints are then within ρ of it, see `stop_path`. It is looked at between
K + 1 points in time. On a piece between two of them a joint is off its own straight line by no
more than 4 s (1 − s) b_j (`_bend`), s the part of the piece.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptive_blf_control.compiled import jit

__all__ = ['held_by_limits', 'kept_to', 'stop_path', 'StopPath']

PIECES = 6  # K
PULL = 0.2  # κ, part of the way back to the path that a sample makes
GROWTH = 2.0  # how many times as large as at the begin e may become on the way


class StopPath(NamedTuple):
    """K + 1 points of a stop path; the first is where the joints are.

    Attributes:
        shift: Displacement of the joints, shape (K + 1, n) [rad].
        slope: Its change with a, shape (K + 1, n) [s²].
        spread: ρ, how far the joints may be from it, shape (K + 1, n) [rad].
        bend: b of each piece, shape (K, n) [rad].
        time: Shape (K + 1,) [s].
    """

    shift: np.ndarray
    slope: np.ndarray
    spread: np.ndarray
    bend: np.ndarray
    time: np.ndarray


@jit
def stop_path(qd: np.ndarray, a: np.ndarray, error: np.ndarray, braking: np.ndarray,
              period: float, held: np.ndarray) -> StopPath:
    """Return the path with a for one sample and then braking.

    Whoever follows it (`kept_to`) is off by x and v at a sample, and w of the sample before with
    |w| ≤ ē is in v = h (w − κ x₋ / h²), x₋ being x then. So y = x − ½ h v goes on as

        y₊ = y − ½ κ (y + y₋) + h² w,    x = ½ (y + y₊),

    whose answer to a single w is positive and sums up to 1 / κ for κ ≤ 0.34: |x| ≤ ē h² / κ, and
    ½ ē h² more between the samples. Where its own limits may stop a joint from coming back
    (``held``), its velocity may stay off by 2 ē h, also where it is to stand: these limits keep it
    off until there is room for ē. ē = 2 e, `GROWTH` of them.

    Args:
        qd: Velocities now, shape (n,) [rad/s].
        a: Mean acceleration over the sample, shape (n,) [rad/s²].
        error: e, how far it may be from that, shape (n,) [rad/s²].
        braking: a_b, shape (n,) [rad/s²].
        period: h [s].
        held: Of each joint, shape (n,); see `held_by_limits`.
    """
    n = qd.size
    shift, slope = np.zeros((PIECES + 1, n)), np.zeros((PIECES + 1, n))
    spread, bend, time = np.zeros((PIECES + 1, n)), np.empty((PIECES, n)), np.zeros(PIECES + 1)
    longest = 0.0
    for j in range(n):
        longest = max(longest, abs(qd[j] + period * a[j]) / braking[j])
    step = longest / PIECES
    for j in range(n):
        end = qd[j] + period * a[j]
        moved, stop = 0.5 * period * (qd[j] + end), abs(end) / braking[j]
        bend[0, j] = _bend(braking[j], stop + period, step + period)
        jolt = 0.5 * (abs(a[j]) + braking[j]) * period * period
        most = GROWTH * error[j] * period  # ē h
        drift = 2.0 * most if held[j] else 0.0
        for k in range(1, PIECES + 1):
            t = min(k * step, stop)
            way = abs(end) * t - 0.5 * braking[j] * t * t
            shift[k, j] = moved + (way if end > 0.0 else -way)
            slope[k, j] = (0.5 * period + t) * period
            spread[k, j] = most * period * (1.0 / PULL + 0.5) + jolt
            spread[k, j] += drift * (period + k * step)
            if k > 1:
                bend[k - 1, j] = _bend(braking[j], stop - (k - 1) * step, step)
    for k in range(1, PIECES + 1):
        time[k] = period + k * step
    return StopPath(shift, slope, spread, bend, time)


@jit
def held_by_limits(q: np.ndarray, qd: np.ndarray, a: np.ndarray, error: np.ndarray,
                   lower: np.ndarray, upper: np.ndarray, speed: np.ndarray, braking: np.ndarray,
                   period: float) -> np.ndarray:
    """Return whether its own limits may stop a joint from following its stop path, shape (n,).

    Who is off it by up to ē h² / κ goes for its velocity after the sample, and up to ē h beside.
    With ē more, by which bounds of the acceleration are narrowed (`acceleration_bounds`), that is
    g = 2 ē h from it, and the stop from there ends

        (v g + ½ g²) / a_b + ē h² (1 / κ + 2) + ¼ a_b h²

    farther than that from the path, v its velocity towards the limit. Where that is inside, and
    |v| + g no more than the largest velocity, nothing is cut off.

    Args:
        q: Positions now, shape (n,) [rad].
        qd: Velocities now, shape (n,) [rad/s].
        a: Mean acceleration over the sample, shape (n,) [rad/s²].
        error: e, shape (n,) [rad/s²].
        lower: Position limits, shape (n,) [rad].
        upper: Likewise.
        speed: Velocity limits, shape (n,) [rad/s].
        braking: a_b, shape (n,) [rad/s²].
        period: h [s].
    """
    held = np.empty(q.size, dtype=np.bool_)
    for j in range(q.size):
        end, most = qd[j] + period * a[j], GROWTH * error[j] * period
        after = q[j] + 0.5 * period * (qd[j] + end)
        more, around = 2.0 * most, most * period * (1.0 / PULL + 2.0)
        around += 0.25 * braking[j] * period * period
        held[j] = abs(end) + more > speed[j]
        for side in (-1.0, 1.0):
            v = max(side * end, 0.0)
            room = upper[j] - after if side > 0.0 else after - lower[j]
            reach = (v * (0.5 * v + more) + 0.5 * more * more) / braking[j]
            held[j] = held[j] or room < reach + around
    return held


@jit
def _bend(braking: float, rest: float, length: float) -> float:
    """Return b of a joint that brakes until it stands, and then stands [rad].

    It is off the straight line between the ends of a piece of length T by

        a_b t (r − ½ t),  r = τ (1 − τ / 2T),     until it stands, then  ½ a_b τ² (1 − t / T),

    τ ≤ T being how long it brakes. Neither is more than 4 s (1 − s) b with s = t / T and
    b = ¼ a_b r T: the first because of 2 r ≤ T, the second because of τ ≤ t and τ ≤ 2 r. Braking
    for all of the piece has b = ⅛ a_b T², standing none.

    The first piece begins with a sample that the joint does not brake in. It is taken to do so;
    what that is off, and that braking at samples stops later than at any time, by ⅛ a_b h² at
    most, is in the spread.

    Args:
        braking: a_b [rad/s²].
        rest: How long the joint still brakes, more than T or less than 0 where it does [s].
        length: T [s].
    """
    if rest <= 0.0:
        return 0.0
    rest = min(rest, length)
    return 0.25 * braking * rest * (length - 0.5 * rest)


@jit
def kept_to(a: np.ndarray, place: np.ndarray, speed: np.ndarray, q: np.ndarray, qd: np.ndarray,
            error: np.ndarray, period: float) -> np.ndarray:
    """Return the acceleration that leads back to a path, shape (n,) [rad/s²].

    Args:
        a: Of the path, shape (n,) [rad/s²].
        place: Where the joints are on it, shape (n,) [rad].
        speed: Their velocities on it, shape (n,) [rad/s].
        q: Where they are, shape (n,) [rad].
        qd: Their velocities, shape (n,) [rad/s].
        error: e, how far an acceleration may be from the one that is asked for, shape (n,)
            [rad/s²].
        period: h [s].
    """
    kept = np.empty(q.size)
    for j in range(q.size):
        back = PULL / period ** 2 * (place[j] - q[j])
        kept[j] = a[j] + (speed[j] - qd[j]) / period + min(max(back, -error[j]), error[j])
    return kept
