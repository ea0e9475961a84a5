# SPDX-License-Identifier: Apache-2.0
"""``report BAG...``: an HTML page, or figures for a paper, from bags alone.

Of an identification, by the page that ``identify --html`` wrote, it prints the figures.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import json
from pathlib import Path
import sys
from typing import Any

from adaptive_blf_control.compilation_notice import announce_compilation
from adaptive_blf_control.errors import BlfError, LogError
from adaptive_blf_control.report.page import page
from adaptive_blf_control.report.panels import sections
from adaptive_blf_control.report.png import write_png
from adaptive_blf_control.report.saved_identification import MAKES_PAGE, saved_identification
from adaptive_blf_control.runs.log_report import table
from adaptive_blf_control.runs.lyapunov import guarantee_of_recording
from adaptive_blf_control.runs.numbers import report_figures, verdict
from adaptive_blf_control.runs.recording import read_recording, Recording

__all__ = ['main', 'write_page']


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='report', description=__doc__)
    parser.add_argument('bags', nargs='+', metavar='BAG',
                        help='rosbag2 folder, .mcap or .db3 file; several are overlaid. Or pages '
                        'of identify --html')
    parser.add_argument('-o', '--output', type=Path, metavar='FILE.html',
                        help='the page (default: report.html, unless --png or --json is given)')
    parser.add_argument('--png', type=Path, metavar='DIR', help='one picture per plot')
    parser.add_argument('--json', action='store_true', help='print the numbers as JSON')
    return parser


def write_page(bags: Sequence[Path | str], output: Path) -> Path:
    """Write the page of some bags and return its path.

    Raises:
        BlfError: a bag cannot be read, or plotly is missing.
        OSError: the file cannot be written.
    """
    recordings = [read_recording(bag) for bag in bags]
    guaranteed = [guarantee_of_recording(recording) for recording in recordings]
    text = page(recordings, guaranteed, report_figures(recordings, guaranteed, {}))
    output.write_text(text, encoding='utf-8')
    return output


def _read(bags: Sequence[str]) -> tuple[list[Recording], dict[str, str]]:
    """Return the recordings that can be read, and the reasons why others cannot."""
    recordings, unreadable = [], {}
    for bag in bags:
        try:
            recordings.append(read_recording(bag))
        except BlfError as error:
            unreadable[bag] = str(error)
    return recordings, unreadable


def _show_identifications(found: dict[str, dict[str, Any]], options: argparse.Namespace) -> None:
    """Print the figures of identifications.

    Raises:
        LogError: something else is asked for.
    """
    if others := [path for path in options.bags if path not in found]:
        raise LogError(f'{others[0]} is no identification, and {next(iter(found))} is one: '
                       'expected one kind')
    if options.output is not None or options.png is not None:
        raise LogError(f'page and pictures of an identification come from its log: {MAKES_PAGE}')
    if options.json:
        print(json.dumps({'identifications': found}, indent=2, allow_nan=False))
    else:
        print('\n\n'.join(table(figures, figures.get('source', path))
                          for path, figures in found.items()))


def main(args: list[str] | None = None) -> int:
    """Run the command; 0 if something could be shown, 2 if not."""
    options = _parser().parse_args(args)
    announce_compilation()
    try:
        found = {bag: figures for bag in options.bags
                 if (figures := saved_identification(Path(bag))) is not None}
        if found:
            _show_identifications(found, options)
            return 0
    except LogError as error:
        print(f'report: {error}', file=sys.stderr)
        return 2
    recordings, unreadable = _read(options.bags)
    for reason in unreadable.values():
        print(f'report: {reason}', file=sys.stderr)
    if not recordings:
        return 2
    guaranteed = [guarantee_of_recording(recording) for recording in recordings]
    numbers = report_figures(recordings, guaranteed, unreadable)
    for bag in numbers['bags']:
        for problem in [*filter(None, [bag['problem']]),
                        *(f'{bag["name"]}: missing {item}' for item in bag['missing'])]:
            print(f'report: {problem}', file=sys.stderr)
    try:
        if options.png is not None:
            files = write_png(options.png, sections(recordings, guaranteed))
            print(f'{len(files)} pictures in {options.png}', file=sys.stderr)
        if options.output is not None or not (options.json or options.png):
            output = options.output or Path('report.html')
            output.write_text(page(recordings, guaranteed, numbers), encoding='utf-8')
            print(f'report: {output}', file=sys.stderr)
    except (BlfError, OSError) as error:
        print(f'report: {error}', file=sys.stderr)
        return 2
    if options.json:
        print(json.dumps(numbers, indent=2, allow_nan=False))
    else:
        for bag in numbers['bags']:
            _, head, sentences = verdict(bag)
            print(f'{bag["name"]}: {head.upper()}. {" ".join(sentences)}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
