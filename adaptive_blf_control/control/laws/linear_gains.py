# SPDX-License-Identifier: Apache-2.0
"""The gains of the laws that ours is compared with, derived from those of ours.

Near e1 = 0 our law (38) is a PD around the model: e2 ≈ ė1 + k1 b⁴ e1 and the coupling ≈ c e1/b²
with c the weight of the barrier, so

    damping K_d = k2,    stiffness K_p = k2 k1 b⁴ + c/b²,    b² the mean of both sides.

* PD and computed torque get exactly this stiffness and damping: the linearised loop is ours.
* Slotine-Li gets K_D = k2 on the sliding variable and Λ = √(K_p/M_ii), the natural frequency of
  our linearised loop. Its total damping, K_D + M Λ, is larger than ours.

M_ii is the inertia of the nominal arm where the motion begins.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.control.settings import ControllerSettings
from adaptive_blf_control.errors import ParameterError

__all__ = ['LinearGains', 'joint_inertia', 'linear_gains']


class LinearGains(NamedTuple):
    """Gains of the linearised loop, each of shape (n,).

    Attributes:
        damping: K_d [N·m·s/rad].
        stiffness: K_p [N·m/rad].
    """

    damping: np.ndarray
    stiffness: np.ndarray


def linear_gains(settings: ControllerSettings) -> LinearGains:
    """Return stiffness and damping of (38) near e1 = 0; the arrays of full length."""
    square = 0.5 * (settings.performance.lower ** 2 + settings.performance.upper ** 2)
    return LinearGains(settings.k2, settings.k2 * settings.k1 * square ** 2
                       + settings.barrier_weight / square)


def joint_inertia(arm: Arm, q: np.ndarray) -> np.ndarray:
    """Return M_ii(q) of the nominal arm, shape (n,) [kg·m²].

    Raises:
        ParameterError: the nominal parameters give a joint no inertia.
    """
    inertia = np.array([(arm.Y1(q, unit) @ arm.nominal)[i]
                        for i, unit in enumerate(np.eye(arm.n))])
    if not (inertia > 0.0).all():
        raise ParameterError('controller.law', inertia.tolist(), 'an arm whose nominal parameters '
                             'give every joint an inertia > 0 kg·m²')
    return inertia
