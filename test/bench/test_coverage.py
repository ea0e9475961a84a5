# SPDX-License-Identifier: Apache-2.0
"""Facts about the study of how often intervals hold."""

from __future__ import annotations

from pathlib import Path

import pytest

from adaptive_blf_control.bench.coverage import coverage, STUDIES, Study
from adaptive_blf_control.errors import ParameterError

SHORT = Study('three_link_encoder', 3.0, 1.0, 2.0)


def test_runs_differ_and_most_intervals_hold(repository: Path) -> None:
    first, second = coverage(SHORT, repository / 'config', 2)
    assert first != second
    for held in (first, second):
        assert 0.5 <= held.theta <= 1.0
        assert 0.5 <= held.measured <= 1.0
        assert 0.0 < held.ratio < 5.0
    assert next(coverage(SHORT, repository / 'config', 1)) == first  # the same every time


def test_wrong_standard_deviations_show(repository: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Intervals a hundred times too narrow hold hardly ever."""
    monkeypatch.setattr('adaptive_blf_control.bench.coverage.NORMAL', 0.0196)
    held = next(coverage(SHORT, repository / 'config', 1))
    assert held.theta < 0.5


def test_a_time_without_a_pair_is_refused(repository: Path) -> None:
    with pytest.raises(ParameterError, match='train'):
        next(coverage(SHORT._replace(train=0.01, test=0.05), repository / 'config', 1))


def test_every_study_has_its_scenario(repository: Path) -> None:
    for study in STUDIES:
        assert (repository / f'config/{study.scenario}.yaml').exists()
