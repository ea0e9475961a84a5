# SPDX-License-Identifier: Apache-2.0
"""A campaign: a scenario, what varies in it, and how its runs are cut into chunks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
import functools
import hashlib
import json
import math
import shlex
from typing import Any

from adaptive_blf_control.campaigns.variations import draw, Drawn, variations
from adaptive_blf_control.configuration.build_closed_loop import build_closed_loop
from adaptive_blf_control.configuration.node_settings import DriverSettings
from adaptive_blf_control.configuration.parameter_file import node_settings
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.simulation.closed_loop import ClosedLoop

__all__ = ['Campaign', 'LARGEST', 'setting_text', 'usual_chunk']

LARGEST = 1_000_000
CHUNK_SAMPLES = 200_000  # half a second or more, of which giving a chunk to a worker takes 3 ms
CHUNKS = 16  # at least so many where there are enough runs, for the workers to share


@dataclass(frozen=True)
class Campaign:
    """What is run; two campaigns with the same fields have the same outcomes.

    Attributes:
        config: Name of the scenario's parameter file, for the commands that repeat a run.
        data: Its contents.
        given: Those of the file that says what varies.
        runs: Number of runs.
        seed: Of everything that is drawn.
        duration: Length of each run [s].
        chunk: Runs that one worker does at a time.
        settings: What ``--set`` changed in ``data``, for the commands that repeat a run.
    """

    config: str
    data: Mapping[str, Any]
    given: Mapping[str, Any]
    runs: int
    seed: int
    duration: float
    chunk: int
    settings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name, value, largest in (('--runs', self.runs, LARGEST), ('--chunk', self.chunk,
                                                                     LARGEST)):
            if not 1 <= value <= largest:
                raise ParameterError(name, value, f'1 to {largest}')
        if self.seed < 0:
            raise ParameterError('--seed', self.seed, 'an integer >= 0')

    @property
    def changes(self) -> list[dict[str, Any]]:
        """The parameters of each run that differ from the scenario, by name."""
        return self.drawn.changes

    @functools.cached_property
    def drawn(self) -> Drawn:
        """What was drawn for all runs.

        Raises:
            ParameterError: a parameter is not known, or takes no value that was drawn.
        """
        return draw(variations(self.given, self.data), self.runs, self.seed,
                    self.given.get('sampling', 'independent'))

    def check(self) -> ClosedLoop:
        """Draw everything; return the scenario as it is without variations, ready to run.

        Raises:
            BlfError: the scenario cannot be run, or what varies does not fit it.
        """
        _ = self.drawn
        loop = build_closed_loop(self.data)
        loop.warm_up()
        return loop

    @property
    def chunks(self) -> list[range]:
        """The numbers of the runs of each chunk."""
        return [range(first, min(first + self.chunk, self.runs))
                for first in range(0, self.runs, self.chunk)]

    @property
    def identity(self) -> str:
        """A digest of everything that decides over the outcomes."""
        text = json.dumps([self.data, self.given, self.runs, self.seed, self.duration, self.chunk],
                          sort_keys=True, default=str)
        return hashlib.sha256(text.encode()).hexdigest()

    def command(self, run: int) -> str:
        """Return the command that repeats a run exactly."""
        settings = [*self.settings, *(f'{name}={setting_text(value)}'
                                      for name, value in self.changes[run].items())]
        return ' '.join(['python -m adaptive_blf_control simulate', shlex.quote(self.config),
                         f'--duration {self.duration!r}',
                         *(f'--set {shlex.quote(setting)}' for setting in settings)])


def usual_chunk(data: Mapping[str, Any], runs: int, duration: float) -> int:
    """Return how many runs a worker is to do at a time.

    So many that handing them out takes less than 1 % of the time, as far as there are enough runs.

    Args:
        data: The scenario's parameter file.
        runs: All runs of the campaign.
        duration: Length of each [s].
    """
    samples = duration * node_settings(data, DriverSettings).rate
    return max(min(math.ceil(CHUNK_SAMPLES / samples), runs // CHUNKS), 1)


def setting_text(value: Any) -> str:
    """Return a value as YAML 1.1 reads it back exactly: it wants a dot before an exponent."""
    if isinstance(value, list):
        return f'[{", ".join(map(setting_text, value))}]'
    if isinstance(value, float):
        mantissa, e, exponent = repr(value).partition('e')
        return mantissa + '.0' * (bool(e) and '.' not in mantissa) + e + exponent
    return str(value)
