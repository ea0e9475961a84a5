# SPDX-License-Identifier: Apache-2.0
"""Times of a log that are written as dates, as times of the day or with their unit."""

from __future__ import annotations

import datetime
import re

from adaptive_blf_control.time_units import UNITS

__all__ = ['nanoseconds_of']

_MONTHS = {name: number for number, name in enumerate(
    ('jan', 'feb', 'mar', 'apr', 'may', 'jun', 'jul', 'aug', 'sep', 'oct', 'nov', 'dec'), 1)}
_CLOCK = re.compile(
    r'(?:(?:(?P<year>\d{4})[-/](?P<month>\d\d?)[-/](?P<day>\d\d?)'  # ISO 8601
    r'|(?P<day_first>\d\d?)[- ](?P<name>[a-z]{3})[a-z]*[- ](?P<year_last>\d{4}))(?:t|,?\s+))?'
    r'(?P<hours>\d+):(?P<minutes>[0-5]?\d):(?P<seconds>[0-5]?\d)(?:[.,](?P<part>\d+))?'
    r'\s*(?:z|utc|gmt|[-+]\d\d:?\d\d)?')
_WITH_UNIT = re.compile(r'(?P<number>\d+(?:[.,]\d*)?(?:e[-+]?\d+)?)\s*'
                        r'(?P<unit>ns|us|µs|ms|s|secs?|seconds?)')


def nanoseconds_of(cell: str) -> int | None:
    """Return the time that a cell has in words: since 1970, since midnight, or since any start.

    ``2024-05-01T12:00:00.5Z``, ``01-May-2024 12:00:00.5``, ``12:00:00.5``, ``0.5 sec``. A zone is
    left out, as one log has one.

    Returns:
        The time [ns]; None where there is none, or a number alone.
    """
    text = cell.strip().strip('\'"').lower()
    if match := _WITH_UNIT.fullmatch(text):
        unit = match['unit'].replace('µ', 'u')
        return round(float(match['number'].replace(',', '.'))
                     * (UNITS['ns'] / UNITS.get(unit, 1.0)))
    match = _CLOCK.fullmatch(text)
    if match is None:
        return None
    days = 0
    if match['name'] or match['month']:
        try:
            date = datetime.date(int(match['year'] or match['year_last']),
                                 int(match['month'] or _MONTHS.get(match['name'], 0)),
                                 int(match['day'] or match['day_first']))
        except ValueError:  # the 31st of June
            return None
        days = (date - datetime.date(1970, 1, 1)).days
    hours = 24 * days + int(match['hours'])
    seconds = 60 * (60 * hours + int(match['minutes'])) + int(match['seconds'])
    return 10**9 * seconds + int((match['part'] or '0')[:9].ljust(9, '0'))
