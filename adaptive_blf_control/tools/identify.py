# SPDX-License-Identifier: Apache-2.0
"""``identify LOG --urdf FILE``: learn a measured robot's parameters from its log, in one pass.

The log is streamed through the very objects of the identifier node: no look-ahead, one sample
after the other. Before and after the training span, θ̂ is frozen and the samples are only filtered.
"""

from __future__ import annotations

import argparse
import copy
import json
from pathlib import Path
import sys
from typing import Any

from adaptive_blf_control.arms.urdf_export import ExportedUrdf
from adaptive_blf_control.compilation_notice import CompilationNotice
from adaptive_blf_control.configuration.node_settings import IdentifierNodeSettings
from adaptive_blf_control.configuration.parameter_file import (
    apply_settings,
    given_values,
    load_yaml,
    node_settings,
)
from adaptive_blf_control.errors import BlfError, ParameterError
from adaptive_blf_control.identification.estimate_file import write_estimate
from adaptive_blf_control.report.identification_page import identification_page
from adaptive_blf_control.report.identification_panels import identification_sections
from adaptive_blf_control.report.png import write_png
from adaptive_blf_control.runs.identification import Identification, identify
from adaptive_blf_control.runs.log_report import table
from adaptive_blf_control.runs.model_report import parameter_table
from adaptive_blf_control.runs.rmse_requirement import RmseRequirement
from adaptive_blf_control.runs.subject import joints_of, REAL_ROBOT
from adaptive_blf_control.spelling import argument, as_command
from adaptive_blf_control.tools.identify_load import (
    add_load_arguments,
    asks_for_load,
    show_load,
)
from adaptive_blf_control.tools.log_arguments import add_log_arguments, log_options
from adaptive_blf_control.tools.output_files import check_writable, write_output
from adaptive_blf_control.tools.progress_bar import ProgressBar

__all__ = ['main']

_ARMS = ('the arm is that of a URDF, --urdf FILE, or one in closed form, --set arm=two_link or '
         '--set arm=three_link')


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='identify', description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('log', type=Path, nargs='+', metavar='LOG',
                        help='a bag (rosbag2 folder, .mcap or .db3) with JointState or '
                        'DynamicJointState, or CSV with a header such as t,q1..,qd1..,tau1.. [s, '
                        'rad, rad/s, N·m]; all of several are learned from')
    parser.add_argument('--validate', type=Path, action='append', default=[], metavar='LOG',
                        help='another log to predict; the first are then learned from as a whole')
    parser.add_argument('--urdf', metavar='FILE', help='path or package://... of the robot')
    parser.add_argument('--joints', metavar='A,B,...',
                        help="joints to identify, the others are locked; default: the config's, "
                        "else the URDF's. For CSV: the names of its columns, in order")
    parser.add_argument('--train', metavar='T0:T1',
                        help='span to learn from [s]; either end may be left out. Default: the '
                        'first half of the log after five time constants of the filter')
    parser.add_argument('--test', metavar='T0:T1',
                        help='span to predict with θ̂ frozen [s]; default: the rest of the log '
                        'after the training span; none to learn without one, e.g. with --train : '
                        'from the whole log')
    parser.add_argument('--config', type=Path, metavar='FILE',
                        help='parameter file, e.g. config/panda_identification.yaml')
    parser.add_argument('--set', action='append', default=[], metavar='NAME=VALUE',
                        dest='settings', help='change a parameter, e.g. history.size=200')
    parser.add_argument('--json', action='store_true', help='print the figures as JSON')
    parser.add_argument('--output', type=Path, metavar='FILE',
                        help='where θ̂ is written; default: the parameter estimate_file, else '
                        'theta_hat.yaml in the present folder')
    parser.add_argument('--model-out', type=Path, metavar='FILE',
                        help='where the parameters of the physically consistent model are '
                        'written, in the form of --output')
    parser.add_argument('--urdf-out', type=Path, metavar='FILE',
                        help='where the URDF is written with identified inertials and friction, '
                        'those of the consistent model; the rest of it is untouched')
    parser.add_argument('--html', type=Path, metavar='FILE',
                        help='a page: torques, residuals, intervals, what the log determines')
    parser.add_argument('--png', type=Path, metavar='DIR',
                        help='the plots of that page as pictures for papers')
    parser.add_argument('--overwrite', action='store_true',
                        help='replace files that exist')
    parser.add_argument('--require-rmse', metavar='E',
                        help='exit with 1 where the RMSE of a joint in the test is more: N·m, or '
                        'a part of its torque as in 5%%')
    parser.add_argument('--parameters', action='store_true',
                        help='also print every parameter with its standard deviation and whether '
                        'the log determines it')
    add_load_arguments(parser)
    add_log_arguments(parser)
    return parser


def _arguments(args: list[str] | None) -> argparse.Namespace:
    parser = _parser()
    options, others = parser.parse_known_args(args)
    if others and options.joints is not None and not any(each.startswith('-') for each in others):
        parser.error('--joints takes one word: expected --joints '
                     + ','.join([options.joints.rstrip(','), *others]))
    if any(each.partition('=')[0] == '--arm' for each in others):
        parser.error(_ARMS)
    return parser.parse_args(args)


