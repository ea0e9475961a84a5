# SPDX-License-Identifier: Apache-2.0
"""The way on which all joints stop, and how near links come to obstacles and to each other on it.

After a sample with the acceleration a every joint decelerates with a_b until it stands: the stop
path. An arm may go on because that path is free; where it may not, it follows the path, see
`Stop`; the joints are then within ρ of it, see `stop_path`. It is looked at between K + 1 points
in time. On a piece from A to B a point p of a link moves by Δp; it is off the straight line
between its ends by no more than 4 s (1 − s) D + R, s the part of the piece, with

    D = ¼ λ + Σ_j ℓ_j b_j,   λ = ½ Σ_j ℓ_j |x_j| (|x_j| + 2 Σ_i |x_i|),   R = Σ_j ℓ_j ρ_j,

x = q_B − q_A, the inner sum over the joints i before j in the chain. A joint is off its own
straight line by no more than 4 s (1 − s) b_j (`_bend`). λ is the curvature of the motion:
∂²p/∂q_i∂q_j = z_i × (z_j × (p − o_j)) is not longer than the distance of p from axis j, and that
is ‖J_j‖ at A and grows by at most the displacements behind it:

    ℓ_j = ‖J_j‖ + Σ_k ℓ_k |x_k|,   k behind j.

The distance d of a point from a convex obstacle is convex. So with its gradient u_A at A and u_B
at B, d is not below either of

    d_A + s u_Aᵀ Δp,   d_B − (1 − s) u_Bᵀ Δp,

less 4 s (1 − s) D + R. An obstacle that moves counts with its velocity: Δp is relative to it. Two
spheres of links are a point, the difference of their centres, before a sphere that stands still.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arms.chain import Chain, placements
from adaptive_blf_control.compiled import borrowed, jit
from adaptive_blf_control.limits.link_spheres import LinkSpheres, place_sphere, sphere_centres
from adaptive_blf_control.limits.obstacles import distance, Obstacles

__all__ = ['FAR', 'held_by_limits', 'kept_to', 'least_clearance', 'stop_clearances', 'stop_path',
           'StopPath']

PIECES = 6  # K
PULL = 0.2  # κ, part of the way back to the path that a sample makes
GROWTH = 2.0  # how many times as large as at the begin e may become on the way
FAR = 0.05  # clearance of the whole path beyond which nobody looks at its pieces [m]


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


@jit
def least_clearance(chain: Chain, spheres: LinkSpheres, obstacles: Obstacles, pairs: np.ndarray,
                    q: np.ndarray) -> float:
    """Return the least clearance of all pairs at q, shape (n,) [rad]; inf without pairs [m]."""
    centres, least = sphere_centres(chain, spheres, q), np.inf
    point, normal = np.empty(3), np.empty(3)
    for p in range(pairs.shape[0]):
        least = min(least, _apart(spheres, obstacles, pairs[p, 0], pairs[p, 1], 0.0, centres,
                                  point, normal))
    return least


@jit
def stop_clearances(chain: Chain, spheres: LinkSpheres, obstacles: Obstacles, pairs: np.ndarray,
                    q: np.ndarray, path: StopPath, found: np.ndarray, now: np.ndarray,
                    gradients: np.ndarray) -> None:
    """Write for each pair how free the whole path is at least.

    Args:
        chain: The chain.
        spheres: k of them.
        obstacles: l of them.
        pairs: A sphere, and an obstacle or −1 less another sphere, shape (p, 2).
        q: Positions, shape (n,) [rad].
        path: See `stop_path`.
        found: Least clearance on the path, shape (p,) [m]; written.
        now: Clearance at q, shape (p,) [m]; written.
        gradients: Change of ``found`` with a, shape (p, n) [m·s²/rad]; written, zero where it
            does not matter.
    """
    chain, spheres, obstacles = borrowed(chain), borrowed(spheres), borrowed(obstacles)
    n, count, last = q.size, spheres.body.size, path.time.size - 1
    centres, jacobians = np.empty((2, count, 3)), np.zeros((2, count, 3, n))
    used, far = np.ones(count, dtype=np.bool_), np.empty(n)
    _motion(chain, spheres, q, used, centres[0], jacobians[0])
    for j in range(n):
        farthest, bend = 0.0, 0.0
        for k in range(last):
            farthest = max(farthest, abs(path.shift[k + 1, j]))
            bend = max(bend, path.bend[k, j])
        far[j] = path.spread[last, j] + bend + farthest
    reach, lever = np.empty(count), np.zeros(n)
    for s in range(count):
        _levers(chain, jacobians[0, s], spheres.body[s], far, lever)
        reach[s] = 0.0
        for j in range(n):
            reach[s] += lever[j] * far[j]
        used[s] = False
    point, normal = np.empty(3), np.empty((2, 3))
    near = np.zeros(pairs.shape[0], dtype=np.bool_)
    any_near = False
    for p in range(pairs.shape[0]):
        s, k = pairs[p, 0], pairs[p, 1]
        now[p] = _apart(spheres, obstacles, s, k, 0.0, centres[0], point, normal[0])
        found[p] = now[p] - reach[s]
        if k < 0:
            found[p] -= reach[-1 - k]
        else:
            speed = 0.0
            for r in range(3):
                speed += obstacles.velocity[k, r] * obstacles.velocity[k, r]
            found[p] -= math.sqrt(speed) * path.time[last]
        for j in range(n):
            gradients[p, j] = 0.0
        if found[p] < FAR:
            near[p] = any_near = used[s] = True
            found[p] = np.inf
            if k < 0:
                used[-1 - k] = True
    if not any_near:
        return
    moved, later, step = np.empty(n), np.empty(3), np.empty(3)
    bows, offsets = np.zeros(count), np.zeros(count)
    for piece in range(last):
        a, b = piece % 2, (piece + 1) % 2
        for j in range(n):
            moved[j] = q[j] + path.shift[piece + 1, j]
        _motion(chain, spheres, moved, used, centres[b], jacobians[b])
        for j in range(n):
            moved[j] = abs(path.shift[piece + 1, j] - path.shift[piece, j])
            moved[j] += path.bend[piece, j] + path.spread[piece + 1, j]
        for s in range(count):
            if not used[s]:
                continue
            curved = _levers(chain, jacobians[a, s], spheres.body[s], moved, lever)
            bows[s], offsets[s] = 0.25 * curved, 0.0
            for j in range(n):
                bows[s] += lever[j] * path.bend[piece, j]
                offsets[s] += lever[j] * path.spread[piece + 1, j]
        for p in range(pairs.shape[0]):
            if not near[p]:
                continue
            s, k = pairs[p, 0], pairs[p, 1]
            first = _apart(spheres, obstacles, s, k, path.time[piece], centres[a], point,
                           normal[0])
            second = _apart(spheres, obstacles, s, k, path.time[piece + 1], centres[b], later,
                            normal[1])
            bow, off = bows[s], offsets[s]
            if k < 0:
                bow, off = bow + bows[-1 - k], off + offsets[-1 - k]
            ahead, back = 0.0, 0.0
            for r in range(3):
                step[r] = later[r] - point[r]
                ahead += normal[0, r] * step[r]
                back -= normal[1, r] * step[r]
            least, part = _least(first, second, ahead, back, bow)
            if least - off < found[p]:
                found[p] = least - off
                if piece == 0:
                    part = 1.0
                _gradient(jacobians, s, k, normal, part, a, path, piece, gradients[p])


@jit
def _gradient(jacobians: np.ndarray, s: int, k: int, normal: np.ndarray, part: float, a: int,
              path: StopPath, piece: int, gradient: np.ndarray) -> None:
    """Write the change of the distance at a part of a piece with the acceleration."""
    for j in range(gradient.size):
        gradient[j] = 0.0
        for end in range(2):
            at, weight = (a, 1.0 - part) if end == 0 else (1 - a, part)
            value = 0.0
            for r in range(3):
                column = jacobians[at, s, r, j]
                if k < 0:
                    column -= jacobians[at, -1 - k, r, j]
                value += normal[end, r] * column
            gradient[j] += weight * value * path.slope[piece + end, j]


@jit
def _least(first: float, second: float, ahead: float, back: float,
           bow: float) -> tuple[float, float]:
    """Return a bound of the distance on a piece from below, and the part of the piece it is at.

    Args:
        first: d_A [m].
        second: d_B [m].
        ahead: u_Aᵀ Δp, the change of the distance from A on [m].
        back: −u_Bᵀ Δp, that from B back [m].
        bow: D [m].
    """
    low, part = _sagging(first, ahead, bow)
    other, from_end = _sagging(second, back, bow)
    if other > low:
        low, part = other, 1.0 - from_end
    if ahead < 0.0 and back < 0.0:
        at = (second + back - first) / (ahead + back)
        at = min(max(at, 0.0), 1.0)
        crossing = max(first + at * ahead, second + (1.0 - at) * back) - bow
        if crossing > low:
            low, part = crossing, at
    return low, part


@jit
def _sagging(start: float, change: float, bow: float) -> tuple[float, float]:
    """Return the least of start + s change − 4 s (1 − s) bow on 0 ≤ s ≤ 1, and where it is."""
    if change >= 4.0 * bow:
        return start, 0.0
    if change <= -4.0 * bow:
        return start + change, 1.0
    sag = 4.0 * bow - change
    return start - sag * sag / (16.0 * bow), sag / (8.0 * bow)


@jit
def _apart(spheres: LinkSpheres, obstacles: Obstacles, s: int, k: int, time: float,
           centres: np.ndarray, point: np.ndarray, normal: np.ndarray) -> float:
    """Return the clearance of a pair; write the point before it, and the steepest ascent."""
    if k >= 0:
        for r in range(3):
            point[r] = centres[s, r] - time * obstacles.velocity[k, r]
        return distance(obstacles, k, point, normal) - spheres.radius[s]
    square = 0.0
    for r in range(3):
        point[r] = centres[s, r] - centres[-1 - k, r]
        square += point[r] * point[r]
    length = math.sqrt(square)
    for r in range(3):
        normal[r] = point[r] / max(length, 1e-12)
    return length - spheres.radius[s] - spheres.radius[-1 - k]


@jit
def _motion(chain: Chain, spheres: LinkSpheres, q: np.ndarray, used: np.ndarray,
            centres: np.ndarray, jacobians: np.ndarray) -> None:
    """Write the centres (k, 3) and their Jacobians (k, 3, n) of the spheres that are used."""
    frames, axes = placements(chain, q)
    for s in range(spheres.body.size):
        if not used[s]:
            continue
        body = spheres.body[s]
        place_sphere(centres[s], frames[body], spheres.centre[s])
        x, y, z = centres[s]
        while body > 0:
            axis, j = axes[body - 1], chain.place[body - 1]
            jacobians[s, 0, j] = axis[0] + axis[4] * z - axis[5] * y
            jacobians[s, 1, j] = axis[1] + axis[5] * x - axis[3] * z
            jacobians[s, 2, j] = axis[2] + axis[3] * y - axis[4] * x
            body = chain.parent[body - 1]


@jit
def _levers(chain: Chain, jacobian: np.ndarray, body: int, size: np.ndarray,
            lever: np.ndarray) -> float:
    """Write ℓ_j, shape (n,) [m/rad], for displacements of ``size``, (n,); return λ [m]."""
    before = 0.0
    lever[:] = 0.0
    at = body
    while at > 0:
        before += size[chain.place[at - 1]]
        at = chain.parent[at - 1]
    curved, behind = 0.0, 0.0
    at = body
    while at > 0:  # from the sphere to the base
        j = chain.place[at - 1]
        before -= size[j]
        square = 0.0
        for r in range(3):
            square += jacobian[r, j] * jacobian[r, j]
        lever[j] = math.sqrt(square) + behind
        curved += 0.5 * lever[j] * size[j] * (size[j] + 2.0 * before)
        behind += lever[j] * size[j]
        at = chain.parent[at - 1]
    return curved
