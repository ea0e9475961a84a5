# SPDX-License-Identifier: Apache-2.0
"""The results of a campaign on disk: one file for each chunk, written when it is done.

A chunk's file is written beside its place and then renamed: it is there as a whole or not at all,
so that a killed campaign goes on with the chunks that are missing. The folder ``results`` is a
data set as pandas, Polars and Arrow read it.
"""

from __future__ import annotations

from collections.abc import Sequence
import csv
from dataclasses import fields
from importlib import util
import json
import os
from pathlib import Path
import shutil
from typing import Any

from adaptive_blf_control.campaigns.campaign import Campaign
from adaptive_blf_control.campaigns.outcome import Outcome
from adaptive_blf_control.errors import BlfError, ParameterError

__all__ = ['ResultFolder']

DESCRIPTION = 'campaign.json'
CELL, COLUMN = 24, 500  # bytes of a value, and of a column of a file, at most
Row = dict[str, Any]


class ResultFolder:
    """The folder of one campaign."""

    def __init__(self, folder: Path, campaign: Campaign, resume: bool) -> None:
        """Make the folder, or find it with the results of the same campaign.

        Args:
            folder: Where.
            campaign: What is run.
            resume: Whether results that are there are kept; otherwise there may be none.

        Raises:
            ParameterError: there are results, and they are another campaign's or shall not stay.
            BlfError: the folder cannot be written.
        """
        self.folder = folder
        self.campaign = campaign
        self._parts = folder / 'results'
        self._kind = 'parquet' if util.find_spec('pyarrow') else 'csv'
        description = folder / DESCRIPTION
        try:
            if description.is_file():
                self._known(description, resume)
            elif folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
                raise ParameterError('--output', str(folder), 'a new or empty folder')
            self._check_room()
            self._parts.mkdir(parents=True, exist_ok=True)
            if not description.is_file():
                self._write(description, json.dumps({
                    'identity': campaign.identity, 'kind': self._kind, 'config': campaign.config,
                    'runs': campaign.runs, 'seed': campaign.seed, 'duration': campaign.duration,
                    'chunk': campaign.chunk, 'vary': campaign.given, 'scenario': campaign.data,
                }, indent=2, default=str))
        except OSError as error:
            raise BlfError(f'{folder}: cannot be written: {error.strerror or error}') from None

    def _check_room(self) -> None:
        """Refuse a disk that the results will not fit on."""
        there = next(each for each in (self.folder, *self.folder.absolute().parents)
                     if each.is_dir())
        columns = len(fields(Outcome)) + len(self.campaign.drawn.shown)
        needed = columns * (CELL * self.campaign.runs + COLUMN * len(self.campaign.chunks))
        free = shutil.disk_usage(there).free
        if free < needed:
            raise BlfError(f'{self.folder}: {free / 1e6:.1f} MB are free on this disk, the '
                           f'results of {self.campaign.runs} runs may need {needed / 1e6:.1f} MB')

    def _known(self, description: Path, resume: bool) -> None:
        """Check that the results of this folder are this campaign's and may stay."""
        folder = str(self.folder)
        try:
            known = json.loads(description.read_text(encoding='utf-8'))
            identity, self._kind = known['identity'], known['kind']
        except (ValueError, KeyError, TypeError):
            raise ParameterError('--output', folder,
                                 f'a folder whose {DESCRIPTION} can be read') from None
        if identity != self.campaign.identity:
            raise ParameterError('--output', folder, 'another folder: it has the results of '
                                 'another campaign (scenario, variations, runs, seed, duration '
                                 'or chunk differ)')
        if not resume:
            raise ParameterError('--output', folder,
                                 'another folder, or --resume to go on with these results')
        if self._kind == 'parquet' and not util.find_spec('pyarrow'):
            raise ParameterError('--output', folder, 'pyarrow installed: the results there are '
                                 'Parquet files')

    def missing(self) -> list[int]:
        """Return the numbers of the chunks that have no results yet."""
        return [number for number in range(len(self.campaign.chunks))
                if not self._part(number).is_file()]

    def add(self, number: int, outcomes: Sequence[Outcome]) -> None:
        """Write the results of a chunk: each outcome, and what varied.

        Raises:
            BlfError: they cannot be written; those of other chunks are kept.
        """
        varied = self.campaign.drawn.shown
        rows = [{**outcome.row(), **{name: values[outcome.run] for name, values in varied.items()}}
                for outcome in outcomes]
        try:
            self._write_part(self._part(number), rows)
        except OSError as error:
            raise BlfError(f'{self._part(number)}: cannot be written: {error.strerror or error}; '
                           f'what is there is kept, --resume goes on') from None

    def rows(self) -> list[Row]:
        """Return all results, in the order of the runs.

        Raises:
            BlfError: a file cannot be read.
        """
        rows: list[Row] = []
        for number in range(len(self.campaign.chunks)):
            part = self._part(number)
            if part.is_file():
                try:
                    rows += _read(part)
                except (OSError, ValueError) as error:
                    raise BlfError(f'{part}: cannot be read ({error}): remove it, --resume runs '
                                   f'it again') from None
        return rows

    def _part(self, number: int) -> Path:
        return self._parts / f'part-{number:06d}.{self._kind}'

    def _write_part(self, path: Path, rows: Sequence[Row]) -> None:
        aside = path.with_name(f'.{path.name}.{os.getpid()}')
        try:
            if self._kind == 'parquet':
                import pyarrow
                import pyarrow.parquet
                pyarrow.parquet.write_table(pyarrow.Table.from_pylist(list(rows)), aside)
            else:
                with aside.open('w', encoding='utf-8', newline='') as file:
                    writer = csv.DictWriter(file, fieldnames=list(rows[0]))
                    writer.writeheader()
                    writer.writerows(rows)
            aside.replace(path)
        finally:
            aside.unlink(missing_ok=True)

    @staticmethod
    def _write(path: Path, text: str) -> None:
        aside = path.with_name(f'.{path.name}.{os.getpid()}')
        aside.write_text(text, encoding='utf-8')
        aside.replace(path)


def _read(path: Path) -> list[Row]:
    if path.suffix == '.parquet':
        import pyarrow.parquet
        return list(pyarrow.parquet.read_table(path).to_pylist())
    with path.open(encoding='utf-8', newline='') as file:
        return [{name: _value(text) for name, text in row.items()}
                for row in csv.DictReader(file)]


def _value(text: str) -> Any:
    """Return what a cell of a CSV file holds: a bool, an integer, a float or text."""
    if text in ('True', 'False'):
        return text == 'True'
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text
