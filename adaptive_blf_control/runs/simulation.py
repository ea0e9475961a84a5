# SPDX-License-Identifier: Apache-2.0
"""A scenario run offline in one call, and what it achieved."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
import functools
import os
from pathlib import Path
from typing import Any

from adaptive_blf_control.arms.arm import Arm, checked_arm, SIMULATED
from adaptive_blf_control.arrays import checked_finite
from adaptive_blf_control.compiled import COMPILED
from adaptive_blf_control.configuration.build import build_closed_loop, OwnParts
from adaptive_blf_control.configuration.node_settings import DriverSettings
from adaptive_blf_control.configuration.parameter_file import (
    apply_changes,
    checked_sections,
    load_yaml,
    node_settings,
)
from adaptive_blf_control.control.laws.protocol import Law
from adaptive_blf_control.control.set_constraints import OwnConstraints
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.identifier import Identifier
from adaptive_blf_control.identification.update_laws import UpdateLaw
from adaptive_blf_control.parameters.guided import Guided
from adaptive_blf_control.parameters.plugin import require
from adaptive_blf_control.runs.run_guarantee import guarantee_of_trace, RunGuarantee, why_not
from adaptive_blf_control.runs.start_check import start_warnings
from adaptive_blf_control.runs.summary import Run, run_of_trace, summarise, table
from adaptive_blf_control.runs.torque_error import torque_error_of_trace, torque_line
from adaptive_blf_control.simulation.abilities import contacts_of, unexpressed_by
from adaptive_blf_control.simulation.closed_loop import ClosedLoop, Trace
from adaptive_blf_control.simulation.plant import Plant
from adaptive_blf_control.simulation.sample import Sample
from adaptive_blf_control.simulation.sensors import Sensor

__all__ = ['Simulation', 'duration_of', 'simulate']

USUAL_DURATION = 20.0  # s, where neither the caller nor the scenario says


@dataclass(frozen=True, repr=False)
class Simulation(Trace, Guided, instead={
        'theta': 'theta_hat has it over time, identifier.theta at the end',
        'estimate': 'identifier.estimate has it by name'}):
    """A run of the closed loop as arrays over N samples; ``print`` shows what it achieved.

    Attributes:
        t: Times, shape (N,) [s].
        q: True positions, shape (N, n) [rad].
        qd: True velocities, shape (N, n) [rad/s].
        e1: Tracking errors (5), shape (N, n) [rad].
        torque: Commanded torques, shape (N, n) [N·m].
        theta_hat: Estimates, shape (N, m).
        rank: Rank of the history, shape (N,).
        sigma_min: Its σ_min, shape (N,).
        wall_s: How long it took [s].
        in_python: Parts that had to be asked sample by sample, which is slower.
        failure: The first state or torque that is not finite, or None.
        loop: The objects that ran.
        notes: What is to be said about the scenario, in sentences.
    """

    loop: ClosedLoop
    notes: tuple[str, ...] = ()

    @property
    def identifier(self) -> Identifier:
        """What learned along: ``estimate``, ``rank``, ``undetermined``, ``predict``."""
        return self.loop.identifier

    @functools.cached_property
    def _run(self) -> Run:
        return run_of_trace(self.loop, self)

    @functools.cached_property
    def _summary(self) -> dict[str, Any]:
        return summarise(self._run)

    @functools.cached_property
    def _run_guarantee(self) -> RunGuarantee | None:
        return guarantee_of_trace(self.loop, self)

    @property
    def kept(self) -> bool:
        """Whether every constraint was strictly kept at every sample."""
        return bool(self._summary['set_violations'] == 0)

    @functools.cached_property
    def figures(self) -> dict[str, Any]:
        """Return what the run achieved, as plain values for JSON; see `summarise`."""
        figures, guarantee = dict(self._summary), self._run_guarantee
        figures['guarantee'] = None if guarantee is None else guarantee.figures()
        figures['predicted_torque_error'] = torque_error_of_trace(self.loop, self)
        unexpressed = unexpressed_by(self.loop.plant, self.loop.arm.parameters)
        figures['unexpressed_torque'] = None if unexpressed is None else unexpressed.tolist()
        figures['contacts_s'] = contacts_of(self.loop.plant)
        figures['contradictions'] = getattr(self.identifier, 'found', {})
        figures['wall_s'] = self.wall_s
        figures['real_time_factor'] = float(self.t[-1] / self.wall_s)
        return figures

    def __repr__(self) -> str:
        """Say what the run achieved, as a table."""
        figures, guarantee = self.figures, self._run_guarantee
        lines = [*(f'note: {text}' for text in self.notes), table(figures, self._run)]
        if any(value is not None for value in figures['predicted_torque_error']):
            lines.append(torque_line(figures['predicted_torque_error']))
        if figures['unexpressed_torque'] is not None:
            lines.append('beyond any theta     ' + ', '.join(
                f'{100.0 * part:.2g} %' for part in figures['unexpressed_torque'])
                + ' of the torque of random motions')
        found = ', '.join(f'{count} {reason}' for reason, count
                          in figures['contradictions'].items() if count)
        return '\n'.join([
            *lines,
            guarantee.line() if guarantee is not None else
            f'Theorem 2            {why_not(self.loop)}',
            *(f'contact              from {begin:.3f} s to {end:.3f} s'
              for begin, end in figures['contacts_s']),
            *([f'history contradicted {found}'] if found else []),
            f'speed                {figures["real_time_factor"]:.1f} x real time'
            + (f', sample by sample: {", ".join(self.in_python)}' if self.in_python else '')
            + ('' if COMPILED else ', uncompiled: numba is not installed or switched off')])


def duration_of(data: Mapping[str, Any], duration: float | None) -> float:
    """Return how long a run lasts [s]: as given, else as the scenario says, else 20 s."""
    if duration is None:
        return node_settings(data, DriverSettings).duration or USUAL_DURATION
    return checked_finite('duration', duration, 'a time > 0 s', above=0.0)


def simulate(scenario: str | os.PathLike[str] | Mapping[str, Any] | Arm | ClosedLoop,
             duration: float | None = None, *, plant: Plant | type[Plant] | None = None,
             sensor: Sensor | type[Sensor] | None = None,
             law: Law | type[Law] | str | None = None,
             update_law: UpdateLaw | type[UpdateLaw] | str | None = None,
             constraints: OwnConstraints = (),
             observer: Callable[[Sample], None] | None = None, **changes: Any) -> Simulation:
    """Run a scenario in lockstep without ROS: the same objects that run in the nodes.

    Args:
        scenario: A parameter file, e.g. ``config/two_link.yaml``, its data, an arm that is driven
            with the defaults of every parameter, or a `ClosedLoop` joined by hand.
        duration: Length of the run [s]; the scenario's, else 20 s, where None.
        plant: What is driven in place of the simulated arm: a plant, or a class of plants, which
            is called with the driver's settings and the arm.
        sensor: What the simulated arm is measured with, or a class of such, in place of the
            scenario's; see `Sensor`.
        law: A control law, or a class of laws, in place of the scenario's; see `Controller`.
        update_law: An update law, or a class of them, likewise; see `Identifier`.
        constraints: What else counts as inside, beside the scenario's: one or several; see
            `Controller`.
        observer: Called with every sample; where all parts are ours, after each block of samples.
        changes: Parameters of ``controller``, ``identifier`` and ``arm_driver``, by name or as
            YAML nests them: ``controller={'k2': [30.0, 5.0]}`` and ``**{'controller.k2': 5.0}``;
            without a node's name for every node that knows them.

    Returns:
        The run as arrays over N samples, with what was learned. ``print`` shows the figures.

    Raises:
        ParameterError: a parameter is not known or cannot be used, or a part lacks what its
            protocol asks for.
        SetViolation: the start is outside a set, or the performance set exceeds the
            safety set (9).
        ArmError: the arm cannot be built.
    """
    if isinstance(scenario, ClosedLoop):
        for name, value in (
                ('plant', plant), ('sensor', sensor), ('law', law), ('update_law', update_law),
                ('constraints', constraints or None), *changes.items()):
            if value is not None:
                raise ParameterError(name, value, 'nothing: the loop has been joined by hand')
        loop, length = scenario, duration_of({}, duration)
        notes: tuple[str, ...] = ()
    else:
        data, arm = _scenario(scenario)
        if arm is not None and plant is None:
            require('scenario', arm, arm, SIMULATED)
        data = apply_changes(data, changes)
        loop = build_closed_loop(data, OwnParts(arm, plant, sensor, law, update_law, constraints))
        length = duration_of(data, duration)
        notes = tuple(start_warnings(data, loop))  # may refuse an unstable loop
    loop.warm_up()
    return Simulation(**vars(loop.run(length, observer)), loop=loop, notes=notes)


def _scenario(scenario: Any) -> tuple[dict[str, Any], Arm | None]:
    """Return a parameter file's data, and the arm where it is given as an object."""
    if isinstance(scenario, (str, os.PathLike)):
        return load_yaml(Path(scenario), 'scenario'), None
    if isinstance(scenario, Mapping):
        return checked_sections(scenario, 'scenario', scenario), None
    arm = checked_arm('scenario', scenario)
    return {'/**': {'ros__parameters': {'joints': list(arm.joints)}}}, arm
