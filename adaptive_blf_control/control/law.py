# SPDX-License-Identifier: Apache-2.0
"""Backstepping law with the ABLF: stabilising function (27) and torque (34), (38).

Pure functions over arrays; :mod:`adaptive_blf_control.control.controller` holds the state.
"""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.compiled import jit
from adaptive_blf_control.control.barrier import active_bound, barrier_gradient, interior

__all__ = ['errors', 'growing_errors', 'limited', 'limited_answer', 'per_joint_coupling',
           'pseudoinverse_coupling', 'rate_limited', 'stabilising_function', 'torque',
           'unwound_term']


@jit
def stabilising_function(e1: np.ndarray, e1_dot: np.ndarray, yd_dot: np.ndarray,
                         yd_ddot: np.ndarray, b: np.ndarray, k1: np.ndarray,
                         ) -> tuple[np.ndarray, np.ndarray]:
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
def per_joint_coupling(e1: np.ndarray, e2: np.ndarray, b: np.ndarray,
                       weight: np.ndarray) -> np.ndarray:
    """Cancel L joint by joint: the gradient g itself, smooth, same V̇ as the paper's; [N·m]."""
    return barrier_gradient(e1, b, weight)


@jit
def pseudoinverse_coupling(e1: np.ndarray, e2: np.ndarray, b: np.ndarray,
                           weight: np.ndarray) -> np.ndarray:
    """The paper's (e2ᵀ)⁺ L with L = gᵀ e2 (28), (34): discontinuous at e2 = 0; [N·m]."""
    square = np.dot(e2, e2)
    if square <= 0.0:
        return np.zeros_like(e2)
    return e2 * (np.dot(barrier_gradient(e1, b, weight), e2) / square)


@jit
def torque(x: np.ndarray, theta: np.ndarray, k2: np.ndarray, e1: np.ndarray, e2: np.ndarray,
           b: np.ndarray, weight: np.ndarray, smooth: bool) -> np.ndarray:
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
    """
    coupling = (per_joint_coupling(e1, e2, b, weight) if smooth
                else pseudoinverse_coupling(e1, e2, b, weight))
    return np.dot(x, theta) - k2 * e2 - coupling


@jit
def limited(wanted: np.ndarray, limit: np.ndarray) -> np.ndarray:
    """Clip a torque to ±limit [N·m]; a NaN becomes 0, so that no torque is ever non-finite."""
    return np.where(np.isnan(wanted), 0.0, np.minimum(np.maximum(wanted, -limit), limit))


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
    reach = rate * max(0.0, dt)
    near = np.minimum(np.maximum(limited(wanted, limit), last - reach), last + reach)
    return limited(near, limit)


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
    return np.dot(np.where((given - wanted) * e2 > 0.0, 0.0, e2), x)


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
    e1 = q - yd
    b = active_bound(e1, lower, upper)
    b_dot = active_bound(e1, lower_dot, upper_dot)
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
