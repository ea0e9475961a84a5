# SPDX-License-Identifier: Apache-2.0
"""A scenario as `simulate` is given it, joined to a closed loop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import os
from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.arms.arm import Arm, checked_arm, SIMULATED
from adaptive_blf_control.arrays import checked_finite
from adaptive_blf_control.configuration.build_arm import build_arm
from adaptive_blf_control.configuration.build_closed_loop import build_closed_loop, OwnParts
from adaptive_blf_control.configuration.node_settings import (
    ControllerNodeSettings,
    DriverSettings,
    IdentifierNodeSettings,
    TABLES,
)
from adaptive_blf_control.configuration.offline import refuse_unused
from adaptive_blf_control.configuration.parameter_file import (
    apply_changes,
    checked_sections,
    flattened,
    given_values,
    load_yaml,
    node_settings,
)
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.given_parameters import values_of
from adaptive_blf_control.parameters.plugin import require
from adaptive_blf_control.parameters.settings import Settings
from adaptive_blf_control.runs.start_check import start_warnings
from adaptive_blf_control.simulation.closed_loop import ClosedLoop
from adaptive_blf_control.simulation.encoder_check import unused_of_encoder

__all__ = ['Joined', 'Scenario', 'duration_of', 'joined']

Scenario = str | os.PathLike[str] | Mapping[str, Any] | Arm | ClosedLoop
"""A parameter file or its data, an arm, or a loop that was joined by hand."""

_SCENARIOS = ("a parameter file such as 'config/two_link.yaml', an arm such as TwoLinkArm() or "
              'load_arm(urdf), or a ClosedLoop; a plant is given as plant=...')
USUAL_DURATION = 20.0  # s, where neither the caller nor the scenario says


class Joined(NamedTuple):
    """A loop that is ready to run.

    Attributes:
        loop: The loop.
        data: The data of the parameter file it was built from; of an arm its joints alone.
        notes: What is to be said about it, in sentences.
        built: Whether arm and plant were built from ``data``, not given as objects.
    """

    loop: ClosedLoop
    data: dict[str, Any]
    notes: tuple[str, ...]
    built: bool


def duration_of(data: Mapping[str, Any], duration: float | None) -> float:
    """Return how long a run lasts [s]: as given, else as the scenario says, else 20 s."""
    if duration is None:
        return node_settings(data, DriverSettings).duration or USUAL_DURATION
    return checked_finite('duration', duration, 'a time > 0 s', above=0.0)


def joined(scenario: Scenario, own: OwnParts, changes: Mapping[str, Any]) -> Joined:
    """Return the loop of a scenario; arguments and errors as of `simulate`.

    Args:
        scenario: What is run.
        own: Parts in place of those that it names; ``arm`` is taken from the scenario.
        changes: Parameters in place of those that it gives.
    """
    if isinstance(scenario, ClosedLoop):
        given = {**own._asdict(), 'constraints': own.constraints or None, **changes}
        for name, value in given.items():
            if value is not None:
                raise ParameterError(name, value, 'nothing: the loop has been joined by hand')
        scenario.check_start()  # before anything is compiled or a bag is made
        return Joined(scenario, _of_joints(scenario.arm), (), False)
    data, arm = _data_and_arm(scenario)
    if arm is not None and own.plant is None:
        require('scenario', arm, arm, SIMULATED)
        if np.shape(arm.nominal) != (arm.m,) or not isinstance(arm.nominal, np.ndarray):
            raise ParameterError('nominal', arm.nominal, f'a numpy array of shape ({arm.m},), one '
                                 f'for each of {", ".join(arm.parameters)}')
    refuse_unused(changes, arm=arm, plant=None if isinstance(own.plant, type) or callable(
        own.plant) else own.plant)
    data = apply_changes(data, _by_value(changes, arm, data))
    _refuse_friction(changes, data)
    loop = build_closed_loop(data, own._replace(arm=arm))
    _refuse_idle(changes, unused_of_encoder(given_values(data, 'arm_driver'), loop.plant))
    notes = tuple(start_warnings(data, loop))  # may refuse an unstable loop
    return Joined(loop, data, notes, arm is None and own.plant is None)


def _refuse_idle(changes: Mapping[str, Any], idle: Sequence[str]) -> None:
    """Raise ParameterError for a change to an encoder where none measures."""
    for name, value in flattened(changes):
        if name.removeprefix('arm_driver.') in idle:
            raise ParameterError(name, value, "nothing where the true state is measured: "
                                 "sensor='encoder' measures with it")


def _refuse_friction(changes: Mapping[str, Any], data: Mapping[str, Any]) -> None:
    """Raise ParameterError for a choice of friction that an arm in closed form does not have."""
    for name, value in flattened(changes):
        head, _, tail = name.partition('.')
        key = tail if head in TABLES else name
        if not key.startswith('friction.'):
            continue
        kinds = {node_settings(data, ControllerNodeSettings).arm,
                 node_settings(data, DriverSettings).arm,
                 node_settings(data, IdentifierNodeSettings).arm}
        if 'urdf' not in kinds:
            raise ParameterError(name, value, f'nothing: the friction of {min(kinds)} is part of '
                                 'its theta, which true_parameters sets; only arms of a URDF '
                                 'have a choice')


def _by_value(changes: Mapping[str, Any], arm: Arm | None,
              data: Mapping[str, Any]) -> dict[str, Any]:
    """Return changes with θ̂(0) as an array where it is given by parameter name.

    Args:
        changes: As a caller gives them.
        arm: The arm; that of the identifier of ``data`` where None.
        data: The parameter file's data.

    Raises:
        ParameterError: a node's settings are given as something else.
    """
    for node in TABLES:
        if node in changes and not isinstance(changes[node], (Mapping, Settings)):
            raise ParameterError(node, changes[node], "parameters by name, such as {'k2': 30.0}; "
                                 'ClosedLoop(plant, controller, identifier) joins objects')
    values = changes.get('initial_estimate')
    values = getattr(values, 'estimate', values)  # of an identifier, or of a log
    if not isinstance(values, Mapping):
        return dict(changes)
    if arm is None:
        arm = build_arm(node_settings(data, IdentifierNodeSettings))
    return {**changes, 'initial_estimate': values_of('initial_estimate', values, arm)}


def _data_and_arm(scenario: Any) -> tuple[dict[str, Any], Arm | None]:
    """Return a parameter file's data, and the arm where it is given as an object."""
    if isinstance(scenario, (str, os.PathLike)):
        text = os.fspath(scenario)
        if '<robot' in text or text.lower().endswith(('.urdf', '.xacro')):
            raise ParameterError('scenario', scenario, 'a parameter file: load_arm reads a URDF, '
                                 'simulate(load_arm(urdf))')
        return load_yaml(text, 'scenario'), None
    if isinstance(scenario, Mapping):
        return checked_sections(scenario, 'scenario', scenario), None
    if not hasattr(scenario, 'Y1'):
        raise ParameterError('scenario', scenario, _SCENARIOS)
    arm = checked_arm('scenario', scenario)
    return _of_joints(arm), arm


def _of_joints(arm: Arm) -> dict[str, Any]:
    return {'/**': {'ros__parameters': {'joints': list(arm.joints)}}}
