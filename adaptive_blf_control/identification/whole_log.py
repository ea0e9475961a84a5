# SPDX-License-Identifier: Apache-2.0
"""The arrays of a log that is given as one object: a mapping, what `read_log` returns, a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import os
from typing import Any

import numpy as np

from adaptive_blf_control.arrays import joint_places
from adaptive_blf_control.errors import LogError, ParameterError

__all__ = ['breaks_of', 'log_arrays']


def log_arrays(log: Any, joints: Sequence[str]) -> tuple[Any, Any, Any, Any] | None:
    """Return t, q, qd and tau of a log that is given as a whole; None where it is none.

    Args:
        log: A mapping, or an object with these attributes; one that knows the names of its joints
            has ``of_joints`` as well, which puts them in another order.
        joints: Joints of the arm.

    Raises:
        ParameterError: it is a log that has to be read first.
        LogError: its joints have other names.
    """
    names = ('t', 'q', 'qd', 'tau')
    measured: Any = getattr(log, 'measured', None)
    if hasattr(measured, 'torque') and hasattr(log, 't'):  # a run of a simulation
        log = {'t': log.t, 'q': measured.q, 'qd': measured.qd, 'tau': measured.torque,
               'joints': getattr(log, 'joints', joints)}
    if isinstance(log, Mapping) and all(name in log for name in names):
        t, q, qd, tau = (log[name] for name in names)
        return t, *_in_order(log.get('joints'), joints, q, qd, tau)
    if hasattr(log, 'of_joints'):
        log = log.of_joints(joints)
    if all(hasattr(log, name) for name in names):
        return log.t, log.q, log.qd, log.tau
    if isinstance(log, (Mapping, str, os.PathLike)) or hasattr(log, 'columns'):
        raise ParameterError('t', log, 'learn(t, q, qd, tau), or a log with these four: '
                             'learn(read_log(...)) takes a file, a table or other names')
    return None


def breaks_of(log: Any) -> tuple[int, ...]:
    """Return the rows of a log that is given as a whole at which its clock was set back."""
    return tuple(getattr(log, 'breaks', ()))


def _in_order(stored: Any, joints: Sequence[str], *values: Any) -> tuple[Any, ...]:
    """Return columns, shape (N, n) each, in the order of an arm's joints.

    Args:
        stored: Names of the columns; in order where there are none.
        joints: Joints of the arm.
        values: Arrays with these columns; masks of masked arrays stay.

    Raises:
        LogError: no column has the name of a joint.
    """
    known = [] if stored is None else [str(name) for name in np.atleast_1d(stored)]
    if known in ([], list(joints)):
        return values
    places = joint_places(joints, known)
    if places is None:
        raise LogError(f'the log is of {", ".join(known)}, the arm has {", ".join(joints)}')
    return tuple(np.asanyarray(each)[:, places] for each in values)
