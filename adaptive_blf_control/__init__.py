# SPDX-License-Identifier: Apache-2.0
"""Adaptive control of a robot arm with guaranteed safety and performance sets.

What a program needs is imported from here, when it is first used; `dir` lists it:

    arms         list_arms, load_arm, TwoLinkArm, ThreeLinkArm, UrdfArm,
                 inverse_dynamics
    learning     Identifier with IdentifierSettings; identify (an Identification) with
                 LogOptions, read_log (a MeasuredLog)
    control      Controller with ControllerSettings; SumOfSinusoids
    simulation   list_scenarios, simulate (a Simulation), ClosedLoop
    bags         read_bag
    own parts    Arm, ForwardDynamics, Plant, Sensor, Measurement, Reference, ReferencePoint,
                 Law, LawSample, LawAnswer, Constraint, MotionState, Bounded, UpdateLaw,
                 Evidence, StateFilter, History, ChangeMonitor
    errors       BlfError and what inherits from it

`help` of each says shapes, units, errors and source.

Arrays may be lists or of any real type. Units are SI, angles radians. What cannot be used is
refused with a BlfError that names it, its value and what is expected.
"""

import importlib
import os
import sys
from typing import Any, TYPE_CHECKING

# The matrices here are small: BLAS threads cost more than they give, and their busy waiting
# takes the cores from the other nodes. Works where numpy is not loaded yet; a set value stays.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

__version__ = '0.1.0'

if TYPE_CHECKING:
    from adaptive_blf_control.arms.arm import Arm as Arm, ForwardDynamics as ForwardDynamics
    from adaptive_blf_control.arms.at_hand import list_arms as list_arms
    from adaptive_blf_control.arms.inverse_dynamics import inverse_dynamics as inverse_dynamics
    from adaptive_blf_control.arms.load import load_arm as load_arm
    from adaptive_blf_control.arms.three_link import ThreeLinkArm as ThreeLinkArm
    from adaptive_blf_control.arms.two_link import TwoLinkArm as TwoLinkArm
    from adaptive_blf_control.arms.urdf import UrdfArm as UrdfArm
    from adaptive_blf_control.bags.logs import read_log as read_log
    from adaptive_blf_control.bags.measured_log import MeasuredLog as MeasuredLog
    from adaptive_blf_control.bags.reader import read_bag as read_bag
    from adaptive_blf_control.configuration.shipped import list_scenarios as list_scenarios
    from adaptive_blf_control.control.constraints import (
        Bounded as Bounded,
        Constraint as Constraint,
        MotionState as MotionState,
    )
    from adaptive_blf_control.control.controller import Controller as Controller
    from adaptive_blf_control.control.laws.protocol import (
        Law as Law,
        LawAnswer as LawAnswer,
        LawSample as LawSample,
    )
    from adaptive_blf_control.control.reference import (
        Reference as Reference,
        ReferencePoint as ReferencePoint,
        SumOfSinusoids as SumOfSinusoids,
    )
    from adaptive_blf_control.control.settings import ControllerSettings as ControllerSettings
    from adaptive_blf_control.errors import (
        ArmError as ArmError,
        BagError as BagError,
        BlfError as BlfError,
        LogError as LogError,
        MissingExtra as MissingExtra,
        ParameterError as ParameterError,
        SetViolation as SetViolation,
        UnknownParameter as UnknownParameter,
    )
    from adaptive_blf_control.identification.change_monitor import ChangeMonitor as ChangeMonitor
    from adaptive_blf_control.identification.history import History as History
    from adaptive_blf_control.identification.identifier import Identifier as Identifier
    from adaptive_blf_control.identification.settings import (
        IdentifierSettings as IdentifierSettings,
    )
    from adaptive_blf_control.identification.state_filter import StateFilter as StateFilter
    from adaptive_blf_control.identification.update_laws import (
        Evidence as Evidence,
        UpdateLaw as UpdateLaw,
    )
    from adaptive_blf_control.runs.identification import (
        Identification as Identification,
        identify as identify,
    )
    from adaptive_blf_control.runs.log_options import LogOptions as LogOptions
    from adaptive_blf_control.runs.simulation import simulate as simulate, Simulation as Simulation
    from adaptive_blf_control.simulation.closed_loop import ClosedLoop as ClosedLoop
    from adaptive_blf_control.simulation.plant import Plant as Plant
    from adaptive_blf_control.simulation.sensors import (
        Measurement as Measurement,
        Sensor as Sensor,
    )