def _settings(options: argparse.Namespace) -> IdentifierNodeSettings:
    """Return the identifier's settings: from the file (or `REAL_ROBOT`), then the options."""
    data = load_yaml(options.config, '--config') if options.config else {
        '/**/identifier': {'ros__parameters': copy.deepcopy(REAL_ROBOT)}}
    data = apply_settings(data, options.settings)
    settings = node_settings(data, IdentifierNodeSettings)
    if options.urdf in ('two_link', 'three_link') and not Path(options.urdf).exists():
        raise ParameterError('--urdf', options.urdf, f'a file: {_ARMS}')
    if options.urdf is not None:
        settings = settings.replace(arm='urdf', urdf=options.urdf)
    if settings.arm == 'urdf' and (not settings.urdf or settings.urdf.startswith('topic:')):
        raise ParameterError('urdf', settings.urdf, 'a file: name one with --urdf FILE')
    if options.joints is not None:
        return settings.replace(joints=[name.strip() for name in options.joints.split(',')])
    if settings.arm == 'urdf' and 'joints' not in given_values(data, 'identifier'):
        return settings.replace(joints=joints_of(settings.urdf))
    return settings


def _identify(options: argparse.Namespace) -> dict[str, Any]:
    settings = _settings(options)
    output = options.output or Path(settings.estimate_file or 'theta_hat.yaml')
    check_writable({'--output': output, '--model-out': options.model_out,
                    '--urdf-out': options.urdf_out, '--html': options.html,
                    '--png': options.png}, options.overwrite)
    if options.urdf_out is not None and options.urdf_out.resolve() == Path(
            options.urdf or settings.urdf).resolve():
        raise ParameterError('--urdf-out', str(options.urdf_out), 'another file than --urdf')
    try:
        with ProgressBar('sample') as progress:
            result = identify(options.log, settings=settings, train=options.train,
                              test=options.test, validate=options.validate or None,
                              options=log_options(options), progress=progress)
    except ParameterError as error:
        if error.name not in ('train', 'test', 'gain', 'effort_delay', 'urdf', 'topic', 'columns'):
            raise
        raise ParameterError(argument(error.name), error.value, error.expected) from None
    for text in filter(None, (result.problem, *result.notes)):
        print(f'identify: note: {text}', file=sys.stderr)
    for finding in result.findings:
        print(f'identify: {finding.level}: {finding}', file=sys.stderr)
    figures = {**result.figures, 'output': str(output)}
    snapshot = result.identifier.snapshot()
    # What cannot be had is said before anything is written.
    model = None if options.model_out is None else result.consistent
    exported = None if options.urdf_out is None else result.urdf()
    write_output('--output', output, lambda path: write_estimate(path, snapshot, std=result.std))
    if model is not None:
        consistent = snapshot._replace(theta=model.theta)
        write_output('--model-out', options.model_out,
                     lambda path: write_estimate(path, consistent, std=model.std))
        figures['model_output'] = str(options.model_out)
    if exported is not None:
        figures |= _write_urdf(exported, options.urdf_out)
    _write_pages(result, options)
    return figures


def _write_pages(result: Identification, options: argparse.Namespace) -> None:
    if options.html is not None:
        write_output('--html', options.html, identification_page(result))
    if options.png is not None:
        write_output('--png', options.png,
                     lambda path: write_png(path, identification_sections(result)))


def _write_urdf(exported: ExportedUrdf, path: Path) -> dict[str, Any]:
    """Write the URDF and say what of the model is not in it."""
    write_output('--urdf-out', path, exported.xml)
    lost = sorted({name.partition('_')[0] for name, value in exported.missing.items() if value})
    if lost:
        print(f'identify: {path}: a URDF has no place for {", ".join(lost)} (rotor inertia, '
              'constant torque, square-root friction): they are in the file of --model-out',
              file=sys.stderr)
    if exported.scaled:
        print(f'identify: {path}: scaled down with the link that carries them: '
              + ', '.join(f'{link} to {factor:.2g}' for link, factor in exported.scaled.items()),
              file=sys.stderr)
    return {'urdf_output': str(path), 'urdf_missing': exported.missing,
            'urdf_scaled': exported.scaled}


def main(args: list[str] | None = None) -> int:
    """Run the command; 0 if parameters were learned, 2 on bad input.

    1 where they were learned, but not as well as ``--require-rmse`` asks for.
    """
    options = _arguments(args)
    try:
        required = RmseRequirement.of(options.require_rmse) if options.require_rmse else None
        with CompilationNotice(), as_command():
            if asks_for_load(options):
                show_load(options, _settings(options), log_options(options))
                return 0
            figures = _identify(options)
    except BlfError as error:
        print(f'identify: {" ".join(str(error).split())}', file=sys.stderr)
        return 2
    print(json.dumps(figures, indent=2) if options.json else
          table(figures, ', '.join(map(str, options.log))))
    if options.parameters and not options.json:
        print('\n' + parameter_table(figures))
    missed = required.missed(figures) if required else []
    for text in missed:
        print(f'identify: --require-rmse {options.require_rmse} is missed: {text}',
              file=sys.stderr)
    return 1 if missed else 0


if __name__ == '__main__':
    sys.exit(main())
