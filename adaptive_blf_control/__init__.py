# SPDX-License-Identifier: Apache-2.0
"""Adaptive control of a robot arm with guaranteed safety and performance sets.

What a Python program needs is imported from here, when it is first used: arms (`load_arm`,
`TwoLinkArm`, `ThreeLinkArm`, `UrdfArm`), learning (`Identifier`, `identify`, `read_log`), control
(`Controller`, `ClosedLoop`, `simulate`), bags (`read_bag`) and the errors.
"""

import importlib
import os
from typing import Any, TYPE_CHECKING

# The matrices here are small: BLAS threads cost more than they give, and their busy waiting
# takes the cores from the other nodes. Works where numpy is not loaded yet; a set value stays.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

__version__ = '0.1.0'

if TYPE_CHECKING:
    from adaptive_blf_control.arms.inverse_dynamics import inverse_dynamics as inverse_dynamics
    from adaptive_blf_control.arms.load import load_arm as load_arm
    from adaptive_blf_control.arms.three_link import ThreeLinkArm as ThreeLinkArm
    from adaptive_blf_control.arms.two_link import TwoLinkArm as TwoLinkArm
    from adaptive_blf_control.arms.urdf import UrdfArm as UrdfArm
    from adaptive_blf_control.bags.logs import MeasuredLog as MeasuredLog
    from adaptive_blf_control.bags.logs import read_log as read_log
    from adaptive_blf_control.bags.reader import read_bag as read_bag
    from adaptive_blf_control.control.controller import Controller as Controller
    from adaptive_blf_control.control.settings import ControllerSettings as ControllerSettings
    from adaptive_blf_control.errors import (
        ArmError as ArmError,
    )
    from adaptive_blf_control.errors import (
        BagError as BagError,
    )
    from adaptive_blf_control.errors import (
        BlfError as BlfError,
    )
    from adaptive_blf_control.errors import (
        LogError as LogError,
    )
    from adaptive_blf_control.errors import (
        MissingExtra as MissingExtra,
    )
    from adaptive_blf_control.errors import (
        ParameterError as ParameterError,
    )
    from adaptive_blf_control.errors import (
        SetViolation as SetViolation,
    )
    from adaptive_blf_control.identification.identifier import Identifier as Identifier
    from adaptive_blf_control.identification.settings import (
        IdentifierSettings as IdentifierSettings,
    )
    from adaptive_blf_control.runs.identification import identify as identify
    from adaptive_blf_control.runs.simulation import simulate as simulate
    from adaptive_blf_control.simulation.closed_loop import ClosedLoop as ClosedLoop

_MODULES = {
    'ClosedLoop': 'simulation.closed_loop', 'Controller': 'control.controller',
    'ControllerSettings': 'control.settings', 'Identifier': 'identification.identifier',
    'IdentifierSettings': 'identification.settings', 'MeasuredLog': 'bags.logs',
    'ThreeLinkArm': 'arms.three_link', 'TwoLinkArm': 'arms.two_link', 'UrdfArm': 'arms.urdf',
    'identify': 'runs.identification', 'inverse_dynamics': 'arms.inverse_dynamics',
    'load_arm': 'arms.load', 'read_bag': 'bags.reader', 'read_log': 'bags.logs',
    'simulate': 'runs.simulation',
    **dict.fromkeys(('ArmError', 'BagError', 'BlfError', 'LogError', 'MissingExtra',
                     'ParameterError', 'SetViolation'), 'errors'),
}
__all__ = sorted(_MODULES)


def __getattr__(name: str) -> Any:
    """Import a public name when it is first asked for."""
    if name not in _MODULES:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}: it offers '
                             f'{", ".join(sorted(_MODULES))}')
    value = getattr(importlib.import_module(f'{__name__}.{_MODULES[name]}'), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """List the public names, for tab completion."""
    return sorted([*_MODULES, '__version__'])
