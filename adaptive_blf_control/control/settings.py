# SPDX-License-Identifier: Apache-2.0
"""The parameters of the control law, its sets and its reference."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from adaptive_blf_control.control.limit_settings import LimitSettings
from adaptive_blf_control.control.loop_settings import LoopSettings
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.parameters.declaration import group, group_per_joint, parameter
from adaptive_blf_control.parameters.plugin import is_plugin
from adaptive_blf_control.parameters.settings import listed, Settings

__all__ = ['COUPLINGS', 'INTERIOR', 'LAWS', 'SAFETY_FILTERS', 'ControllerSettings',
           'PerformanceSettings', 'ReferenceSettings', 'SafetySettings', 'SinusoidSettings',
           'SlotineLiSettings']

# Part of the bound up to which the barrier is evaluated: w = b² − e1² ≥ 2e-3 b², so that the
# coupling torque c b² e1 / w² stays below 2.5e5 c / b.
INTERIOR = 0.999
COUPLINGS = ('per_joint', 'pseudoinverse')
_ROOM = 'adaptive_blf_control.control.laws'
LAWS: Mapping[str, str] = MappingProxyType({
    'ablf': f'{_ROOM}.ablf:AblfLaw', 'pd': f'{_ROOM}.fixed:ProportionalDerivative',
    'computed_torque': f'{_ROOM}.fixed:ComputedTorque',
    'slotine_li': f'{_ROOM}.slotine_li:SlotineLi'})
"""Our laws by name, each with where its class is."""
SAFETY_FILTERS: Mapping[str, str] = MappingProxyType({
    'limits': 'adaptive_blf_control.limits.safety_filter:LimitsFilter'})
"""Our safety filters by name, likewise."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SafetySettings(Settings, where='controller.safety'):
    """The safety set (7)."""

    lower: np.ndarray = parameter(
        [-3.14], 'Lower end of the safety set, k_c (7).', 'rad', length='joints', live=True)
    upper: np.ndarray = parameter(
        [3.14], 'Upper end of the safety set, k_d (7).', 'rad', length='joints', live=True)

    def _check(self) -> None:
        _check_below(self._where, self.lower, self.upper)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PerformanceSettings(Settings, where='controller.performance'):
    """The performance set (8)."""

    lower: np.ndarray = parameter(
        [-0.15],
        'Lower end of the performance set, -k_a (8). Equal and opposite to the upper end it '
        'gives the symmetric barrier (SBLF) for that joint.', 'rad', length='joints', live=True)
    upper: np.ndarray = parameter(
        [0.15], 'Upper end of the performance set, k_b (8).', 'rad', length='joints', live=True)

    def _check(self) -> None:
        for end, values, expected in (('lower', self.lower, self.lower < 0.0),
                                      ('upper', self.upper, self.upper > 0.0)):
            if not expected.all():
                raise ParameterError(f'{self._where}.{end}', values.tolist(),
                                     'lower < 0 < upper for every joint [rad]')


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SinusoidSettings(Settings, where='controller.reference'):
    """Sum of sinusoids that one joint follows."""

    offset: float = parameter(
        0.0, 'Centre of the sinusoids.', 'rad', live=True)
    amplitude: np.ndarray = parameter(
        [0.0], 'Amplitudes of the sinusoids.', 'rad', live=True)
    frequency: np.ndarray = parameter(
        [1.0], 'Angular frequencies of the sinusoids.', 'rad/s', live=True)
    phase: np.ndarray = parameter(
        [0.0], 'Phases of the sinusoids.', 'rad', live=True)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ReferenceSettings(Settings, where='controller.reference'):
    """The reference y_d and how a motion joins it."""

    of_joint: Mapping[str, SinusoidSettings] = group_per_joint(SinusoidSettings)
    velocity_limit: float = parameter(
        20.0,
        'Largest velocity that the reference of a joint may ask for; one beyond it is refused.',
        'rad/s', 0.0, exclusive=True, live=True)
    acceleration_limit: float = parameter(
        500.0, 'Largest acceleration that it may ask for, likewise.',
        'rad/s^2', 0.0, exclusive=True, live=True)
    smooth_start: float = parameter(
        2.0,
        'Time over which the measured posture is joined to the reference and the performance '
        'set grows to its width; 0 starts on the reference.', 's', 0.0, live=True)
    resume_time: float = parameter(
        2.0,
        'Time over which the measured posture is joined to the reference when a new motion '
        'begins after joint states were lost or the clock jumped ahead.',
        's', 0.0, exclusive=True, live=True)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SlotineLiSettings(Settings, where='controller.slotine_li'):
    """The law of Slotine and Li, which adapts by itself."""

    gamma: np.ndarray = parameter(
        [200.0], 'Diagonal of Gamma of the law slotine_li.', '', 0.0, exclusive=True,
        length='parameters', live=True)