_NAMES = {
    'arms.arm': ('Arm', 'ForwardDynamics'),
    'arms.at_hand': ('list_arms',),
    'arms.inverse_dynamics': ('inverse_dynamics',),
    'arms.load': ('load_arm',),
    'arms.three_link': ('ThreeLinkArm',),
    'arms.two_link': ('TwoLinkArm',),
    'arms.urdf': ('UrdfArm',),
    'bags.logs': ('read_log',),
    'bags.measured_log': ('MeasuredLog',),
    'bags.reader': ('read_bag',),
    'configuration.shipped': ('list_scenarios',),
    'control.constraints': ('Bounded', 'Constraint', 'MotionState'),
    'control.controller': ('Controller',),
    'control.laws.protocol': ('Law', 'LawAnswer', 'LawSample'),
    'control.reference': ('Reference', 'ReferencePoint', 'SumOfSinusoids'),
    'control.settings': ('ControllerSettings',),
    'errors': ('ArmError', 'BagError', 'BlfError', 'LogError',
               'MissingExtra', 'ParameterError', 'SetViolation', 'UnknownParameter'),
    'identification.change_monitor': ('ChangeMonitor',),
    'identification.history': ('History',),
    'identification.identifier': ('Identifier',),
    'identification.settings': ('IdentifierSettings',),
    'identification.state_filter': ('StateFilter',),
    'identification.update_laws': ('Evidence', 'UpdateLaw'),
    'runs.identification': ('Identification', 'identify'),
    'runs.log_options': ('LogOptions',),
    'runs.simulation': ('Simulation', 'simulate'),
    'simulation.closed_loop': ('ClosedLoop',),
    'simulation.plant': ('Plant',),
    'simulation.sensors': ('Measurement', 'Sensor'),
}
_MODULES = {name: module for module, names in _NAMES.items() for name in names}
_INSTEAD = {
    **dict.fromkeys(('regressor', 'regressors'), 'arm.X(q, qd, qd, qdd) is the regressor'),
    **dict.fromkeys(('forward_dynamics', 'ForwardDynamic'),
                    'arm.dynamics(theta).acceleration(q, qd, tau) and advance(q, qd, tau, dt)'),
    **dict.fromkeys(('plot', 'show', 'draw'), 'matplotlib draws arrays: plt.plot(run.t, run.e1)'),
    **dict.fromkeys(('forward_kinematics', 'fkine', 'fk'), 'arm.link_points(q)'),
    **dict.fromkeys(('mass_matrix', 'crba'), 'arm.mass_matrix(q) of a URDF arm'),
    **dict.fromkeys(('gravity', 'gravity_vector'),
                    'inverse_dynamics(arm, theta, q, 0 * q, 0 * q) is the torque at rest'),
    **dict.fromkeys(('robots', 'available_arms', 'list_robots', 'models'),
                    'list_arms() has the arms at hand, load_arm(urdf) takes any other one'),
    **dict.fromkeys(('scenarios', 'available_scenarios', 'configs'),
                    'list_scenarios() has the names that simulate takes'),
    **dict.fromkeys(('Panda', 'PandaArm', 'panda', 'Franka', 'UR5', 'UR10', 'Robot'),
                    'load_arm(urdf) returns the arm of a URDF, list_arms() has those at hand; '
                    "simulate('panda').arm is that of a shipped scenario"),
    'load': 'load_arm(urdf), read_log(file), read_bag(folder); simulate(file) takes a parameter '
            'file, Identifier(arm, initial_estimate=file) a saved estimate',
    **dict.fromkeys(('payload', 'load_mass', 'PayloadEstimator'),
                    'simulate(arm, payload=2.0) drives an arm of a URDF that carries 2 kg; the '
                    'load of a measured robot is estimated by `python -m adaptive_blf_control '
                    'identify --payload`'),
    **dict.fromkeys(('limits', 'obstacles', 'safety_filter', 'SafetyFilter', 'cbf', 'CBF'),
                    "Controller(arm, safety_filter='limits', limits={...}) keeps joint limits, "
                    'velocities and a distance to obstacles'),
    **dict.fromkeys(('true_parameters', 'theta_true', 'theta_star', 'ground_truth'),
                    "simulate(arm, true_model='given', true_parameters=[...]) drives another arm "
                    'than the one that is known; its plant.truth() has them'),
    'settings': 'IdentifierSettings and ControllerSettings',
    **dict.fromkeys(('load_config', 'load_yaml', 'read_yaml', 'load_params', 'read_config'),
                    'simulate(file) takes a parameter file, and its result has the controller '
                    'and the identifier'),
    **dict.fromkeys(('load_model', 'load_theta', 'load_estimate'),
                    'Identifier(arm, initial_estimate=file) starts from what was saved'),
    **dict.fromkeys(('save', 'save_model'), 'identify(...).save(path), simulate(...).save(path)'),
    **dict.fromkeys(('PD', 'PDController', 'ComputedTorque', 'SlotineLi'),
                    "Controller(arm, law='pd'), 'computed_torque' or 'slotine_li'")}
"""What to write for what other programs have at their door."""
# No __all__: help() would import and print everything, 4000 lines in place of 60.


def __getattr__(name: str) -> Any:
    """Import a public name when it is first asked for."""
    if name not in _MODULES:
        if name in _INSTEAD:
            hint = f': {_INSTEAD[name]}'
        elif name in importlib.import_module(f'{__name__}.executables').EXECUTABLES:
            hint = f': `python -m {__name__} {name}` is a command'
        else:
            errors = importlib.import_module(f'{__name__}.errors')
            close = errors.close_names(name, _MODULES)
            hint = f': did you mean {" or ".join(close)}?' if close else errors.nearest(
                name, _MODULES, f'dir({__name__})')
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}{hint}')
    value = getattr(importlib.import_module(f'{__name__}.{_MODULES[name]}'), name)
    globals()[name] = value
    if f'{__name__}.compiled' in sys.modules:  # what was imported may compile
        importlib.import_module(f'{__name__}.compilation_notice').announce_compilation()
    return value


def __dir__() -> list[str]:
    """List the public names, for tab completion."""
    return sorted([*_MODULES, '__version__'])
