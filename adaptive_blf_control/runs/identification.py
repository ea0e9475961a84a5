# SPDX-License-Identifier: Apache-2.0
"""The model of a measured robot from its log, in one call."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import os
from pathlib import Path
import time
from typing import Any

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.arms.urdf_export import export_urdf, ExportedUrdf
from adaptive_blf_control.arms.urdf_source import UrdfSource
from adaptive_blf_control.bags.logs import Log
from adaptive_blf_control.calls import argument_names, checked_call
from adaptive_blf_control.configuration.build_identifier import build_identifier
from adaptive_blf_control.errors import ArmError, LogError, ParameterError
from adaptive_blf_control.identification.consistent_model import (
    consistent_model,
    ConsistentModel,
    has_links,
    InertialArm,
)
from adaptive_blf_control.identification.estimate_file import write_estimate
from adaptive_blf_control.identification.finding import Finding, listed
from adaptive_blf_control.identification.identifier import Identifier
from adaptive_blf_control.identification.log_checks import checks_of
from adaptive_blf_control.identification.settings import IdentifierSettings
from adaptive_blf_control.identification.uncertainty import Uncertainty
from adaptive_blf_control.runs.learned import Learned
from adaptive_blf_control.runs.log_notes import notes_on
from adaptive_blf_control.runs.log_options import LogOptions, name_of, several
from adaptive_blf_control.runs.log_pass import (
    Given,
    Growth,
    learn,
    LogPass,
    NO_TEST,
    Prediction,
    Progress,
    Section,
)
from adaptive_blf_control.runs.log_reader import LogReader
from adaptive_blf_control.runs.log_report import figures_of, table
from adaptive_blf_control.runs.model_report import model_figures
from adaptive_blf_control.runs.subject import subject_of

__all__ = ['Identification', 'identify']

_DRAWN = ('matplotlib draws arrays: plt.plot(result.prediction.t, result.prediction.measured); '
          '`python -m adaptive_blf_control identify LOG --html page.html` draws all of it')
_NOT_THERE = {
    **dict.fromkeys(('score', 'rms', 'evaluate', 'test_on', 'validate', 'validation'),
                    'test_rmse is the error on the test span; identify(log, ..., validate=other) '
                    'predicts another log'),
    **dict.fromkeys(('to_frame', 'to_dataframe', 'dataframe', 'df', 'to_pandas'),
                    'pandas.Series(result.estimate) has the parameters, figures the rest'),
    'load': 'Identifier(arm, initial_estimate=path) starts from what save(path) wrote',
    **dict.fromkeys(('weakly', 'determined_weakly', 'weak'),
                    "figures['confidence'] says of each parameter whether it is determined, "
                    'weakly or not'),
    'theta_hat': 'theta is the estimate, estimate has it by name',
    'covariance': 'uncertainty.covariance',
    **dict.fromkeys(('condition', 'condition_number', 'cond'), "figures['condition']"),
    'residuals': 'prediction.measured - prediction.predicted, of the test span',
    'confidence': "figures['confidence'] says of each parameter how well it is determined",
    'intervals': 'theta ± 1.96 std is the 95 % interval of a parameter, prediction.half_width '
                 'half of that of a torque',
    **dict.fromkeys(('confidence_interval', 'confidence_intervals', 'ci', 'conf_int', 'interval'),
                    'theta ± 1.96 std is the 95 % interval of a parameter'),
    **dict.fromkeys(('identifiable', 'determined', 'identified'),
                    'undetermined names the others'),
    **dict.fromkeys(('compare', 'difference'),
                    'theta - arm.nominal has the differences, in the order of parameters'),
    **dict.fromkeys(('report', 'html'),
                    'print shows the figures; `python -m adaptive_blf_control identify LOG '
                    '--html page.html` makes a page'),
    'model': 'consistent is the physically consistent model, urdf() a URDF with its values',
    'history': 'identifier.stack has the recorded pairs',
    'log': 'read_log(...) returns it as arrays; source says where it came from',
    'summary': 'figures has it as a dictionary, print shows it as a table',
    **dict.fromkeys(('t', 'q', 'qd', 'tau', 'torque', 'measured', 'predicted'),
                    'prediction has t, measured, predicted, q and qd of the test span'),
    **dict.fromkeys(('plot', 'show', 'draw', 'figure'), _DRAWN)}


@dataclass(frozen=True, repr=False, eq=False)
class Identification(Learned, instead=_NOT_THERE):
    """What one pass over a log has taught; ``print`` shows the figures as a table.

    Attributes:
        identifier: The identifier after the pass.
        figures: Per joint the RMSE of the filtered torque [N·m] and what else `figures_of` gives.
        prediction: Measured and predicted torque of the test span with the half width of the
            95 % interval: t, measured, predicted, half_width, q, qd.
        uncertainty: Standard deviations and intervals; None where no pair was recorded.
        source: Where the log came from.
        problem: Why the log ends early (a truncated bag), or None.
        findings: What is odd about the log; see `check_log`.
        notes: What was assumed of it, and what to heed in θ̂, in sentences.
        possible: The consistent model; None where there is none, see ``consistent``.
        growth: How the history grew while it was learned from.
    """

    identifier: Identifier
    figures: dict[str, Any]
    prediction: Prediction
    uncertainty: Uncertainty | None
    source: str
    problem: str | None
    findings: tuple[Finding, ...] = ()
    notes: tuple[str, ...] = ()
    possible: ConsistentModel | None = None
    growth: Growth | None = None

    @property
    def settings(self) -> IdentifierSettings:
        """Those that it was learned with."""
        return self.identifier.settings

    @property
    def theta(self) -> np.ndarray:
        """θ̂, shape (m,)."""
        return self.identifier.theta

    @property
    def rank(self) -> int:
        """Rank of the history."""
        return self.identifier.rank

    @property
    def std(self) -> np.ndarray:
        """Standard deviation of θ̂, infinite where the log says nothing, shape (m,)."""
        return (np.full(self.arm.m, np.inf) if self.uncertainty is None
                else self.uncertainty.std)

    @property
    def consistent(self) -> ConsistentModel:
        """The physically consistent model of the recorded pairs: a robot that can exist.

        Raises:
            ArmError: the arm is not from a URDF, or no pair was recorded.
        """
        if self.possible is None:
            reason = ('no pair was recorded' if has_links(self.arm) else
                      f'{type(self.arm).__name__} has no inertial parameters per link')
            raise ArmError(f'there is no consistent model: {reason}')
        return self.possible

    @checked_call
    def urdf(self, path: str | os.PathLike[str] | None = None) -> ExportedUrdf:
        """Return the URDF with the values of the consistent model; its ``xml`` is the text.

        It does not predict the same torques where ``missing`` is not empty: a URDF has no place
        for the inertia of rotors, constant torques and square-root friction; `consistent` has
        them.

        Args:
            path: A file that ends in ``.urdf`` or ``.xml``, which the text is written to as well;
                replaced if it exists.

        Raises:
            ArmError: the arm is not from a URDF, or no pair was recorded.
            ParameterError: the path ends otherwise or cannot be written.
        """
        model = self.consistent
        exported = export_urdf(self.arm, model.theta, model.inertial,  # type: ignore[arg-type]
                               model.rotor)
        if path is not None:
            target = Path(path) if isinstance(path, (str, os.PathLike)) else Path()
            if target.suffix.lower() not in ('.urdf', '.xml'):
                raise ParameterError('path', path, "a file that ends in .urdf, such as "
                                     "'identified.urdf'")
            try:
                target.write_text(exported.xml, encoding='utf-8')
            except OSError as error:
                raise ParameterError('path', str(target),
                                     f'a file that can be written ({error.strerror})') from None
        return exported

    @property
    def sigma_min(self) -> float:
        """Smallest singular value of the history."""
        return self.identifier.stack.sigma_min

    @property
    def train_rmse(self) -> np.ndarray:
        """RMSE of the filtered torque on the training span per joint, shape (n,) [N·m]."""
        return np.array(self.figures['train_rmse'], dtype=float)

    @property
    def test_rmse(self) -> np.ndarray:
        """RMSE of the filtered torque on the test span per joint, (n,) [N·m]; NaN without one."""
        return np.array(self.figures['test_rmse'], dtype=float)

    @checked_call
    def predict(self, q: Any, qd: Any, qdd: Any) -> np.ndarray:
        """Return the torque of a motion under θ̂; see `Identifier.predict`."""
        return self.identifier.predict(q, qd, qdd)

    @checked_call
    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write θ̂ by name with its standard deviations, as YAML.

        It is read by ``initial_estimate=path`` of an `Identifier`, of the nodes and of `simulate`.

        Args:
            path: A file that ends in ``.yaml``; replaced if it exists and holds an estimate.

        Raises:
            ParameterError: it ends otherwise or cannot be written.
        """
        target = Path(path) if isinstance(path, (str, os.PathLike)) else Path()
        if target.suffix.lower() not in ('.yaml', '.yml'):
            raise ParameterError('path', path, "a file that ends in .yaml, such as 'theta.yaml'")
        try:
            write_estimate(target, self.identifier.snapshot(), std=self.std)
        except OSError as error:
            raise ParameterError('path', str(target),
                                 f'a file that can be written ({error.strerror})') from None
        return target

    def __repr__(self) -> str:
        """Show what is to be heeded, and the figures as a table."""
        whole = [finding for finding in self.findings if finding.joint is None]
        return '\n'.join([*(f'note: {text}' for text in (*whole, *self.notes)),
                          table(self.figures, self.source)])