def _check_below(where: str, lower: np.ndarray, upper: np.ndarray) -> None:
    fits = lower.size == upper.size or 1 in (lower.size, upper.size)  # else `resolved` refuses
    if fits and not (lower < upper).all():
        raise ParameterError(f'{where}.lower', lower.tolist(),
                             f'values below {where}.upper = {upper.tolist()} rad')


@listed
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ControllerSettings(Settings, where='controller'):
    """Gains and limits of the law (38), the sets and the reference."""

    law: str = parameter(
        'ablf',
        'ablf: the law (38); pd, computed_torque, slotine_li: for comparison, without an '
        'adaptation term; module:name: called with the arm and these settings, it returns a law.',
        choices=tuple(LAWS), plugin=True)
    constraints: tuple[str, ...] = parameter(
        [''], 'What else counts as inside, each module:name: called with the arm and these '
        'settings, it returns a constraint that is watched beside the two sets.')
    k1: np.ndarray = parameter(
        [40.0], 'Gains of the stabilising function (27).',
        '1/(s*rad^4)', 0.0, exclusive=True, length='joints', live=True)
    k2: np.ndarray = parameter(
        [30.0], 'Gains on e2 in (38).',
        'N*m*s/rad', 0.0, exclusive=True, length='joints', live=True)
    barrier_weight: np.ndarray = parameter(
        [1.0], 'Weight of the barrier (23) against the kinetic energy in V (30): its stiffness at '
        'e1 = 0 is barrier_weight / bound^2. 1 J in the paper.',
        'J', 0.0, exclusive=True, length='joints', live=True)
    coupling: str = parameter(
        'per_joint',
        'How the barrier acts on the torque: per_joint (smooth) or the pseudoinverse of the '
        'paper.', choices=COUPLINGS, live=True)
    coupling_reach: float = parameter(
        INTERIOR, 'Part of a performance bound up to which that torque grows. Below 1 a joint '
        'that a contact held near its bound comes to rest again in a loop with delay; Theorem 2 '
        'then holds for errors below it.', '', 0.0, INTERIOR, exclusive=True, live=True)
    torque_limit: np.ndarray = parameter(
        [100.0], 'Largest commanded torque.',
        'N*m', 0.0, exclusive=True, length='joints', live=True)
    torque_rate_limit: np.ndarray = parameter(
        [10000.0], 'Largest change of the commanded torque.',
        'N*m/s', 0.0, exclusive=True, length='joints', live=True)
    safety_filter: str = parameter(
        'none', 'What the torque passes behind the law. none: nothing; limits: what keeps the '
        'limits of controller.limits; module:name: called with the arm and these settings, it '
        'returns a safety filter.', choices=('none', *SAFETY_FILTERS), plugin=True)
    limits: LimitSettings = group(LimitSettings)
    slotine_li: SlotineLiSettings = group(SlotineLiSettings)
    safety: SafetySettings = group(SafetySettings)
    performance: PerformanceSettings = group(PerformanceSettings)
    reference: ReferenceSettings = group(ReferenceSettings)
    loop: LoopSettings = group(LoopSettings)

    def _check(self) -> None:
        super()._check()
        for text in filter(None, self.constraints):
            if not is_plugin(text):
                raise ParameterError('controller.constraints', list(self.constraints),
                                     f'module:name each, not {text!r}')
