# SPDX-License-Identifier: Apache-2.0
"""Backstepping law with the ABLF: stabilising function (27) and torque (34), (38).

Pure functions over arrays; :mod:`adaptive_blf_control.control.controller` holds the state.
"""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.compiled import dot, jit
from adaptive_blf_control.control.barrier import (
    active_bound,
    barrier_gradient,
    bound_towards,
    Each,
    INTERIOR,
    interior,
)

__all__ = ['add_unwound', 'errors', 'growing_errors', 'joint_errors', 'limited',
           'limited_answer', 'limited_joint', 'per_joint_coupling', 'pseudoinverse_coupling',
           'rate_limited', 'rate_limited_joint', 'stabilising_function', 'torque', 'unwound_term',
           'write_torque']


@jit
def stabilising_function(e1: Each, e1_dot: Each, yd_dot: Each, yd_ddot: Each, b: Each,
                         k1: Each) -> tuple[Each, Each]:
    """Equation (27) per joint and its derivative, which needs no acceleration.

    α = ẏ_d − k1 w² e1 and α̇ = ÿ_d − k1 (w² − 4 e1² w) ė1 with w = b² − e1².

    Args:
        e1: Tracking error, shape (n,) [rad].
        e1_dot: q̇ − ẏ_d, shape (n,) [rad/s].
        yd_dot: Reference velocity, shape (n,) [rad/s].
        yd_ddot: Reference acceleration, shape (n,) [rad/s²].
        b: Active bound (11), shape (n,) [rad].
        k1: Gains, shape (n,) [1/(s·rad⁴)].

    Returns:
        α [rad/s] and α̇ [rad/s²], each of shape (n,).
    """
    e = interior(e1, b)
    w = b * b - e * e
    alpha = yd_dot - k1 * w * w * e
    alpha_dot = yd_ddot - k1 * (w * w - 4.0 * e * e * w) * e1_dot
    return alpha, alpha_dot


@jit
def per_joint_coupling(e1: Each, e2: Each, b: Each, weight: Each) -> Each:
    """Cancel L joint by joint: the gradient g itself, smooth, same V̇ as the paper's; [N·m]."""
    return barrier_gradient(e1, b, weight)


@jit
def pseudoinverse_coupling(e1: np.ndarray, e2: np.ndarray, b: np.ndarray,
                           weight: np.ndarray) -> np.ndarray:
    """The paper's (e2ᵀ)⁺ L with L = gᵀ e2 (28), (34): discontinuous at e2 = 0; [N·m]."""
    square = dot(e2, e2, e2.size)
    if square <= 0.0:
        return np.zeros_like(e2)
    return e2 * (dot(barrier_gradient(e1, b, weight), e2, e2.size) / square)


@jit
def torque(x: np.ndarray, theta: np.ndarray, k2: np.ndarray, e1: np.ndarray, e2: np.ndarray,
           b: np.ndarray, weight: np.ndarray, smooth: bool,
           reach: float = INTERIOR) -> np.ndarray:
    """Equation (38), and (34) with θ* in place of θ̂: τ = X θ̂ − k2 e2 − coupling, (n,) [N·m].

    Args:
        x: Regressor X of (35), shape (n, m).
        theta: θ̂ or θ*, shape (m,).
        k2: Gains, shape (n,) [N·m·s/rad].
        e1: Tracking error, shape (n,) [rad].
        e2: q̇ − α, shape (n,) [rad/s].
        b: Active bound (11), shape (n,) [rad].
        weight: Weights of the barrier, shape (n,) [J].
        smooth: Coupling per joint (True) or by the paper's pseudoinverse (False).
        reach: Part of the bound beyond which the coupling is what it is there.
    """
    wanted = np.empty_like(e2)
    write_torque(wanted, x, theta, k2, e1, e2, b, weight, smooth, reach)
    return wanted


@jit
def write_torque(wanted: np.ndarray, x: np.ndarray, theta: np.ndarray, k2: np.ndarray,
                 e1: np.ndarray, e2: np.ndarray, b: np.ndarray, weight: np.ndarray,
                 smooth: bool, reach: float) -> None:
    """Write `torque` into ``wanted``, shape (n,) [N·m]."""
    for i in range(wanted.size):
        modelled = 0.0
        for j in range(theta.size):
            modelled += x[i, j] * theta[j]
        wanted[i] = modelled - k2[i] * e2[i]
        if smooth:
            near = min(max(e1[i], -reach * b[i]), reach * b[i])
            wanted[i] -= per_joint_coupling(near, e2[i], b[i], weight[i])
    if not smooth:
        near_all = np.maximum(np.minimum(e1, reach * b), -reach * b)
        wanted -= pseudoinverse_coupling(near_all, e2, b, weight)


@jit
def limited(wanted: np.ndarray, limit: np.ndarray) -> np.ndarray:
    """Clip a torque to ±limit [N·m]; a NaN becomes 0, so that no torque is ever non-finite."""
    given = np.empty_like(wanted)
    for i in range(given.size):
        given[i] = limited_joint(wanted[i], limit[i])
    return given


@jit
def limited_joint(wanted: float, limit: float) -> float:
    """`limited` for one joint [N·m]."""
    if wanted != wanted:
        return 0.0
    return min(max(wanted, -limit), limit)


