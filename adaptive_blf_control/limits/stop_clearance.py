# SPDX-License-Identifier: Apache-2.0
"""How near links come to obstacles and to each other on the way on which all joints stop.

The stop path (`stop_path`) is looked at piece by piece. On a piece from A to B a point p of a
link moves by Δp; it is off the straight line between its ends by no more than 4 s (1 − s) D + R,
s the part of the piece, with

    D = ¼ λ + Σ_j ℓ_j b_j,   λ = ½ Σ_j ℓ_j |x_j| (|x_j| + 2 Σ_i |x_i|),   R = Σ_j ℓ_j ρ_j,

x = q_B − q_A, the inner sum over the joints i before j in the chain; b_j and ρ_j are those of the
path. λ is the curvature of the motion: ∂²p/∂q_i∂q_j = z_i × (z_j × (p − o_j)) is not longer than
the distance of p from axis j, and that is ‖J_j‖ at A and grows by at most the displacements
behind it:

    ℓ_j = ‖J_j‖ + Σ_k ℓ_k |x_k|,   k behind j.

The distance d of a point from a convex obstacle is convex. So with its gradient u_A at A and u_B
at B, d is not below either of

    d_A + s u_Aᵀ Δp,   d_B − (1 − s) u_Bᵀ Δp,

less 4 s (1 − s) D + R. Two spheres of links are a point, the difference of their centres, before a
sphere that stands still. What moves is not looked at here: an arm gives way to it (`evasion`).
"""

from __future__ import annotations

import math

import numpy as np

from adaptive_blf_control.arms.chain import Chain, placements
from adaptive_blf_control.compiled import borrowed, jit
from adaptive_blf_control.limits.link_spheres import LinkSpheres, place_sphere, sphere_centres
from adaptive_blf_control.limits.obstacles import distance, Obstacles
from adaptive_blf_control.limits.stop_path import StopPath

__all__ = ['FAR', 'least_clearance', 'stop_clearances']

FAR = 0.05  # clearance of the whole path beyond which nobody looks at its pieces [m]


@jit
def least_clearance(chain: Chain, spheres: LinkSpheres, obstacles: Obstacles, pairs: np.ndarray,
                    q: np.ndarray) -> float:
    """Return the least clearance of all pairs at q, shape (n,) [rad]; inf without pairs [m]."""
    centres, least = sphere_centres(chain, spheres, q), np.inf
    point, normal = np.empty(3), np.empty(3)
    for p in range(pairs.shape[0]):
        least = min(least, _apart(spheres, obstacles, pairs[p, 0], pairs[p, 1], centres, point,
                                  normal))
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
    n, count = q.size, spheres.body.size
    centres, jacobians = np.empty((2, count, 3)), np.zeros((2, count, 3, n))
    used, lever, reach = np.ones(count, dtype=np.bool_), np.zeros(n), np.empty(count)
    near = np.zeros(pairs.shape[0], dtype=np.bool_)
    _motion(chain, spheres, q, used, centres[0], jacobians[0])
    _reaches(chain, spheres, path, jacobians[0], lever, reach)
    _find_near(spheres, obstacles, pairs, centres[0], reach, found, now, near, used)
    gradients[:] = 0.0
    if not near.any():
        return
    moved, bows, offsets = np.empty(n), np.zeros(count), np.zeros(count)
    for piece in range(path.time.size - 1):
        a, b = piece % 2, (piece + 1) % 2
        for j in range(n):
            moved[j] = q[j] + path.shift[piece + 1, j]
        _motion(chain, spheres, moved, used, centres[b], jacobians[b])
        _bows_and_offsets(chain, spheres, path, piece, jacobians[a], used, lever, bows, offsets)
        _find_on_piece(spheres, obstacles, pairs, path, piece, centres, jacobians, near, bows,
                       offsets, found, gradients)


@jit
def _reaches(chain: Chain, spheres: LinkSpheres, path: StopPath, jacobian: np.ndarray,
             lever: np.ndarray, reach: np.ndarray) -> None:
    """Write how far each sphere gets from where it is on the whole path, shape (k,) [m].

    Args:
        chain: The chain.
        spheres: k of them.
        path: See `stop_path`.
        jacobian: Of the centres where they are, shape (k, 3, n).
        lever: Shape (n,); written over.
        reach: Written.
    """
    n, last = lever.size, path.time.size - 1
    far = np.empty(n)
    for j in range(n):
        farthest, bend = 0.0, 0.0
        for k in range(last):
            farthest = max(farthest, abs(path.shift[k + 1, j]))
            bend = max(bend, path.bend[k, j])
        far[j] = path.spread[last, j] + bend + farthest
    for s in range(spheres.body.size):
        _levers(chain, jacobian[s], spheres.body[s], far, lever)
        reach[s] = 0.0
        for j in range(n):
            reach[s] += lever[j] * far[j]


