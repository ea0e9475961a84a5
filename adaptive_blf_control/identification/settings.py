# SPDX-License-Identifier: Apache-2.0
"""The parameters of the identifier: filters, history, monitors and update law."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.parameters.declaration import group, parameter
from adaptive_blf_control.parameters.plugin import NamesIn
from adaptive_blf_control.parameters.settings import listed, Settings
from adaptive_blf_control.parameters.table import NOMINAL

__all__ = ['ChangeSettings', 'ExcitationSettings', 'FilterSettings', 'HistorySettings',
           'IdentifierSettings', 'PayloadSettings']


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class FilterSettings(Settings, where='identifier.filter'):
    """The torque filter (14) and the filter of the state before it."""

    time_constant: float = parameter(
        0.001, 'Time constant k of the torque filter.', 's', 0.0, 100.0, exclusive=True, live=True)
    gap: float = parameter(
        0.05, 'After a longer interval between samples the filter restarts.',
        's', 0.0, 3600.0, exclusive=True, live=True)
    settle: float = parameter(
        5.0, 'Filter time constants after a (re)start during which nothing is recorded.',
        '', 0.0, 1000.0, live=True)
    effort: str = parameter(
        'mean',
        'What is measured as torque: mean: over the interval that ends at the sample; instant: '
        'at the sample, as most drivers publish it.', choices=('mean', 'instant'), live=True)
    state_filter: str = parameter(
        'low_pass',
        'What filters the measured state: low_pass: the cascade of state_order; module:name: '
        'called with the arm and these settings, it returns a state filter.',
        choices=NamesIn('identification.state_filter', 'STATE_FILTERS'), plugin=True)
    state_order: int = parameter(
        0,
        'Order N of the low-pass on position and torque that also gives the velocity, for '
        'coarse encoders; 0 uses the measured velocity. Changing it restarts the filters.',
        '', 0, 8, live=True)
    state_time_constant: float = parameter(
        0.03, 'Time constant T of each of its N stages. Changing it restarts the filters.',
        's', 0.0, 100.0, exclusive=True, live=True)
    distortion: float = parameter(
        0.0,
        'Largest part of the torque that the low-pass may distort, N T^2 qd^2 / 2 for the fastest '
        'joint: from a faster motion nothing is recorded. 0: whatever the speed is.',
        '', 0.0, 1e6, live=True)

    def _check(self) -> None:
        if self.state_order == 1:
            raise ParameterError('identifier.filter.state_order', 1, '0 (off) or at least 2')


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class HistorySettings(Settings, where='identifier.history'):
    """The history stack of Algorithm 1."""

    selection: str = parameter(
        'algorithm_1',
        'Which pairs are recorded: algorithm_1: those that make sigma_min largest; module:name: '
        'called with the arm and these settings, it returns a history.',
        choices=NamesIn('identification.history', 'SELECTIONS'), plugin=True)
    size: int = parameter(
        20,
        'Number of recorded pairs, P. When it is reduced, every sample removes one pair until '
        'the best P are left.', '', 1, 100000, live=True)
    epsilon: float = parameter(
        0.1,
        'Smallest relative difference epsilon of a new pair to the last one taken; that of the '
        'first pair is 1.', '', 0.0, 1.0, live=True)
    minimum_growth: float = parameter(
        0.0,
        'Part of sigma_min by which a replacement in a full history must raise it; 0 requires '
        'only that it does not fall, as Algorithm 1 does. With sensor noise a positive value '
        'keeps the history from collecting outliers.', '', 0.0, 1e6, live=True)
    noise: float = parameter(
        0.0,
        'Remark 3: standard deviation of the artificial noise added to recorded regressors, '
        'relative to them, while the measured pairs lack rank. theta_hat is biased while such '
        'pairs are used. 0 is off.', '', 0.0, 100.0, live=True)
    noise_seed: int = parameter(
        0, 'Seed of the artificial noise.', '', 0, live=True)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ChangeSettings(Settings, where='identifier.change'):
    """The monitor that finds a change of the arm."""

    monitor: str = parameter(
        'residual',
        'How a change is found: residual: the present pair contradicts the recorded ones; '
        'module:name: called with the arm and these settings, it returns a change monitor.',
        choices=NamesIn('identification.change_monitor', 'MONITORS'), plugin=True)
    window: float = parameter(
        0.1, 'Window of the monitor that empties the history when the arm has changed; 0 is off.',
        's', 0.0, 3600.0, live=True)
    threshold: float = parameter(
        25.0, 'Mean square residual, in units of the recorded one, that counts as a change; what '
        'each joint has beyond 1 adds up.',
        '', 1.0, 1e9, exclusive=True, live=True)
    resolution: float = parameter(
        0.01, 'Part of the torque below which a change does not matter.', '', 0.0, 1.0, live=True)
    suspicion: float = parameter(
        0.0,
        'Mean square residual, likewise, from which on nothing is recorded; past the threshold '
        'theta_hat stays until the reason is known: a contact, a load at the tip, or another arm. '
        '0: the history is emptied at the threshold, whatever the reason.', '', 0.0, 1e9,
        live=True)
    settle: float = parameter(
        5.0, 'Filter time constants after a change during which nothing is recorded.',
        '', 0.0, 1000.0, live=True)
    patience: float = parameter(
        5.0, 'Longest time to wait for the reason; then the history is emptied.',
        's', 0.0, 3600.0, exclusive=True, live=True)

    adapt: bool = parameter(
        False,
        'While the reason is not known X^T e2 goes on to move theta_hat: it holds a load that was '
        'put on or taken off, and pushes ever harder against a contact.', live=True)

    def _check(self) -> None:
        if self.suspicion > self.threshold:
            raise ParameterError('identifier.change.suspicion', self.suspicion,
                                 f'at most identifier.change.threshold = {self.threshold:g}')


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ExcitationSettings(Settings, where='identifier.excitation'):
    """The index of persistent excitation (21)."""

    window: float = parameter(
        10.0, 'Window T of the persistence-of-excitation index (21); 0 switches it off.',
        's', 0.0, 3600.0, live=True)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PayloadSettings(Settings, where='identifier.payload'):
    """The load that is found beside a model of the arm without it."""

    frame: str = parameter(
        '', 'Link of the URDF that carries the load, in whose frame it is described; empty: no '
        'load is looked for.')
    baseline: str = parameter(
        NOMINAL, 'The arm without the load: nominal, or a YAML file that identify or the '
        'identifier has written.')
    least_mass: float = parameter(
        0.1, 'A load below this mass is none.', 'kg', 0.0, 1e6)
    period: float = parameter(
        0.25, 'The load is judged and published this often.', 's', 0.02, 60.0)


REAL_ROBOT: dict[str, Any] = {
    'update_law': 'concurrent',
    'kt': 1.0,
    'kh': 1000.0,
    'filter': {'time_constant': 0.1, 'settle': 5.0},
    'history': {'size': 1000, 'epsilon': 0.05},
    'change': {'window': 0.0},
    'excitation': {'window': 0.0},
}
"""Settings for the log of a real robot; ``docs/benchmarks.md`` tells why."""


@listed
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class IdentifierSettings(Settings, where='identifier'):
    """Gains of the update law (37), the filters, the history and the monitors.

    The defaults are for a simulation in which the controller adapts; ``real_robot()`` returns
    those for the log of a real robot, which `identify` takes.
    """

    initial_estimate: np.ndarray | str = parameter(
        [0.0], 'theta_hat at the start: values, those of the nominal arm, or those that an '
        'identifier has written.', length='parameters', source=True)
    gamma: np.ndarray = parameter(
        [1.0], 'Diagonal of the adaptation gain Gamma.',
        '', 0.0, exclusive=True, length='parameters', live=True)
    kt: float = parameter(
        10.0, 'Gain on the present data, k_t.', '', 0.0, live=True)
    kh: float = parameter(
        10.0, 'Gain on the recorded data, k_h.', '', 0.0, live=True)
    update_law: str = parameter(
        'ablf_concurrent',
        'gradient (20): present data only; concurrent (22): recorded data as well; '
        'ablf_concurrent (37): the stabilising term X^T e2 as well; module:name: called with '
        'these settings, it returns an update law.',
        choices=NamesIn('identification.update_laws', 'UPDATE_LAWS'), live=True,
        plugin=True)
    known_contact: bool = parameter(
        False, 'Something is known to touch the arm: theta_hat stays, and nothing is recorded.',
        live=True)
    position_limit_margin: float = parameter(
        0.01, 'A joint that is nearer to a position limit of the URDF, or beyond it, may rest on '
        'its mechanical stop: until the filters have forgotten that (change.settle) nothing is '
        'learned from its torque, and X^T e2 does not move theta_hat. A negative value counts '
        'only what is that far beyond.',
        'rad', -10.0, 10.0, live=True)
    filter: FilterSettings = group(FilterSettings)
    history: HistorySettings = group(HistorySettings)
    change: ChangeSettings = group(ChangeSettings)
    excitation: ExcitationSettings = group(ExcitationSettings)

    @classmethod
    def real_robot(cls, **changes: Any) -> IdentifierSettings:
        """Return the settings for the log of a real robot: those of `identify`.

        The friction of a real robot belongs to its arm: ``load_arm(urdf, joints, viscous=True,
        coulomb=True, offset=True, square_root=True, rotor_inertia=True)``.

        Args:
            changes: Other values by name: ``kh=100.0, history={'size': 200}``.

        Raises:
            ParameterError: a name is not known, or a value cannot be used.
        """
        return cls().replace(**REAL_ROBOT).replace(**changes)