@jit
def rate_limited(wanted: np.ndarray, limit: np.ndarray, last: np.ndarray, rate: np.ndarray,
                 dt: float) -> np.ndarray:
    """Clip a torque to ±limit and to last ± rate dt, shape (n,) [N·m]; always finite.

    Where the two contradict each other, the limit having been lowered below the last torque, the
    limit wins.

    Args:
        wanted: Torque of the law, shape (n,) [N·m]; NaN counts as 0.
        limit: Largest torque, shape (n,) [N·m].
        last: Torque commanded last, finite, shape (n,) [N·m].
        rate: Largest rate of change, shape (n,) [N·m/s].
        dt: Time since then [s]; below 0 counts as 0.
    """
    given = np.empty_like(wanted)
    for i in range(given.size):
        given[i] = rate_limited_joint(wanted[i], limit[i], last[i], rate[i], dt)
    return given


@jit
def rate_limited_joint(wanted: float, limit: float, last: float, rate: float,
                       dt: float) -> float:
    """`rate_limited` for one joint [N·m]."""
    reach = rate * max(0.0, dt)
    near = min(max(limited_joint(wanted, limit), last - reach), last + reach)
    return limited_joint(near, limit)


@jit
def unwound_term(x: np.ndarray, e2: np.ndarray, wanted: np.ndarray,
                 given: np.ndarray) -> np.ndarray:
    """Xᵀe2 (37) without the joints that would drive their torque further into a limit, (m,).

    Row i moves its own wanted torque by −X_i Γ X_iᵀ e2_i: towards the sign of −e2_i.

    Args:
        x: Regressor X of (35), shape (n, m).
        e2: q̇ − α, shape (n,) [rad/s].
        wanted: Torque before the limits, shape (n,) [N·m].
        given: Torque after them, shape (n,) [N·m].
    """
    term = np.zeros(x.shape[1])
    add_unwound(term, x, e2, wanted, given)
    return term


@jit
def add_unwound(term: np.ndarray, x: np.ndarray, e2: np.ndarray, wanted: np.ndarray,
                given: np.ndarray) -> None:
    """Add `unwound_term` to ``term``, shape (m,)."""
    for i in range(e2.size):
        if not (given[i] - wanted[i]) * e2[i] > 0.0:
            for j in range(term.size):
                term[j] += e2[i] * x[i, j]


@jit
def limited_answer(wanted: np.ndarray, x: np.ndarray, e2: np.ndarray, limit: np.ndarray,
                   last: np.ndarray, rate: np.ndarray, dt: float, e1: np.ndarray,
                   lower: np.ndarray, upper: np.ndarray,
                   ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the torque after the limits, Xᵀe2 (37) and the active bound (11), in one call.

    See `rate_limited`, `unwound_term` and `active_bound`.
    """
    given = rate_limited(wanted, limit, last, rate, dt)
    return given, unwound_term(x, e2, wanted, given), active_bound(e1, lower, upper)


@jit
def growing_errors(q: np.ndarray, qd: np.ndarray, yd: np.ndarray, yd_dot: np.ndarray,
                   yd_ddot: np.ndarray, lower: np.ndarray, upper: np.ndarray,
                   lower_dot: np.ndarray, upper_dot: np.ndarray, k1: np.ndarray,
                   ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Everything the law needs before the regressor: e1 (5), e2, α, α̇ and the active bound.

    A bound that moves adds ∂α/∂b ḃ = −4 k1 b w e1 ḃ to α̇.
    """
    e1, e2 = np.empty_like(q), np.empty_like(q)
    alpha, alpha_dot, b = np.empty_like(q), np.empty_like(q), np.empty_like(q)
    for i in range(q.size):
        e1[i], e2[i], alpha[i], alpha_dot[i], b[i] = joint_errors(
            q[i], qd[i], yd[i], yd_dot[i], yd_ddot[i], lower[i], upper[i], lower_dot[i],
            upper_dot[i], k1[i])
    return e1, e2, alpha, alpha_dot, b


@jit
def joint_errors(q: float, qd: float, yd: float, yd_dot: float, yd_ddot: float, lower: float,
                 upper: float, lower_dot: float, upper_dot: float, k1: float,
                 ) -> tuple[float, float, float, float, float]:
    """`growing_errors` of one joint."""
    e1 = q - yd
    b = bound_towards(e1, lower, upper)
    b_dot = bound_towards(e1, lower_dot, upper_dot)
    alpha, alpha_dot = stabilising_function(e1, qd - yd_dot, yd_dot, yd_ddot, b, k1)
    e = interior(e1, b)
    alpha_dot = alpha_dot - 4.0 * k1 * b * (b * b - e * e) * e * b_dot
    return e1, qd - alpha, alpha, alpha_dot, b


@jit
def errors(q: np.ndarray, qd: np.ndarray, yd: np.ndarray, yd_dot: np.ndarray,
           yd_ddot: np.ndarray, lower: np.ndarray, upper: np.ndarray, k1: np.ndarray,
           ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """`growing_errors` with bounds at rest."""
    rest = np.zeros_like(q)
    return growing_errors(q, qd, yd, yd_dot, yd_ddot, lower, upper, rest, rest, k1)