@checked_call
def identify(log: Log, urdf: UrdfSource | None = None, joints: Sequence[str] | None = None, *,
             arm: Arm | str | None = None, train: Given = None, test: Given = None,
             topic: str | None = None, validate: Any = None,
             columns: Mapping[str, str] | None = None, degrees: bool | None = None,
             gain: Mapping[str, float] | None = None, effort_delay: float | None = None,
             force: bool | None = None, options: LogOptions | None = None,
             settings: IdentifierSettings | None = None, progress: Progress | None = None,
             **changes: Any) -> Identification:
    """Learn the parameters of a measured robot from its log, in one pass.

    The log is streamed through the identifier of the node: no look-ahead, one sample after the
    other. Before and after the training span θ̂ is frozen and the samples are only filtered.
    Before that the log is checked (see `check_log`): it is refused where it cannot be right.

    Args:
        log: A bag, a CSV file, arrays by name ``{'t': t, 'q': q, 'qd': qd, 'tau': tau}``, a data
            frame (see `read_log`) or a log that was read; or a list of them, all of which are
            learned from before any is predicted.
        urdf: Path, ``package://...`` or XML text of the robot (see `load_arm`), all of
            whose friction is learned; or what ``arm`` takes, which is then learned as it is.
        joints: Joints to identify, the others are locked; the URDF's where None. For a CSV file
            and arrays the names of their columns, in order.
        arm: In place of a URDF an arm, or ``'two_link'`` or ``'three_link'``.
        train: Span to learn from, ``(T0, T1)`` or ``'T0:T1'`` [s], where None stands for an end
            of the log; the first half after the filters have forgotten their start, where None.
        test: Span to predict with θ̂ frozen; the rest where None, ``'none'`` for no test.
        topic: Topic of joint values of a bag.
        validate: Another log, or a list of them, to predict with θ̂ frozen; the first are then
            learned from as a whole, where ``train`` is None.
        columns: Columns of a CSV file, or names of arrays, by kind, see `read_log`.
        degrees: Whether positions and velocities are in degrees.
        gain: What the effort of a joint is multiplied by, by joint [N·m per unit].
        effort_delay: How far the effort is behind the motion [s].
        force: Whether to learn even from a log that the checks refuse.
        options: How the log is read, as one object; what is also given by keyword takes
            precedence.
        settings: Those of the identifier; ``IdentifierSettings.real_robot()`` where None.
        progress: Called now and then with the number of samples done and that of all.
        changes: Settings by name, e.g. ``kh=100.0, history={'size': 200}``.

    Returns:
        θ̂ by name, what the log leaves undetermined, and the errors of the predicted torque per
        joint [N·m]; ``print`` shows them.

    Raises:
        LogError: the log cannot be read, cannot be right, or has no sample that can be used.
        ParameterError: a setting or span cannot be used.
        ArmError: no arm can be made of the URDF and the joints.
        MissingExtra: Pinocchio, which reads the URDF, is not installed.
    """
    subject = subject_of(urdf, joints, arm, settings, changes, argument_names(identify))
    options = LogOptions.taken(options, {
        'topic': topic, 'columns': columns, 'degrees': degrees, 'gain': gain,
        'effort_delay': effort_delay, 'force': force})
    logs, others = several(log), [] if validate is None else several(validate)
    identifier = build_identifier(subject.settings, subject.arm)
    reader = LogReader(subject.arm, subject.settings, options, subject.filled, identifier.memory)
    sections = reader.sections(logs, others, train, test)
    result = learn(identifier, sections, progress)
    source = ', '.join(map(name_of, logs))
    _check_used(result, identifier, source, test == NO_TEST and not others)
    return _judged(identifier, sections, result, source, reader)


