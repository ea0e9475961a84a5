# SPDX-License-Identifier: Apache-2.0
"""``identify`` with a load: find it beside a model, or find gains of drives with a known one."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
import sys
from typing import Any

from adaptive_blf_control.configuration.node_settings import IdentifierNodeSettings
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.runs.gain_logs import gain_figures, gain_table
from adaptive_blf_control.runs.load_log import load_figures, load_table
from adaptive_blf_control.runs.log_options import LogOptions

__all__ = ['add_load_arguments', 'asks_for_load', 'show_load']

_OPTIONS = {'identifier.payload.baseline': '--payload', 'payload.frame': '--payload-frame',
            'identifier.payload.frame': '--payload-frame', 'known_load': '--known-load',
            'gain': '--gain'}
_OF_LEARNING = ('validate', 'train', 'test', 'output', 'model_out', 'urdf_out', 'html', 'png',
                'require_rmse', 'parameters')  # options that do nothing here


def add_load_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that `show_load` reads."""
    group = parser.add_argument_group('a load')
    group.add_argument('--payload', metavar='BASELINE',
                       help='find the load of the log beside the robot without it: nominal (the '
                       "URDF's), or a file of --output or --model-out (better)")
    group.add_argument('--payload-frame', metavar='LINK',
                       help='link of the URDF that carries the load and in whose frame it is')
    group.add_argument('--estimate-gains', type=Path, action='append', metavar='LOADED',
                       help='a log with the load of --known-load; what the efforts of LOG, which '
                       'is without, have to be multiplied with is estimated')
    group.add_argument('--known-load', metavar='M[,X,Y,Z[,Ixx,Ixy,Iyy,Ixz,Iyz,Izz]]',
                       help='its mass [kg], centre of mass [m] and inertia about that [kg·m²]')


def asks_for_load(options: argparse.Namespace) -> bool:
    """Return whether one of these was given that ask for something."""
    return options.payload is not None or bool(options.estimate_gains)


def show_load(options: argparse.Namespace, settings: IdentifierNodeSettings,
              reading: LogOptions) -> None:
    """Print what is asked for.

    Raises:
        BlfError: something that was given cannot be used.
    """
    for name in _OF_LEARNING:
        if getattr(options, name):
            raise ParameterError(f'--{name.replace("_", "-")}', str(getattr(options, name)),
                                 'nothing beside --payload or --estimate-gains: no model is '
                                 'learned, and of a log all is used')
    if options.payload_frame is not None:
        settings = settings.replace(**{'payload.frame': options.payload_frame})
    try:
        figures, text = (_gains if options.estimate_gains else _load)(options, settings, reading)
    except ParameterError as error:
        option = _OPTIONS.get(error.name)
        if option is None:
            raise
        raise ParameterError(option, error.value, error.expected) from None
    for line in (*figures['findings'], *(f'note: {note}' for note in figures['notes'])):
        print(f'identify: {line}', file=sys.stderr)
    print(json.dumps(figures, indent=2) if options.json else text)


def _load(options: argparse.Namespace, settings: IdentifierNodeSettings,
          reading: LogOptions) -> tuple[dict[str, Any], str]:
    if len(options.log) != 1:
        raise ParameterError('--payload', options.payload, f'one log, not {len(options.log)}')
    settings = settings.replace(**{'payload.baseline': options.payload})
    figures = load_figures(options.log[0], settings, reading)
    return figures, load_table(figures)


def _gains(options: argparse.Namespace, settings: IdentifierNodeSettings,
           reading: LogOptions) -> tuple[dict[str, Any], str]:
    if options.payload is not None:
        raise ParameterError('--estimate-gains', str(options.estimate_gains[0]),
                             'no --payload beside it: the load is known')
    try:
        known = [float(part) for part in (options.known_load or '').split(',')]
    except ValueError:
        raise ParameterError('--known-load', options.known_load,
                             'the mass [kg] of the load, e.g. 2.5') from None
    figures = gain_figures(options.log, options.estimate_gains, known, settings, reading)
    return figures, gain_table(figures)
