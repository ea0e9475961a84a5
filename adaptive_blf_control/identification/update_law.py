# SPDX-License-Identifier: Apache-2.0
"""Update laws (20), (22), (37) with one implicit step: stable for every gain and step.

They differ in what goes into the step only:

* ``gradient`` (20): the present pair, k_h = 0 and no Xᵀe2. Its Γ is our k_t Γ.
* ``concurrent`` (22): the recorded pairs as well.
* ``ablf_concurrent`` (37): Xᵀe2 of the controller as well, which Theorem 2 needs.
"""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.compiled import jit

__all__ = ['implicit_step']


@jit
def implicit_step(theta: np.ndarray, dt: float, gamma: np.ndarray, kt: float, kh: float,
                  yf: np.ndarray, tf: np.ndarray, gram: np.ndarray, moment: np.ndarray,
                  adaptation_term: np.ndarray) -> np.ndarray:
    """Advance θ̂ over ``dt``: (37) is linear in θ̂, so its implicit Euler step is one solve.

    (Γ⁻¹ + dt [k_t Y_fᵀY_f + k_h G]) θ̂⁺ = Γ⁻¹ θ̂ + dt [k_t Y_fᵀ τ_f + k_h g − Xᵀe2]
    with G = Σ Y_fjᵀ Y_fj and g = Σ Y_fjᵀ τ_fj. It is solved for the increment θ̂⁺ − θ̂, which keeps
    the digits where the step is small.

    Args:
        theta: θ̂, shape (m,).
        dt: Step [s].
        gamma: Diagonal of Γ, shape (m,), > 0.
        kt: Gain on the present pair, ≥ 0.
        kh: Gain on the history stack, ≥ 0.
        yf: Present filtered regressor, shape (n, m).
        tf: Present filtered torque, shape (n,) [N·m].
        gram: G, shape (m, m).
        moment: g, shape (m,).
        adaptation_term: Xᵀ e2, shape (m,); zeros give (22).

    Returns:
        θ̂⁺, shape (m,).
    """
    information = kt * np.dot(yf.T, yf) + kh * gram
    slope = kt * np.dot(tf, yf) + kh * moment - adaptation_term - np.dot(information, theta)
    # Scaled by √Γ the matrix is I + (positive semi-definite): well conditioned from below.
    root = np.sqrt(gamma)
    matrix = np.eye(theta.size) + dt * root * (information * root).T
    return theta + root * np.linalg.solve(matrix, dt * root * slope)