def _judged(identifier: Identifier, sections: Sequence[Section], result: LogPass, source: str,
            reader: LogReader) -> Identification:
    """Return what a pass has taught, with how sure it is and the consistent model."""
    arm, judged, consistent = identifier.arm, result.uncertainty, None
    begin = time.perf_counter()
    if has_links(arm) and judged is not None:
        consistent = _consistent(identifier, arm, judged)
    seconds = time.perf_counter() - begin
    figures = figures_of(sections, identifier, result)
    figures |= model_figures(identifier, result, consistent, seconds)
    notes = (*reader.notes, *notes_on(identifier, sections, judged, figures,
                                        reader.findings))
    figures |= {'source': source, 'checks': checks_of(reader.findings),
                'notes': list(notes),
                'verdicts': listed(reader.findings, arm.joints)}
    problems = [section.log.problem for section in sections if section.log.problem]
    return Identification(identifier, figures, result.prediction, judged, source,
                          '; '.join(problems) or None, tuple(reader.findings),
                          notes, consistent, result.growth)


def _consistent(identifier: Identifier, arm: InertialArm, judged: Uncertainty) -> ConsistentModel:
    stack = identifier.stack
    return consistent_model(arm, stack.regressors[:stack.count], stack.torques[:stack.count],
                            judged.alike)


def _check_used(result: LogPass, identifier: Identifier, source: str, untested: bool) -> None:
    """Raise LogError where the filter left no pair of a span."""
    filters = identifier.settings.filter
    for name, fit in (('train', result.train), ('test', result.test)):
        if fit.count == 0 and not (name == 'test' and untested):
            raise LogError(f'{source}: no sample of the {name} span can be used: the filter '
                           f'restarts at gaps of more than {filters.gap:g} s and settles for '
                           f'{filters.settle:g} time constants')
