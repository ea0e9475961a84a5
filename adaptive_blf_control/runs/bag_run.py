# SPDX-License-Identifier: Apache-2.0
"""A recorded run, read from its bag alone, without ROS and without a parameter file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import yaml

from adaptive_blf_control.bags.reader import Bag
from adaptive_blf_control.bounded_yaml import load_yaml_text
from adaptive_blf_control.configuration.build_arm import build_arm
from adaptive_blf_control.configuration.build_plant import build_plant
from adaptive_blf_control.configuration.node_settings import ControllerNodeSettings, DriverSettings
from adaptive_blf_control.configuration.parameter_file import node_settings, PARAMETERS_KEY
from adaptive_blf_control.control.constraints import Constraint, Constraints
from adaptive_blf_control.control.set_constraints import (
    made_constraint,
    PerformanceConstraint,
    SafetyConstraint,
)
from adaptive_blf_control.control.sets import JointInterval
from adaptive_blf_control.errors import BagError, BlfError, MissingExtra
from adaptive_blf_control.messages.command import read_command
from adaptive_blf_control.messages.topics import (
    BARRIER,
    COMMANDS,
    HISTORY_RANK,
    HISTORY_SIGMA_MIN,
    JOINT_STATES,
    THETA_HAT,
    TRACKING_ERROR,
)
from adaptive_blf_control.runs.margins import Margins, published_margins
from adaptive_blf_control.runs.summary import Run, state_along
from adaptive_blf_control.runs.torque_use import TorqueUse
from adaptive_blf_control.simulation.actuated_arm import arm_alone
from adaptive_blf_control.simulation.plant import truth_of
from adaptive_blf_control.simulation.true_arm import epochs_truth, true_epochs, Truth

__all__ = ['bag_parameters', 'constraints_of', 'rates', 'run_of_bag', 'topic_named']


def bag_parameters(bag: Bag) -> dict[str, Any]:
    """Return the parameter file of the run; BagError where the bag has none."""
    text = bag.custom_data.get(PARAMETERS_KEY)
    try:
        data = load_yaml_text(text) if text else None
    except yaml.YAMLError as error:
        raise BagError(f'{bag.path}: {PARAMETERS_KEY!r} in custom_data: {error}') from None
    if not isinstance(data, dict):
        raise BagError(f'{bag.path}: no parameters of the run in custom_data '
                       f'({PARAMETERS_KEY!r}): expected a bag of our recorder')
    return data


def topic_named(bag: Bag, name: str) -> str:
    """Return the recorded topic that is ``name`` under any namespace; BagError if none."""
    for topic in bag.topics:
        if topic == name or topic.endswith(f'/{name}'):
            return topic
    raise BagError(f'{bag.path}: no topic {name!r}; it has {", ".join(sorted(bag.topics))}')


def run_of_bag(bag: Bag) -> Run:
    """Return the run in a bag, from the first answered joint state on.

    Raises:
        BagError: a topic or the parameters of the run are missing.
    """
    data = bag_parameters(bag)
    controller = node_settings(data, ControllerNodeSettings)
    joints = controller.joints
    controller = controller.resolved(joints=len(joints))
    states = bag.joint_states(topic_named(bag, JOINT_STATES), joints)
    errors = bag.joint_states(topic_named(bag, TRACKING_ERROR), joints)
    estimates = bag.joint_states(topic_named(bag, THETA_HAT))
    stamps, at_state, at_error = np.intersect1d(states.stamp_ns, errors.stamp_ns,
                                                return_indices=True)
    if stamps.size == 0:
        raise BagError(f'{bag.path}: no joint state was answered by the controller')
    between = (states.stamp_ns > stamps[0]) & (states.stamp_ns < stamps[-1])
    between[at_state] = False
    learning = estimates.stamp_ns >= stamps[0]
    safety, performance = _sets(controller)
    constraints = constraints_of(controller)
    silent = states.position[between]
    return Run(
        joints=joints, parameters=estimates.names, t=(stamps - stamps[0]) * 1e-9,
        q=states.position[at_state], qd=states.velocity[at_state], e1=errors.position[at_error],
        t_theta=(estimates.stamp_ns[learning] - stamps[0]) * 1e-9,
        theta_hat=estimates.position[learning], rank=int(_last(bag, HISTORY_RANK)),
        sigma_min=float(_last(bag, HISTORY_SIGMA_MIN)), safety=safety, performance=performance,
        constraints=constraints, truth=_true_parameters(data, estimates.names),
        unanswered=state_along((states.stamp_ns[between] - stamps[0]) * 1e-9, silent,
                               states.velocity[between], np.full_like(silent, np.nan),
                               performance),
        published=_published(bag, constraints, int(stamps[0])),
        torques=_torques(bag, controller))


def _torques(bag: Bag, controller: ControllerNodeSettings) -> TorqueUse | None:
    """Return the commands of the controller, None where the bag has none that fit its joints."""
    try:
        commands = bag.doubles(topic_named(bag, COMMANDS))[1]
    except BagError:
        return None
    if commands.ndim != 2 or commands.shape[1] != len(controller.joints):
        return None
    return TorqueUse(commands, controller.torque_limit)


def constraints_of(settings: ControllerNodeSettings) -> Constraints:
    """Return the constraints of a recorded run, as far as they can be made here.

    Those of ``controller.constraints`` may be modules that are not here, or need an arm that is
    not; their margins are then known as they were published.

    Raises:
        ParameterError: a set cannot be.
    """
    settings = settings.resolved(joints=len(settings.joints))
    parts: list[Constraint] = [SafetyConstraint(settings.joints, _sets(settings)[0]),
                               PerformanceConstraint(settings.joints)]
    for text in filter(None, settings.constraints):
        try:
            parts.append(made_constraint(build_arm(settings), settings, text))
        except BlfError:
            continue
    return Constraints(parts, settings.joints)


def _sets(settings: ControllerNodeSettings) -> tuple[JointInterval, JointInterval]:
    safety, performance = settings.safety, settings.performance
    return (JointInterval(safety.lower, safety.upper, 'safety'),
            JointInterval(performance.lower, performance.upper, 'performance'))


def _published(bag: Bag, constraints: Constraints, zero_ns: int) -> tuple[Margins, ...]:
    """Return the published margins of what is not among ``constraints``."""
    try:
        topic = topic_named(bag, BARRIER)
    except BagError:
        return ()
    heard = bag.joint_states(topic)
    known = {part.name for part in constraints.parts}
    return tuple(each for each in published_margins(
        heard.names, (heard.stamp_ns - zero_ns) * 1e-9, heard.position)
        if each.constraint not in known)


def _last(bag: Bag, name: str) -> float:
    return float(bag.doubles(topic_named(bag, name))[1][-1])


def _true_parameters(data: Mapping[str, Any], parameters: tuple[str, ...]) -> Truth | None:
    """θ* of a simulated arm over time, matched by name; None for a real one."""
    if not any(key.endswith('/arm_driver') for key in data):
        return None
    driver = node_settings(data, DriverSettings)
    if driver.plant == 'builtin':
        return epochs_truth(true_epochs(arm_alone(driver), build_arm(driver)), parameters)
    if driver.plant != 'mujoco':
        return None
    try:
        return truth_of(build_plant(driver, build_arm(driver)), parameters)
    except MissingExtra:  # the bag comes from a machine that has it
        return None


def rates(bag: Bag, run: Run) -> dict[str, float]:
    """Return the rates of the nodes during a run [Hz], from the first to the last answer.

    States and estimates also come before a motion begins and after it, and so do commands: those
    of a ramp and the zero at its end. They say that they answer no state, and are not counted.
    """
    last = float(run.t[-1])
    states = run.t.size + (0 if run.unanswered is None else len(run.unanswered.q))
    commands = (read_command(message.data) for message in bag.messages(topic_named(bag, COMMANDS)))
    answers = sum(each.stamp_ns is not None or not each.source for each in commands)
    counts = {'arm_driver': states, 'controller': answers,
              'identifier': int(np.count_nonzero(run.t_theta <= last))}
    return {name: (count - 1) / max(last, 1e-9) for name, count in counts.items()}
