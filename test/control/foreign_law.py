# SPDX-License-Identifier: Apache-2.0
"""A law that shares no code with ours: a stiff spring with damping."""

from __future__ import annotations

from adaptive_blf_control import LawAnswer


class Spring:
    """τ = −300 e1 − 60 ė1, whatever the arm."""

    def __init__(self, arm, settings) -> None:
        self.asked = 0

    def answer(self, sample):
        self.asked += 1
        rate = sample.qd - sample.reference.velocity
        return LawAnswer(-300.0 * (sample.q - sample.reference.position) - 60.0 * rate, rate, None)
