# SPDX-License-Identifier: Apache-2.0
"""A scenario run offline in one call, and what it achieved."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import dataclass
import functools
import os
from pathlib import Path
from typing import Any

import numpy as np

from adaptive_blf_control.bags.logs import read_log
from adaptive_blf_control.bags.measured_log import MeasuredLog
from adaptive_blf_control.calls import argument_names, checked_call
from adaptive_blf_control.compiled import COMPILED
from adaptive_blf_control.configuration.build_closed_loop import OwnParts
from adaptive_blf_control.control.controller import Controller
from adaptive_blf_control.control.laws.protocol import Law
from adaptive_blf_control.control.reference import Reference
from adaptive_blf_control.control.set_constraints import OwnConstraints
from adaptive_blf_control.errors import BagError, ParameterError, UnknownParameter
from adaptive_blf_control.identification.gravity_check import GravityMisfit
from adaptive_blf_control.identification.identifier import Identifier
from adaptive_blf_control.identification.update_laws import UpdateLaw
from adaptive_blf_control.parameters.settings import Settings
from adaptive_blf_control.runs.bag_observer import BagObserver
from adaptive_blf_control.runs.gravity_line import gravity_line, gravity_misfit
from adaptive_blf_control.runs.learned import Learned
from adaptive_blf_control.runs.run_guarantee import guarantee_of_trace, RunGuarantee, why_not
from adaptive_blf_control.runs.saved_arrays import save_arrays
from adaptive_blf_control.runs.scenario import duration_of, Joined, joined, Scenario
from adaptive_blf_control.runs.summary import Run, run_of_trace, summarise, table
from adaptive_blf_control.runs.torque_error import torque_error_of_trace, torque_line
from adaptive_blf_control.simulation.abilities import contacts_of, unexpressed_by
from adaptive_blf_control.simulation.closed_loop import ClosedLoop, Trace
from adaptive_blf_control.simulation.plant import Plant
from adaptive_blf_control.simulation.sample import Sample
from adaptive_blf_control.simulation.schedule import schedule_columns
from adaptive_blf_control.simulation.sensors import Sensor

__all__ = ['Simulation', 'duration_of', 'simulate']

_TABLE = 'pandas.DataFrame(run.q, index=run.t, columns=run.joints), and likewise for the others'
_DRAWN = ("matplotlib draws arrays: plt.plot(run.t, run.e1); simulate(..., bag='run') writes a "
          'bag, of which `python -m adaptive_blf_control report run` makes a page')
_SAMPLE = 'simulate(..., observer=f) calls f with every sample: '
_LYAPUNOV = f'{_SAMPLE}run.controller.lyapunov(sample.output, sample.theta_used)'
_NOT_THERE = {
    'theta': 'theta_hat has it over time, identifier.theta at the end',
    'qdd': 'no acceleration is measured or used; numpy.gradient(run.qd, run.t, axis=0) '
           'approximates it',
    'e2': f'{_SAMPLE}sample.output.e2', 'V': _LYAPUNOV, 'lyapunov': _LYAPUNOV,
    'energy': _LYAPUNOV,
    **dict.fromkeys(('rmse', 'rms', 'rms_error'), "figures['rms_error']"),
    **dict.fromkeys(('converged', 'convergence_time', 'settling_time'),
                    "figures['theta_settling_time_s'], None where it does not converge"),
    **dict.fromkeys(('compare', 'difference', 'diff'),
                    'figures of two runs are dictionaries, their arrays have the same shape'),
    **dict.fromkeys(('report', 'html'), "simulate(..., bag='run') writes a bag, of which "
                    '`python -m adaptive_blf_control report run` makes a page'),
    **dict.fromkeys(('max_error', 'largest_error', 'peak_error'), "figures['max_abs_error']"),
    **dict.fromkeys(('margin', 'margins', 'least_margin', 'minimum_margin', 'min_margin'),
                    "figures['margins'] has the least of each constraint"),
    **dict.fromkeys(('theta_star', 'theta_true', 'true_theta', 'true_parameters', 'ground_truth'),
                    'plant.truth(run.parameters) has it over time, where the plant knows it'),
    **dict.fromkeys(('theta_tilde', 'theta_error', 'parameter_error'),
                    'theta_hat - plant.truth(run.parameters)[0][1]; '
                    "figures['theta_error_norm'] has its norm at the end"),
    **dict.fromkeys(('to_bag', 'save_bag', 'write_bag', 'record'),
                    "simulate(..., bag='run') writes one"),
    **dict.fromkeys(('truth', 'nominal'), 'plant.truth() has the true parameters over time, '
                    'where the plant knows them'),
    **{name: f'controller.settings.{name}' for name in ('k1', 'k2', 'law', 'torque_limit')},
    **{name: f'identifier.settings.{name}' for name in ('kt', 'kh', 'gamma', 'update_law')},
    **dict.fromkeys(('safety', 'performance', 'constraints'), 'controller has them'),
    'load': 'numpy.load(path) reads what save wrote',
    'settings': 'controller.settings and identifier.settings',
    'dt': 'loop.period', 'duration': 't[-1]', 'bag': "simulate(..., bag='run') writes one",
    **dict.fromkeys(('to_dict', 'as_dict', 'arrays'), 'save(path) writes the arrays, figures is a '
                    'dictionary of what was achieved'),
    'history': 'identifier.stack', 'sensor': 'plant.sensor, where the plant has one',
    **dict.fromkeys(('plot', 'show', 'draw', 'animate', 'figure'), _DRAWN),
    **dict.fromkeys(('to_dataframe', 'dataframe', 'df', 'data', 'to_pandas'), _TABLE)}


@dataclass(frozen=True, repr=False, eq=False)
class Simulation(Trace, Learned, instead=_NOT_THERE):
    """A run of the closed loop as arrays over N samples; ``print`` shows what it achieved.

    Attributes:
        t: Times, shape (N,) [s].
        q: True positions, shape (N, n) [rad].
        qd: True velocities, shape (N, n) [rad/s].
        e1: Tracking errors (5), shape (N, n) [rad].
        torque: Commanded torques, each held from its t on, shape (N, n) [N·m].
        measured: What the sensors showed, q, qd and torque, shape (N, n) each; its torque is the
            mean over the interval that ends at t, as a driver publishes it, see ``log``.
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

    @property
    def controller(self) -> Controller:
        """What answered the samples: ``settings``, ``safety``, ``performance``."""
        return self.loop.controller

    @property
    def plant(self) -> Plant:
        """What was driven, in its last state."""
        return self.loop.plant

    @property
    def reference(self) -> np.ndarray:
        """y_d, shape (N, n) [rad]."""
        return self.q - self.e1

    def log(self) -> MeasuredLog:
        """Return what the sensors showed, as a log; `identify`, `learn` and `read_log` do so too.

        The effort of a row is the mean torque over the interval that ends with it, while
        ``torque`` is the command from there on: as effort that would be one sample early.

        Raises:
            LogError: the run has no three samples that are finite.
        """
        return read_log(self)

    @checked_call
    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the arrays with the names of joints and parameters; ``numpy.load`` reads them.

        ``tau`` is the measured mean torque of the interval before, which `read_log` takes;
        ``torque`` the command from there on.

        Args:
            path: A file that ends in ``.npz``; replaced if it exists.

        Raises:
            ParameterError: it ends otherwise or cannot be written.
        """
        return save_arrays(path, {
            'joints': np.array(self.joints), 'parameters': np.array(self.parameters),
            'tau': self.measured.torque, **{name: getattr(self, name) for name in (
                't', 'q', 'qd', 'e1', 'reference', 'torque', 'theta_hat', 'rank', 'sigma_min')}})

    @functools.cached_property
    def _run(self) -> Run:
        return run_of_trace(self.loop, self)

    @functools.cached_property
    def _summary(self) -> dict[str, Any]:
        return summarise(self._run)

    @functools.cached_property
    def _run_guarantee(self) -> RunGuarantee | None:
        return guarantee_of_trace(self.loop, self)

    @functools.cached_property
    def gravity_misfit(self) -> GravityMisfit | None:
        """What the first moments say against gravity as told; None where it fits."""
        return gravity_misfit(self.loop, self)

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
        misfit = self.gravity_misfit
        figures['gravity_misfit'] = None if misfit is None else misfit.text()
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
            *([gravity_line(self.gravity_misfit)] if self.gravity_misfit else []),
            f'speed                {figures["real_time_factor"]:.1f} x real time'
            + (f', sample by sample: {", ".join(self.in_python)}' if self.in_python else '')
            + ('' if COMPILED else ', uncompiled: numba is not installed or switched off')])


@checked_call
def simulate(scenario: Scenario, duration: float | None = None, *,
             plant: Plant | type[Plant] | str | None = None,
             sensor: Sensor | type[Sensor] | str | None = None,
             law: Law | type[Law] | str | None = None,
             update_law: UpdateLaw | type[UpdateLaw] | str | None = None,
             constraints: OwnConstraints = (),
             reference: Reference | Mapping[str, Any] | None = None, schedule: Any = None,
             observer: Callable[[Sample], None] | None = None,
             bag: str | os.PathLike[str] | None = None, **changes: Any) -> Simulation:
    """Run a scenario in lockstep without ROS: the same objects that run in the nodes.

    Args:
        scenario: A parameter file, its data, an arm that is driven with the defaults of every
            parameter, or a `ClosedLoop` joined by hand. Where there is no such file,
            ``'two_link'`` and ``'config/two_link.yaml'`` are the one that is shipped;
            `list_scenarios` returns their names.
        duration: Length of the run [s]; the scenario's, else 20 s, where None.
        plant: What is driven in place of the simulated arm: a plant, a class of plants, which is
            called with the driver's settings and the arm, or a name such as ``'mujoco'``.
        sensor: What the simulated arm is measured with, a class of such, or a name such as
            ``'encoder'``, in place of the scenario's; see `Sensor`.
        law: A control law, or a class of laws, in place of the scenario's; see `Controller`.
        update_law: An update law, or a class of them, likewise; see `Identifier`.
        constraints: What else counts as inside, beside the scenario's: one or several; see
            `Controller`.
        reference: What is to be followed: a `Reference`, or sinusoids by joint, such as
            ``{'joint1': {'amplitude': 0.5, 'frequency': 1.0}}``.
        schedule: What changes of the true arm while it runs, ``(t, parameter, value)`` or a list
            of them: ``[(5.0, 'payload', 2.0), (8.0, 'payload', 0.0)]`` takes up 2 kg at 5 s and
            lays them down at 8 s. A parameter is one of ``arm.parameters``, ``'payload'`` [kg], or
            what ``simulation/targets.py`` lists, such as forces on links. Also by columns, as the
            parameter ``schedule`` has it, or as a text in YAML.
        observer: Called with every sample; where all parts are ours, after each block of samples.
        bag: Folder that the run is written to as a bag, which must not exist.
        changes: Parameters of ``controller``, ``identifier`` and ``arm_driver``, by name or as
            YAML nests them: ``controller={'k2': [30.0, 5.0]}`` and ``**{'controller.k2': 5.0}``;
            without a node's name for every node that knows them. ``payload=2.0`` and
            ``true_parameters=[...]`` make the driven arm another one than the one that is known.

    Returns:
        The run as arrays over N samples, with what was learned. ``print`` shows the figures.

    Raises:
        ParameterError: a parameter cannot be used, or a part lacks what its protocol asks for.
        SetViolation: the start is outside a set, or (9) does not hold.
        ArmError: the arm cannot be built.
        BagError: the bag cannot be written.
    """
    if schedule is not None:
        changes['arm_driver.schedule'] = schedule_columns(schedule)
    objects = _objects(plant, sensor, reference, changes)
    own = OwnParts(law=law, update_law=update_law, constraints=constraints, **objects)
    try:
        ready = joined(scenario, own, changes)
    except UnknownParameter as error:  # may also be meant for an argument
        raise error.beside(argument_names(simulate)) from None
    _check_observer(observer)
    loop, length = ready.loop, duration_of(ready.data, duration)
    loop.warm_up()
    with nullcontext() if bag is None else _bag_of(bag, ready) as writer:
        trace = loop.run(length, _both(observer, writer))
    return Simulation(**vars(trace), loop=loop, notes=ready.notes)


def _objects(plant: Any, sensor: Any, reference: Any, changes: dict[str, Any]) -> dict[str, Any]:
    """Return the parts that are objects or classes; what names or describes one is a change.

    Raises:
        ParameterError: settings are given for the plant.
    """
    if isinstance(plant, (Mapping, Settings)):
        raise ParameterError('plant', plant, "a plant, a class of plants, or a name such as "
                             "'mujoco'; parameters of the simulated arm are given by name, "
                             'payload=2.0, or as arm_driver={...}')
    if isinstance(reference, (Mapping, Settings)):
        changes['reference'], reference = reference, None
    if isinstance(plant, str):
        changes['arm_driver.plant'], plant = plant, None
    if isinstance(sensor, str):
        changes['arm_driver.sensors.model'], sensor = sensor, None
    return {'plant': plant, 'sensor': sensor, 'reference': reference}


def _bag_of(bag: Any, ready: Joined) -> BagObserver:
    try:
        path = Path(bag)
    except TypeError:
        raise BagError(f'bag is {bag!r}: expected a path') from None
    return BagObserver(path, ready.loop, ready.data, built=ready.built)


def _check_observer(observer: Any) -> None:
    if observer is not None and not callable(observer):
        raise ParameterError('observer', observer, 'a function of a Sample')


def _both(first: Callable[[Sample], None] | None,
          second: Callable[[Sample], None] | None) -> Callable[[Sample], None] | None:
    """Return an observer that calls those of two that are not None."""
    if first is None or second is None:
        return first or second

    def observe(sample: Sample) -> None:
        first(sample)
        second(sample)

    return observe
