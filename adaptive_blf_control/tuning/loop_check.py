# SPDX-License-Identifier: Apache-2.0
"""Whether the gains of a controller fit the arm, its reference and the delay of its loop."""

from __future__ import annotations

from collections.abc import Iterator
import math
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.control.reference import Reference
from adaptive_blf_control.control.settings import ControllerSettings
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.tuning.gains import (
    adaptation_stiffness,
    barrier_weight,
    FRICTION,
    law_gains,
)
from adaptive_blf_control.tuning.inertia import (
    COUNT,
    damping_rate,
    known_masses,
    reference_states,
    seen_inertia,
    SeenInertia,
    viscous_friction,
)
from adaptive_blf_control.tuning.loop_delay import LoopDelay, phase_margin

__all__ = ['LoopCheck', 'check_loop', 'joint_phases', 'warnings_of_loop']

LEAST_GAIN_MARGIN, LEAST_PHASE = 1.5, math.radians(15.0)  # below these there is a warning
ROUNDING = 1.01  # a gain is rounded to a few digits


class LoopCheck(NamedTuple):
    """The margins of a loop along its reference; arrays of shape (n,).

    Attributes:
        joints: Names of the joints.
        model: Whose inertia was taken, ``estimate`` or ``nominal``.
        delay: Of the loop.
        inertia: What the joints see.
        rate: λ_max(M⁻¹ K2) over the postures [1/s].
        phase: Phase margin of each joint with its barrier, other joints giving way [rad].
        k1: Present gains [1/(s·rad⁴)].
        k2: Present gains [N·m·s/rad].
        weight: Present weights of the barrier [J].
        fitting_k1: Gains k1 that a loop with such a performance set has room for [1/(s·rad⁴)].
        fitting_k2: The present gains, lowered where the gain margin is below 3 [N·m·s/rad].
        fitting_weight: Weights of the barrier that go with them [J].
    """

    joints: tuple[str, ...]
    model: str
    delay: LoopDelay
    inertia: SeenInertia
    rate: float
    phase: np.ndarray
    k1: np.ndarray
    k2: np.ndarray
    weight: np.ndarray
    fitting_k1: np.ndarray
    fitting_k2: np.ndarray
    fitting_weight: np.ndarray

    @property
    def unstable(self) -> bool:
        """Whether the linearised loop oscillates."""
        return self.rate >= self.delay.largest_rate or bool((self.phase <= 0.0).any())

    def problems(self) -> Iterator[str]:
        """Yield a sentence for what is unstable or close to it, with the gains that would do."""
        limit = self.delay.largest_rate
        if self.rate * LEAST_GAIN_MARGIN > limit:
            yield (f'k2: λ_max(M⁻¹ k2) reaches {self.rate:.4g} 1/s along the reference with the '
                   f'{self.model} parameters; a loop with {self._delay_text()} '
                   + ('is unstable from' if self.rate >= limit else 'has little margin to')
                   + f' {limit:.4g} 1/s. {self._fitting("k2", self.k2, self.fitting_k2)}')
        elif (self.phase < LEAST_PHASE).any():
            yield self._phase_problem(int(np.argmin(self.phase)))

    def _phase_problem(self, worst: int) -> str:
        """Say what a joint with too little phase has too much of."""
        has = (f'joint {self.joints[worst]!r} has a phase margin of '
               f'{math.degrees(self.phase[worst]):.0f} degrees: ')
        loop = f'in a loop with {self._delay_text()}. '
        if self.weight[worst] > ROUNDING * self.fitting_weight[worst]:
            return (f'barrier_weight: {has}the stiffness of its barrier moves '
                    f'{self.inertia.least[worst]:.3g} kg·m² {loop}'
                    + self._fitting('barrier_weight', self.weight, self.fitting_weight))
        return (f'k1: {has}k1 b⁴, b its bound in the performance set, is too fast {loop}'
                + self._fitting('k1', self.k1, self.fitting_k1))

    def refuse_unstable(self) -> None:
        """Raise ParameterError where the loop is unstable, with what would do."""
        if not self.unstable:
            return
        text = next(self.problems())
        name, _, detail = text.partition(': ')
        value = {'k1': self.k1, 'k2': self.k2, 'barrier_weight': self.weight}[name]
        raise ParameterError(f'controller.{name}', _rounded(value), f'a stable loop: {detail}')

    def _delay_text(self) -> str:
        return f'{1e3 * self.delay.total:.3g} ms of delay at {1.0 / self.delay.period:.4g} Hz'

    def _fitting(self, name: str, present: np.ndarray, fitting: np.ndarray) -> str:
        above = [joint for joint, each in zip(self.joints, present > ROUNDING * fitting) if each]
        return (f'{name} {_rounded(np.minimum(present, fitting))} would do (lower for '
                f'{", ".join(above)})')


