# SPDX-License-Identifier: Apache-2.0
"""``bench coverage``: how often 95 % intervals hold, over simulated runs whose truth is known.

Closed-loop runs with encoders and torque noise, each with a payload, a start and noise of its own.
θ̂ is judged at the end of a training time; torques are predicted from there on.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.configuration.build_closed_loop import build_closed_loop
from adaptive_blf_control.configuration.parameter_file import (
    apply_changes,
    apply_settings,
    load_yaml,
)
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.pair_times import PairTimes
from adaptive_blf_control.identification.uncertainty import (
    estimate_uncertainty,
    NORMAL,
    Uncertainty,
)
from adaptive_blf_control.simulation.closed_loop import ClosedLoop
from adaptive_blf_control.simulation.plant import known_truth

__all__ = ['STUDIES', 'Coverage', 'Study', 'add_options', 'coverage', 'run']

_EVERY = 50  # samples between predictions that are compared


class Study(NamedTuple):
    """Runs of one scenario.

    Attributes:
        scenario: Its file in the folder of configurations.
        train: Time after which θ̂ is judged [s].
        test: Time that is predicted afterwards [s].
        payload: Largest payload [kg].
        settings: What is changed in the scenario.
    """

    scenario: str
    train: float
    test: float
    payload: float
    settings: tuple[str, ...] = ()


STUDIES = (
    Study('three_link_encoder', 40.0, 20.0, 2.0),
    Study('panda_ideal', 20.0, 10.0, 1.0, (
        'arm_driver.sensors.model=encoder', 'arm_driver.sensors.torque_noise=0.05',
        'identifier.filter.time_constant=0.05', 'identifier.filter.settle=5.0',
        'identifier.filter.state_order=2', 'identifier.filter.state_time_constant=0.004',
        'identifier.history.size=300', 'identifier.history.epsilon=0.03',
        'identifier.change.window=0.0')),
)


class Coverage(NamedTuple):
    """Parts of the intervals that held in one run.

    Attributes:
        theta: Of the parameters.
        model: Of the torques Y_f θ*, which have no noise.
        measured: Of the measured torques.
        ratio: RMS of (θ̂ − θ*) / std: 1 where the standard deviations are right.
    """

    theta: float
    model: float
    measured: float
    ratio: float


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `run`."""
    parser.add_argument('--runs', type=int, default=50, metavar='N',
                        help='coverage: simulated runs of each scenario; default: 50')


def run(options: argparse.Namespace) -> None:
    """Print a Markdown table of what held."""
    print('| scenario | runs | parameters | torques Y_f θ* | measured torques | error / std |')
    print('|---|---|---|---|---|---|')
    for study in STUDIES:
        held = np.array(list(coverage(study, options.config, options.runs)))
        theta, model, measured, ratio = held.mean(axis=0)
        print(f'| {study.scenario}, {study.train:g} s, then {study.test:g} s | {len(held)} | '
              f'{theta:.1%} | {model:.1%} | {measured:.1%} | {ratio:.2f} |', flush=True)


def coverage(study: Study, folder: Path, runs: int) -> Iterator[Coverage]:
    """Yield what held in each of ``runs`` runs; ``folder`` has the scenarios."""
    data = load_yaml(folder / f'{study.scenario}.yaml')
    random = np.random.default_rng(0)
    start = np.array(data['/**/arm_driver']['ros__parameters']['initial_position'])
    for run in range(runs):
        begin = (start + random.uniform(-2e-3, 2e-3, start.size)).round(6).tolist()
        yield _run(study, build_closed_loop(apply_changes(apply_settings(data, study.settings), {
            'arm_driver.sensors.seed': run,
            'arm_driver.payload': random.uniform(0.0, study.payload),
            'arm_driver.initial_position': begin,
            'controller.reference.smooth_start': 2.0})))


def _run(study: Study, loop: ClosedLoop) -> Coverage:
    identifier, seen = loop.identifier, PairTimes()
    judged: Uncertainty | None = None
    theta: Any = None
    model, measured = [], []
    loop.warm_up()
    truth = known_truth(loop.plant, loop.arm.parameters)[-1][1]
    for k, sample in enumerate(loop.samples(study.train + study.test)):
        if sample.t < study.train:
            seen.observe(sample.t, identifier)
            continue
        if judged is None:
            judged = estimate_uncertainty(identifier, seen)
            theta = identifier.theta
        if judged is not None and k % _EVERY == 0:
            regressor, torque = identifier.pair
            model.append(np.abs(regressor @ (theta - truth))
                         <= judged.half_width(regressor, measured=False))
            measured.append(np.abs(regressor @ theta - torque) <= judged.half_width(regressor))
    if judged is None:
        raise ParameterError('train', study.train, 'a time in which a pair is recorded')
    scaled = (theta - truth) / judged.std
    return Coverage(float(np.mean(np.abs(scaled) <= NORMAL)), float(np.mean(model)),
                    float(np.mean(measured)), float(np.sqrt(np.mean(scaled ** 2))))
