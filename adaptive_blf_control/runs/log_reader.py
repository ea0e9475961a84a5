# SPDX-License-Identifier: Apache-2.0
"""Logs become sections that can be streamed: read, checked, cut into spans."""

from __future__ import annotations

from collections.abc import Sequence

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.bags.logs import Log
from adaptive_blf_control.bags.measured_log import MeasuredLog
from adaptive_blf_control.configuration.node_settings import IdentifierNodeSettings
from adaptive_blf_control.errors import LogError
from adaptive_blf_control.identification.finding import Finding
from adaptive_blf_control.identification.log_checks import check_log, refuse, weightless_of
from adaptive_blf_control.runs.log_options import LogOptions, name_of, read_converted
from adaptive_blf_control.runs.log_pass import (
    check_rest,
    choose_spans,
    Given,
    NO_TEST,
    Section,
    Span,
)

__all__ = ['LogReader']

_SETTLED = 5.0  # memories of the filters until their start is forgotten


class LogReader:
    """Reads logs for one arm.

    Attributes:
        findings: What the checks have found, of all logs read so far.
        notes: What was assumed or is odd, in sentences.
    """

    def __init__(self, arm: Arm, settings: IdentifierNodeSettings, options: LogOptions,
                 filled: Sequence[str], memory: float) -> None:
        """Read for an arm.

        Args:
            arm: The arm.
            settings: Those of the identifier, and what the arm was made of.
            options: How logs are read.
            filled: Links of the URDF that have no mass of their own.
            memory: How long the filters remember a sample [s].
        """
        self._arm, self._settings, self._options = arm, settings, options
        self._described, self._settle = not filled, _SETTLED * memory
        self.findings: list[Finding] = []
        self.notes = [f'the URDF has no mass for {", ".join(filled)}: 1 kg is taken, which no '
                      'regressor depends on'] if filled else []

    def sections(self, logs: Sequence[Log], others: Sequence[Log], train: Given,
                 test: Given) -> list[Section]:
        """Return what is learned from and predicted of each log.

        Args:
            logs: Those to learn from.
            others: Those to predict as a whole; the first are then learned from as a whole,
                where no span is given.
            train: Span of each of the first, see `choose_spans`.
            test: Likewise; of the first only, and without others.

        Raises:
            LogError: a log cannot be read, cannot be right, or is too short.
            ParameterError: a span cannot be used.
        """
        if others:
            train, test = ':' if train is None else train, NO_TEST if test is None else test
        check_rest(train, test)
        made = []
        for source in logs:
            log = self._read(source)
            try:
                made.append(choose_spans(log, train, test, self._settle))
            except LogError as exc:
                raise LogError(f'{name_of(source)}: {exc}') from exc
            self.notes += made[-1].notes
        for source in others:
            log = self._read(source)
            made.append(Section(log, Span(0.0, 0.0), Span(float(log.t[0]), float(log.t[-1]))))
        return made

    def _read(self, source: Log) -> MeasuredLog:
        settings = self._settings
        filters = settings.filter
        log = read_converted(
            source, self._arm.joints, self._options,
            velocity=filters.state_order == 0 or filters.state_filter != 'low_pass')
        arm = self._arm
        found = check_log(log, arm, settings, weightless_of(arm), self._described)
        if not self._options.force:
            refuse(found, name_of(source))
        self.findings += found
        self.notes += log.notes
        return log
