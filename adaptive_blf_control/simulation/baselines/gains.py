# SPDX-License-Identifier: Apache-2.0
"""The gains of the baselines, all derived here from those of our own law in the scenario.

Near e1 = 0 our law (38) is a PD around the model: e2 ≈ ė1 + k1 b⁴ e1 and the coupling ≈ e1/b², so

    damping K_d = k2,    stiffness K_p = k2 k1 b⁴ + 1/b²,    b² the mean of both sides.

* PD and computed torque get exactly this stiffness and damping: the linearised loop is ours.
* Slotine-Li and integral CL get K_D = k2 on the sliding variable and Λ = √(K_p/M_ii), the natural
  frequency of our linearised loop. Their total damping, K_D + M Λ, is larger than ours.
* What they learn from (Γ, k_h, P, ε, minimum growth) is that of the scenario. Slotine-Li has no
  counterpart to it; its Γ was tuned, see `SLOTINE_LI_GAMMA`.

M_ii is the inertia of the nominal arm at the start of the reference. All are clipped to the same
torque limit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.control.controller import Controller

__all__ = ['Gains', 'SLOTINE_LI_GAMMA', 'WINDOW_LEAST', 'WRONG_MODEL', 'gains_like']

WRONG_MODEL = 0.7
"""Part of the nominal parameters that laws with a fixed, wrong model believe in."""
SLOTINE_LI_GAMMA = 200.0
"""Γ of Slotine-Li and of the tracking term of integral CL, as a multiple of the scenario's Γ.

The best in RMS of 1, 10, 50, 200 for both laws on three_link and three_link_encoder, 25 s."""
WINDOW_LEAST = 0.1
"""Shortest window that integral CL integrates over [s]."""


@dataclass(frozen=True)
class Gains:
    """Arrays of shape (n,).

    Attributes:
        damping: K_d = k2 [N·m·s/rad].
        stiffness: K_p [N·m/rad].
        inertia: M_ii of the nominal arm [kg·m²].
        bandwidth: Λ = √(K_p/M_ii) [rad/s].
        torque_limit: Largest torque [N·m].
    """

    damping: np.ndarray
    stiffness: np.ndarray
    inertia: np.ndarray
    bandwidth: np.ndarray
    torque_limit: np.ndarray


def gains_like(controller: Controller) -> Gains:
    """Return the gains that match the linearisation of ``controller``."""
    settings, sets, arm = controller.settings, controller.performance, controller.arm
    square = 0.5 * (sets.lower ** 2 + sets.upper ** 2)
    stiffness = settings.k2 * settings.k1 * square ** 2 + 1.0 / square
    inertia = _inertia(arm, controller.reference.at(0.0).position)
    return Gains(settings.k2, stiffness, inertia, np.sqrt(stiffness / inertia),
                 settings.torque_limit)


def _inertia(arm: Arm, q: np.ndarray) -> np.ndarray:
    return np.array([(arm.Y1(q, unit) @ arm.nominal)[i] for i, unit in enumerate(np.eye(arm.n))])
