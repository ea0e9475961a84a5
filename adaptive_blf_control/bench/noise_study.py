# SPDX-License-Identifier: Apache-2.0
"""``compare --noise``: what protects the estimate from encoder steps and torque noise.

Closed-loop runs of three_link_encoder; what was not taken into the product lives here alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.bench.comparison import WRONG_MODEL
from adaptive_blf_control.configuration.build_closed_loop import build_closed_loop
from adaptive_blf_control.configuration.parameter_file import apply_settings, load_yaml
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.change_monitor import ResidualMonitor
from adaptive_blf_control.identification.history_stack import HistoryStack
from adaptive_blf_control.identification.identifier import Identifier
from adaptive_blf_control.identification.settings import IdentifierSettings
from adaptive_blf_control.identification.update_law import implicit_step
from adaptive_blf_control.identification.update_laws import Evidence
from adaptive_blf_control.runs.torque_error import PredictedTorque
from adaptive_blf_control.simulation.closed_loop import ClosedLoop
from adaptive_blf_control.simulation.plant import known_truth

__all__ = ['GatedStack', 'PARTS', 'Ridge', 'SecondMinute', 'run_study',
           'second_minute']

ENCODER = 'three_link_encoder'
PAYLOADS = (0.0, 0.5, 1.0, 1.5, 2.0)
FEW = (0.0, 2.0)
Learner = Callable[[Arm, IdentifierSettings], Identifier]


class SecondMinute(NamedTuple):
    """Errors of the predicted torque, parts of RMS, shape (n,), and the rest of a run.

    Attributes:
        start: At 60 s.
        worst: Largest at any whole second of the second minute.
        growth: Largest excess over the error at 60 s at any later whole second; ≤ 0 is wanted.
        left: Samples outside a set.
        changes: Alarms of the change monitor.
    """

    start: np.ndarray
    worst: np.ndarray
    growth: np.ndarray
    left: int
    changes: int


class GatedStack(HistoryStack):
    """Residual gating: a full stack refuses pairs that θ_s predicts badly."""

    def __init__(self, n: int, m: int, size: int, epsilon: float, limit: float) -> None:
        """Refuse residuals above ``limit`` times the RMS residual of the stack, per joint."""
        super().__init__(n, m, size, epsilon)
        self._limit = limit
        self._known = -1
        self._theta: np.ndarray = np.zeros(m)
        self._rms: np.ndarray = np.zeros(n)

    def offer(self, regressor: np.ndarray, torque: np.ndarray) -> int:
        """Offer a pair that passes the gate; see `HistoryStack`."""
        if self.full and self.rank == self.gram.shape[0]:
            if self._known != self.insertions:
                self._known = self.insertions
                self._theta = np.asarray(np.linalg.solve(self.gram, self.moment))
                residuals = self.regressors @ self._theta - self.torques
                self._rms = np.asarray(np.sqrt(np.mean(residuals ** 2, axis=0)))
            if np.any(np.abs(regressor @ self._theta - torque) > self._limit * self._rms):
                return -1
        return super().offer(regressor, torque)


class Ridge:
    """Directions of Q below ``floor`` are filled up to it with ``prior``, shape (m,)."""

    def __init__(self, settings: IdentifierSettings, floor: float, prior: np.ndarray) -> None:
        """Take the gains, the floor and the prior."""
        self._settings, self._floor, self._prior = settings, floor, prior

    def step(self, theta: np.ndarray, dt: float, evidence: Evidence) -> np.ndarray:
        """See `UpdateLaw`; nothing is learned before the first pair."""
        if not evidence.gram.any() or not evidence.settled:
            return theta
        values, vectors = np.linalg.eigh(evidence.gram)
        ridge = (vectors * np.maximum(self._floor - values, 0.0)) @ vectors.T
        settings = self._settings
        return implicit_step(
            theta, dt, settings.gamma, settings.kt, settings.kh, evidence.regressor,
            evidence.torque, evidence.gram + ridge, evidence.moment + ridge @ self._prior,
            evidence.adaptation_term)


def second_minute(folder: Path, settings: Sequence[str], payload: float,
                  learner: Learner = Identifier) -> SecondMinute:
    """Run the encoder scenario for 120 s.

    Args:
        folder: Folder of the scenarios.
        settings: Of the identifier, without its name.
        payload: Of the true arm [kg].
        learner: Makes the identifier of the scenario's arm and settings.
    """
    loop = _loop(folder, ENCODER, [f'identifier.{setting}' for setting in settings]
                 + [f'arm_driver.payload={payload}'])
    loop.identifier = learner(loop.arm, loop.identifier.settings)
    measure = PredictedTorque(loop.arm, loop.controller.reference, 120.0)
    true = known_truth(loop.plant, loop.arm.parameters)[0][1]
    errors, left = [], 0
    for k, sample in enumerate(loop.samples(120.0)):
        t = sample.t
        left += not _inside(loop, t)
        if t > 60.0 - 1e-9 and k % 1000 == 0:
            errors.append(measure.error(sample.theta_hat, true))
    later = np.array(errors)
    return SecondMinute(later[0], later.max(axis=0), (later[1:] - later[0]).max(axis=0), left,
                        loop.identifier.changes)


def _loop(folder: Path, name: str, settings: Sequence[str]) -> ClosedLoop:
    return build_closed_loop(apply_settings(load_yaml(folder / f'{name}.yaml'), list(settings)))


def _inside(loop: ClosedLoop, t: float) -> bool:
    state = loop.controller.state(t, loop.plant.q, loop.plant.qd)
    return bool((loop.controller.constraints.margins(state) > 0.0).all())


def _percent(values: np.ndarray) -> str:
    return ' / '.join(f'{100.0 * value:.2g}' for value in values)


def _table(folder: Path, rows: Sequence[tuple[str, Sequence[str], Learner]],
           payloads: Sequence[float]) -> None:
    print('| | payload [kg] | at 60 s [%] | worst, second minute [%] | largest growth since 60 s '
          '[%] | samples outside | alarms |\n' + '|---' * 7 + '|')
    for name, settings, learner in rows:
        for payload in payloads:
            result = second_minute(folder, settings, payload, learner)
            print(f'| {name} | {payload:g} | {_percent(result.start)} | {_percent(result.worst)} '
                  f'| {100.0 * result.growth.max():.1e} | {result.left} | {result.changes} |',
                  flush=True)
    print()


def _filters(folder: Path) -> None:
    print('### Filters\n')
    rows: list[tuple[str, Sequence[str], Learner]] = [
        (f'no state filter, k = {1000 * k:g} ms',
         (f'filter.time_constant={k}', 'filter.state_order=0'), Identifier)
        for k in (0.005, 0.05, 0.2)]
    rows += [(f'order {order} x {1000 * constant:g} ms',
              (f'filter.state_order={order}', f'filter.state_time_constant={constant}'),
              Identifier) for order in (2, 4, 6) for constant in (0.02, 0.03, 0.05)]
    _table(folder, rows, FEW)


def _gated(limit: float) -> Learner:
    def learner(arm: Arm, settings: IdentifierSettings) -> Identifier:
        history = settings.history
        return Identifier(arm, settings, history_stack=GatedStack(
            arm.n, arm.m, history.size, history.epsilon, limit))
    return learner


def _ridged(floor: float) -> Learner:
    def learner(arm: Arm, settings: IdentifierSettings) -> Identifier:
        return Identifier(arm, settings, Ridge(settings, floor, WRONG_MODEL * arm.nominal))
    return learner


def _stack(folder: Path) -> None:
    print('### Stack\n')
    bare = 'history.minimum_growth=0.0'
    size = 'history.size={}'
    _table(folder, [
        *((f'Algorithm 1, P = {p}', (bare, size.format(p)), Identifier) for p in (30, 100, 200)),
        *((f'residual gating, {limit:g} x RMS', (bare,), _gated(limit)) for limit in (2.0, 3.0)),
        *((f'minimum growth {100 * part:g} %', (f'history.minimum_growth={part}',), Identifier)
          for part in (0.02, 0.05, 0.2)),
        *((f'ridge below {floor:g}', (bare,), _ridged(floor)) for floor in (1e-5, 1e-3)),
    ], FEW)


def _payloads(folder: Path) -> None:
    print('### The scenario as it is\n')
    _table(folder, [('config/three_link_encoder.yaml', (), Identifier)], PAYLOADS)


def _alarms(folder: Path) -> None:
    print('### Half an hour without a change\n')
    print('| payload [kg] | alarms | largest statistic | threshold | samples outside | predicted '
          'torque at the end [%] |\n' + '|---' * 6 + '|')
    for payload in (0.0,):
        loop = _loop(folder, ENCODER, [f'arm_driver.payload={payload}'])
        settings, largest, left = loop.identifier.settings, 0.0, 0
        change = settings.change
        monitor = ResidualMonitor(loop.arm.n, loop.arm.m, change.window, change.threshold,
                                  change.resolution)
        loop.identifier = Identifier(loop.arm, settings, change_monitor=monitor)
        for sample in loop.samples(1800.0):
            largest = max(largest, float(monitor.statistic.max()))
            left += not _inside(loop, sample.t)
        measure = PredictedTorque(loop.arm, loop.controller.reference, 120.0)
        error = measure.error(sample.theta_hat,
                              known_truth(loop.plant, loop.arm.parameters)[0][1])
        print(f'| {payload:g} | {loop.identifier.changes} | {largest:.2f} | '
              f'{change.threshold:g} | {left} | {_percent(error)} |\n', flush=True)


def _detection(folder: Path) -> None:
    print('### A change\n')
    print('| scenario | found after [ms] | rank full again after [s] | predicted torque within '
          '1 % again after [s] | at the end [%] | samples outside | alarms |\n' + '|---' * 7 + '|')
    step = ['arm_driver.schedule.time=[60.0]', 'arm_driver.schedule.parameter=[payload]']
    cases = [('two_link_payload_step', 'two_link_payload_step', []),
             *((f'{ENCODER}, {before:g} to {after:g} kg at 60 s', ENCODER,
                [*step, f'arm_driver.schedule.value=[{after}]', f'arm_driver.payload={before}'])
               for before, after in ((0.0, 1.0), (0.0, 0.1), (2.0, 0.0)))]
    for title, name, settings in cases:
        print(f'| {title} | {" | ".join(_detect(_loop(folder, name, settings)))} |', flush=True)
    print()


def _detect(loop: ClosedLoop) -> list[str]:
    (_, _), (jump, true) = known_truth(loop.plant, loop.arm.parameters)
    measure = PredictedTorque(loop.arm, loop.controller.reference, 2.0 * jump)
    identifier, stack, left = loop.identifier, loop.identifier.stack, 0
    found = full = bad = None
    before = 0
    for k, sample in enumerate(loop.samples(2.0 * jump)):
        t = sample.t
        left += not _inside(loop, t)
        if t < jump:
            before = identifier.changes
            continue
        if found is None and identifier.changes > before:
            found = t - jump
        if found is not None and full is None and stack.rank == loop.arm.m:
            full = t - jump
        if k % 20 == 0 and measure.error(sample.theta_hat, true).max() > 0.01:
            bad = t - jump
    return ['not' if found is None else f'{1000.0 * found:.0f}',
            'not' if full is None else f'{full:.2f}', '0' if bad is None else f'{bad:.2f}',
            _percent(measure.error(sample.theta_hat, true)), str(left), str(identifier.changes)]


PARTS: dict[str, Callable[[Path], None]] = {
    'filters': _filters, 'stack': _stack, 'payloads': _payloads, 'alarms': _alarms,
    'detection': _detection}


def run_study(parts: Sequence[str], folder: Path = Path('config')) -> int:
    """Print the parts of the study as Markdown, all without a name; 0."""
    for part in parts:
        if part not in PARTS:
            raise ParameterError('--noise', part, f'of {", ".join(PARTS)}')
    for part in parts or PARTS:
        PARTS[part](folder)
    return 0
