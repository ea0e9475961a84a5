# SPDX-License-Identifier: Apache-2.0
"""Where joints may be until they stand, and whether links touch obstacles anywhere in there.

A joint that decelerates with a_b or harder and does not turn back stays between where it is and
q̇|q̇|/(2 a_b) further on. The box of these intervals holds every posture until all joints stand,
however the joints are coupled. For a sphere of a link at p with radius r and a convex obstacle at
distance d, with u = ∂d/∂p, g = uᵀJ and every displacement x in the box [x̲, x̄] ∋ 0

    d(p(q + x)) ≥ d(p(q)) + Σ_j min(g_j x̲_j, g_j x̄_j) − ½ Σ_j ℓ_j |x_j| (|x_j| + 2 Σ_i |x_i|),

the inner sum over the joints i before j in the chain. The first part is the convexity of d, the
last the curvature of the motion: ∂²p/∂q_i∂q_j = z_i × (z_j × (p − o_j)) is not longer than the
distance of p from axis j, and that is ‖J_j‖ now and grows by at most the displacements behind it:

    ℓ_j = ‖J_j‖ + Σ_k ℓ_k |x_k|,   k behind j.

A box is contained in the one before while every joint brakes, so what was free once stays free.
"""

from __future__ import annotations

import math

import numpy as np

from adaptive_blf_control.arms.chain import Chain
from adaptive_blf_control.compiled import borrowed, jit
from adaptive_blf_control.limits.link_spheres import LinkSpheres, sphere_motion
from adaptive_blf_control.limits.obstacles import distance, Obstacles

__all__ = ['clearances', 'stop_box']


@jit
def stop_box(qd: np.ndarray, a: np.ndarray, error: np.ndarray, braking: np.ndarray,
             period: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return where the joints may be from now on, with a for one sample and then braking.

    Args:
        qd: Velocities now, shape (n,) [rad/s].
        a: Mean acceleration over the sample, shape (n,) [rad/s²].
        error: How far it may be from that, shape (n,) [rad/s²].
        braking: a_b, shape (n,) [rad/s²].
        period: h [s].

    Returns:
        x̲ ≤ 0, x̄ ≥ 0, both (n,) [rad], and dx/da of the end that the joint moves to, (n,) [s²].
    """
    n = qd.size
    low, high, slope = np.empty(n), np.empty(n), np.empty(n)
    for i in range(n):
        # The last sample of braking, and a joint that turns back there by the error.
        back = 2.0 * error[i] * period
        slack = (0.125 * braking[i] * period + 0.5 * back) * period + back * back / (
            2.0 * braking[i])
        high[i] = _reach(qd[i], a[i] + error[i], braking[i], period) + slack
        low[i] = -_reach(-qd[i], error[i] - a[i], braking[i], period) - slack
        end = qd[i] + period * a[i]
        slope[i] = period * abs(end) / braking[i] + 0.5 * period * period
    return low, high, slope


@jit
def _reach(speed: float, acceleration: float, braking: float, period: float) -> float:
    """Return how far a joint gets in one direction."""
    end = speed + period * acceleration
    after = end * end / (2.0 * braking) if end > 0.0 else 0.0
    moved = 0.5 * period * (speed + end)
    if speed > 0.0 > end:  # it turns within the sample
        moved = 0.5 * speed * speed / -acceleration
    # Its velocity is within the sample not above the larger of both ends by more than the change
    # of the acceleration, which the error of it counts twice.
    return max(moved + after, 0.0)


@jit
def clearances(chain: Chain, spheres: LinkSpheres, obstacles: Obstacles, q: np.ndarray,
               low: np.ndarray, high: np.ndarray, standstill: float, found: np.ndarray,
               now: np.ndarray, gradients: np.ndarray) -> None:
    """Write for each sphere and obstacle how free every posture of a box is at least.

    Args:
        chain: The chain.
        spheres: k of them.
        obstacles: l of them.
        q: Positions, shape (n,) [rad].
        low: x̲, shape (n,) [rad].
        high: x̄, shape (n,) [rad].
        standstill: Time until all joints stand, for obstacles that move [s].
        found: Least clearance in the box, shape (k, l) [m]; written.
        now: Clearance at q, shape (k, l) [m]; written.
        gradients: Change of ``found`` per displacement at the end of the box on the side where
            it is larger, signed as ``high``, shape (k, l, n) [m/rad]; written.
    """
    chain, spheres, obstacles = borrowed(chain), borrowed(spheres), borrowed(obstacles)
    n, count, most = q.size, spheres.body.size, obstacles.radius.size
    if count == 0 or most == 0:
        return
    points, jacobians, _, _ = sphere_motion(chain, spheres, q, np.zeros(n))
    normal, bend = np.empty(3), np.empty(n)
    for s in range(count):
        loss = _curvature(chain, jacobians[s], spheres.body[s], low, high, bend)
        for k in range(most):
            free = distance(obstacles, k, points[s], normal) - spheres.radius[s]
            now[s, k] = free
            closing = 0.0
            for r in range(3):
                closing += normal[r] * obstacles.velocity[k, r]
            free -= max(closing, 0.0) * standstill + loss
            for j in range(n):
                g = 0.0
                for r in range(3):
                    g += normal[r] * jacobians[s, r, j]
                forth, back = g * high[j], g * low[j]
                free += min(forth, back)
                if high[j] >= -low[j]:
                    gradients[s, k, j] = min(g, 0.0) - bend[j]
                else:
                    gradients[s, k, j] = max(g, 0.0) + bend[j]
            found[s, k] = free


@jit
def _curvature(chain: Chain, jacobian: np.ndarray, body: int, low: np.ndarray, high: np.ndarray,
               bend: np.ndarray) -> float:
    """Return ½ Σ ℓ_j |x_j| (|x_j| + 2 Σ |x_i|) [m], and its change per |x_j| in ``bend``, (n,)."""
    before = 0.0
    bend[:] = 0.0
    at = body
    while at > 0:
        j = chain.place[at - 1]
        before += max(high[j], -low[j])
        at = chain.parent[at - 1]
    loss, behind = 0.0, 0.0
    at = body
    while at > 0:  # from the sphere to the base
        j = chain.place[at - 1]
        x = max(high[j], -low[j])
        before -= x
        square = 0.0
        for r in range(3):
            square += jacobian[r, j] * jacobian[r, j]
        lever = math.sqrt(square) + behind
        loss += 0.5 * lever * x * (x + 2.0 * before)
        bend[j] += lever * (x + before) + behind
        behind += lever * x
        at = chain.parent[at - 1]
    return loss
