# SPDX-License-Identifier: Apache-2.0
"""Gains of the drives from logs without and with a known load."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from adaptive_blf_control.arms.base_parameters import PER_BODY
from adaptive_blf_control.arms.load_frame import load_map
from adaptive_blf_control.bags.logs import Log
from adaptive_blf_control.configuration.node_settings import IdentifierNodeSettings
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.drive_gains import drive_gains, LoadedPairs
from adaptive_blf_control.identification.uncertainty import NORMAL
from adaptive_blf_control.runs.log_options import LogOptions, name_of
from adaptive_blf_control.runs.log_pairs import LogPairs

__all__ = ['gain_figures', 'gain_table', 'inertial_of']

_SPACING = 0.5  # memories of the filters between pairs that are used
_PAUSE = 100.0  # memories of the filters from one log to the next


def inertial_of(known: Sequence[float]) -> np.ndarray:
    """Return the first of a load's ten inertial parameters at its frame, shape (1,), (4,), (10,).

    Args:
        known: Mass [kg], also centre of mass [m], also inertia about that in axes of the frame,
            Ixx, Ixy, Iyy, Ixz, Iyz, Izz [kg·m²].

    Raises:
        ParameterError: it has another length, or no mass.
    """
    values = np.array(known, dtype=float)
    if values.size not in (1, 4, PER_BODY) or not np.isfinite(values).all() or values[0] <= 0.0:
        raise ParameterError('known_load', list(known), 'a mass > 0 kg, or with three numbers of '
                             'its centre [m], or with six of its inertia too [kg·m²]')
    mass, com = values[0], values[1:4]
    if values.size == 1:
        return values
    steiner = mass * (com @ com * np.eye(3) - np.outer(com, com))
    return np.concatenate([[mass], mass * com, values[4:] + steiner[np.tril_indices(3)][
        :values.size - 4]])


def gain_figures(without: Sequence[Log], along: Sequence[Log], known: Sequence[float],
                 settings: IdentifierNodeSettings, options: LogOptions) -> dict[str, Any]:
    """Return by joint what efforts are to be multiplied with, with 95 % intervals.

    ``gain`` includes the gains that ``options`` gives; ``half_width`` is None where the logs do
    not determine a gain.

    Args:
        without: Logs without the load.
        along: Logs with it.
        known: What is known of the load, see `inertial_of`.
        settings: Those of the identifier, with its arm and ``payload.frame``.
        options: How logs are read.

    Raises:
        LogError: a log cannot be used, or no positive gains explain them.
        ParameterError: no such frame, or a load that cannot be.
        ArmError: no arm can be made of the URDF and the joints.
    """
    load = inertial_of(known)
    source = LogPairs(settings, options)
    columns = load_map(source.arm, settings.payload.frame)
    pairs = _pairs(source, without, along, columns)
    found = drive_gains(pairs, load, source.identifier.memory)
    given = np.array([options.gain.get(joint, 1.0) for joint in source.arm.joints])
    half = NORMAL * found.std * np.abs(given)
    return {
        'joints': list(source.arm.joints), 'frame': settings.payload.frame,
        'without': [name_of(log) for log in without], 'with': [name_of(log) for log in along],
        'gain': (found.gain * given).tolist(),
        'half_width': [float(each) if np.isfinite(each) else None for each in half],
        'load': found.load.tolist(),
        'notes': list(source.reader.notes),
        'findings': [f'{finding.level}: {finding}' for finding in source.reader.findings],
    }


def _pairs(source: LogPairs, without: Sequence[Log], along: Sequence[Log],
           columns: np.ndarray) -> LoadedPairs:
    """Return pairs of all logs, a part of the filters' memory apart."""
    memory = source.identifier.memory
    times: list[float] = []
    rows, carried = [], []
    begin = 0.0
    for log, loaded in [*((log, 0.0) for log in without), *((log, 1.0) for log in along)]:
        first = len(times)
        for block, pairs in source.of(log):
            for t, pair in zip((begin + block).tolist(), pairs, strict=True):
                if len(times) == first or t - times[-1] >= _SPACING * memory * (1.0 - 1e-9):
                    times.append(t)
                    rows.append(pair)
                    carried.append(loaded)
        begin = times[-1] + _PAUSE * memory
    table = np.array(rows)
    regressors = table[:, :, :-1]
    return LoadedPairs(regressors, table[:, :, -1],
                       regressors @ columns * np.array(carried)[:, None, None], np.array(times))


def gain_table(figures: dict[str, Any]) -> str:
    """Return the figures as a short table, and as options of `identify`."""
    lines = [f'gains from {", ".join(figures["without"])} and with the load at '
             f'{figures["frame"]} {", ".join(figures["with"])}', '',
             f'{"joint":<24}{"gain":>10}   95 % interval']
    for joint, gain, half in zip(figures['joints'], figures['gain'], figures['half_width'],
                                 strict=True):
        interval = 'not determined' if half is None else f'{gain - half:.4g} .. {gain + half:.4g}'
        lines.append(f'{joint:<24}{gain:>10.4g}   {interval}')
    return '\n'.join([*lines, '', '--gain ' + ','.join(
        f'{joint}:{gain:.5g}' for joint, gain in zip(figures['joints'], figures['gain']))])