@jit
def _find_near(spheres: LinkSpheres, obstacles: Obstacles, pairs: np.ndarray,
               centres: np.ndarray, reach: np.ndarray, found: np.ndarray, now: np.ndarray,
               near: np.ndarray, used: np.ndarray) -> None:
    """Tell the pairs whose pieces have to be looked at from those that stay far apart.

    Args:
        spheres: k of them.
        obstacles: l of them.
        pairs: See `stop_clearances`.
        centres: Of the spheres now, shape (k, 3) [m].
        reach: See `_reaches`.
        found: Least clearance where they stay apart, else infinite, shape (p,) [m]; written.
        now: Clearance now, shape (p,) [m]; written.
        near: Whether a pair does not, shape (p,); written.
        used: Whether a sphere is in such a pair, shape (k,); written.
    """
    point, normal = np.empty(3), np.empty(3)
    used[:] = False
    for p in range(pairs.shape[0]):
        s, k = pairs[p, 0], pairs[p, 1]
        now[p] = _apart(spheres, obstacles, s, k, centres, point, normal)
        found[p] = now[p] - reach[s]
        if k < 0:
            found[p] -= reach[-1 - k]
        near[p] = found[p] < FAR
        if near[p]:
            found[p] = np.inf
            used[s] = True
            if k < 0:
                used[-1 - k] = True


@jit
def _bows_and_offsets(chain: Chain, spheres: LinkSpheres, path: StopPath, piece: int,
                      jacobian: np.ndarray, used: np.ndarray, lever: np.ndarray,
                      bows: np.ndarray, offsets: np.ndarray) -> None:
    """Write D and R of a piece for each sphere that is used, shape (k,) each [m].

    Args:
        chain: The chain.
        spheres: k of them.
        path: See `stop_path`.
        piece: Which one.
        jacobian: Of the centres at its begin, shape (k, 3, n).
        used: Shape (k,).
        lever: Shape (n,); written over.
        bows: D; written.
        offsets: R; written.
    """
    n = lever.size
    moved = np.empty(n)
    for j in range(n):
        moved[j] = abs(path.shift[piece + 1, j] - path.shift[piece, j])
        moved[j] += path.bend[piece, j] + path.spread[piece + 1, j]
    for s in range(spheres.body.size):
        if not used[s]:
            continue
        curved = _levers(chain, jacobian[s], spheres.body[s], moved, lever)
        bows[s], offsets[s] = 0.25 * curved, 0.0
        for j in range(n):
            bows[s] += lever[j] * path.bend[piece, j]
            offsets[s] += lever[j] * path.spread[piece + 1, j]


@jit
def _find_on_piece(spheres: LinkSpheres, obstacles: Obstacles, pairs: np.ndarray, path: StopPath,
                   piece: int, centres: np.ndarray, jacobians: np.ndarray, near: np.ndarray,
                   bows: np.ndarray, offsets: np.ndarray, found: np.ndarray,
                   gradients: np.ndarray) -> None:
    """Lower what was found of each near pair to what is free on a piece.

    Args:
        spheres: k of them.
        obstacles: l of them.
        pairs: See `stop_clearances`.
        path: See `stop_path`.
        piece: Which one; it begins at index ``piece % 2`` of the next two, ends at the other.
        centres: Shape (2, k, 3) [m].
        jacobians: Shape (2, k, 3, n).
        near: Shape (p,).
        bows: D of each sphere, shape (k,) [m].
        offsets: R of each sphere, shape (k,) [m].
        found: Least clearance so far, shape (p,) [m]; written.
        gradients: Its change with a, shape (p, n) [m·s²/rad]; written.
    """
    a, b = piece % 2, (piece + 1) % 2
    point, later, normal = np.empty(3), np.empty(3), np.empty((2, 3))
    for p in range(pairs.shape[0]):
        if not near[p]:
            continue
        s, k = pairs[p, 0], pairs[p, 1]
        first = _apart(spheres, obstacles, s, k, centres[a], point, normal[0])
        second = _apart(spheres, obstacles, s, k, centres[b], later, normal[1])
        bow, off = bows[s], offsets[s]
        if k < 0:
            bow, off = bow + bows[-1 - k], off + offsets[-1 - k]
        ahead, back = 0.0, 0.0
        for r in range(3):
            step = later[r] - point[r]
            ahead += normal[0, r] * step
            back -= normal[1, r] * step
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
def _apart(spheres: LinkSpheres, obstacles: Obstacles, s: int, k: int, centres: np.ndarray,
           point: np.ndarray, normal: np.ndarray) -> float:
    """Return the clearance of a pair; write the point before it, and the steepest ascent."""
    if k >= 0:
        for r in range(3):
            point[r] = centres[s, r]
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