def check_loop(arm: Arm, settings: ControllerSettings, reference: Reference, theta: np.ndarray,
               delay: LoopDelay, *, gamma: np.ndarray | None = None,
               count: int = COUNT) -> LoopCheck | None:
    """Return the margins of a loop, or None where no model tells the inertia of the arm.

    Args:
        arm: The arm.
        settings: Gains and sets.
        reference: Along which the inertia is taken.
        theta: θ̂ in use, shape (m,); where it has no inertia the nominal arm counts.
        delay: Of the loop.
        gamma: Diagonal of Γ, shape (m,); None leaves the adaptation out.
        count: Number of postures.
    """
    settings, states = settings.resolved(joints=arm.n), reference_states(reference, count)
    known = known_masses(arm, theta, states.q)
    if known is None:
        return None
    model, masses = known
    inertia = seen_inertia(masses)
    friction = viscous_friction(arm, theta if model == 'estimate' else arm.nominal)
    damping = np.maximum(settings.k2 - FRICTION * friction, 0.0)
    adaptation = 0.0 if gamma is None else adaptation_stiffness(arm, masses, states, gamma)
    bounds = (-settings.performance.lower, settings.performance.upper)
    bound = np.minimum(*bounds)
    fitting = np.minimum(law_gains(inertia, friction, bound, delay).k2, settings.k2)
    return LoopCheck(arm.joints, model, delay, inertia, damping_rate(masses, damping),
                     joint_phases(settings, inertia.least + friction * delay.total,
                                  adaptation, delay), settings.k1, settings.k2,
                     settings.barrier_weight,
                     law_gains(inertia, friction, np.maximum(*bounds), delay).k1, fitting,
                     barrier_weight(fitting, bound, delay))


def warnings_of_loop(check: LoopCheck | None, unstable: str) -> Iterator[str]:
    """Yield what is to be said about a loop before it runs.

    Args:
        check: Its margins.
        unstable: ``controller.loop.unstable``.

    Raises:
        ParameterError: it is unstable, and ``unstable`` is ``refuse``.
    """
    if check is None:
        yield ('neither the estimate nor the nominal parameters have an inertia along the '
               'reference: nothing is known about the stability of the gains')
        return
    if unstable == 'refuse':
        check.refuse_unstable()
    yield from check.problems()


def joint_phases(settings: ControllerSettings, inertia: np.ndarray,
                 adaptation: np.ndarray | float, delay: LoopDelay) -> np.ndarray:
    """Return the phase margin of each joint on the side where it is smaller, (n,) [rad].

    Args:
        settings: Gains and performance set, of full length.
        inertia: That the joints see, with F D for a friction F whose compensation is late by D:
            F (1 − e^(−sD)) ≈ s F D; shape (n,) [kg·m²].
        adaptation: Stiffness of the adaptation per inertia, shape (n,) [1/s²].
        delay: Of the loop.
    """
    margins, rate = [], settings.k2 / inertia
    for bound in (-settings.performance.lower, settings.performance.upper):
        outer = settings.k1 * bound ** 4
        barrier = settings.barrier_weight / (bound ** 2 * inertia)
        margins.append(phase_margin(rate + outer, outer * rate + barrier + adaptation, delay))
    return np.minimum(*margins)


def _rounded(values: np.ndarray) -> list[float]:
    return [float(f'{value:.3g}') for value in values]
