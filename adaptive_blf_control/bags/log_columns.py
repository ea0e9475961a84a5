# SPDX-License-Identifier: Apache-2.0
"""Which columns of a log hold time, positions, velocities and torques, by their names."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
import re
from typing import NamedTuple

from adaptive_blf_control.errors import LogError
from adaptive_blf_control.spelling import argument, option, setting
from adaptive_blf_control.time_units import UNITS

__all__ = ['Columns', 'KINDS', 'find_columns', 'given_columns']

KINDS = {'q': 'position', 'qd': 'velocity', 'tau': 'effort'}
_WORDS = {
    'q': r'joint[_ ]?pos(?:itions?)?|positions?|q?pos|angles?|theta|θ|q|jp',
    'qd': r'joint[_ ]?vel(?:ocit(?:y|ies))?|velocit(?:y|ies)|q?vel|speeds?|omega|ω|q_?dot|qd|'
          r'dq|jv',
    'tau': r'joint[_ ]?(?:efforts?|torques?)|efforts?|eff|torques?|trq|tau(?:_?j)?|τ|moments?|'
           r'qfrc(?:_actuator)?',
    'current': r'currents?|curr?',
}
_KIND = '(?:act)?(?:' + '|'.join(f'(?P<{name}>{words})' for name, words in _WORDS.items()) + ')'
# Tried in this order: /joint_states/a/position, position[0], pos_a, position[a], a[position],
# a_pos, q.
_FORMS = tuple(re.compile(form.replace('KIND', f'(?:{_KIND})')) for form in (
    r'(?:.*/)?(?P<joint>[^/]+)/KIND', r'(?:.*[/._])?KIND[\[_./ -]*(?P<joint>\d+)\]?',
    r'(?:.*/)?KIND[_./ :-](?P<joint>[^/]+)',
    r'(?:.*[/._ ])?KIND\s*[\[({<]\s*(?P<joint>[^\[\](){}<>]+?)\s*[\])}>]',
    r'(?:.*/)?(?P<joint>[^/\[\](){}<>]+?)\s*[\[({<]\s*KIND\s*[\])}>]',
    r'(?:.*/)?(?P<joint>[^/]+)[_. :-]KIND', r'KIND'))
# The same in one spelling: q1dot, q̇1, position_rad_1, /a/state/position, /a/position/value.
_SPELLINGS = tuple((re.compile(form), plain) for form, plain in (
    (r'[_. ](?:meas(?:ured)?|actual|act|msr)$', ''), (r'/(?:value|data)$', ''),
    (r'/(?:states?|actual|measured|feedback|data)(?=/)', ''), ('[qθ]\u0307', 'qd'),
    (r'(?<![a-z])(?:q|theta|θ)_?(\d+)_?d(?:ot)?$', r'qd\1'),
    (r'_(?:(?:rad|deg(?:rees?)?)(?:_?(?:per_?)?s(?:ec)?)?|n_?m)(?=_|$)', '')))
_INNER = re.compile(r'.*[\[({<]\s*([^\[\](){}<>]+?)\s*[\])}>]')
# What was asked for, not what was measured.
_NOT_MEASURED = re.compile(r'(?:^|[/._ :-])(?:target|desired|des|reference|ref|command(?:ed)?|cmd|'
                           r'setpoint|goal|error|err)(?:$|[/._ :\[-])')
_GENERIC = re.compile(r'joint_?states?|joints?|states?|actual|measured|feedback|data')
_UNIT_NAMES = {'s': 's', 'sec': 's', 'secs': 's', 'seconds': 's', 'ms': 'ms', 'msec': 'ms',
               'msecs': 'ms', 'millis': 'ms', 'milliseconds': 'ms', 'us': 'us', 'µs': 'us',
               'usec': 'us', 'micros': 'us', 'microseconds': 'us', 'ns': 'ns', 'nsec': 'ns',
               'nsecs': 'ns', 'nanosec': 'ns', 'nanosecs': 'ns', 'nanoseconds': 'ns'}
_TIME = re.compile(r'(?:.*[/.])?_*(?:t|time|time[_ ]?stamp|receive[_ ]?time|stamp|'
                   r'elapsed(?:[_ ]?time)?|clock|'
                   rf'rosbagtimestamp|seconds|secs?)(?:_?(?P<unit>{"|".join(_UNIT_NAMES)}))?')
_ANGLE = re.compile(r'rad|deg|°')
_BRACKETS = re.compile(r'(.*?)\s*[\[(<]\s*([^\[\](){}<>]*?\D)\s*[\])>]\s*')


def _help() -> str:
    return 'name them with ' + option('columns', "{'t': ..., 'q': ..., 'qd': ..., 'tau': ...}",
                                      't=...,q=...,qd=...,tau=...')


class Columns(NamedTuple):
    """Where the values of a log are.

    Attributes:
        time: Index of the column of times; of seconds and nanoseconds where there are two.
        unit: Unit of the time where its name tells, or None.
        values: Indices by kind (q, qd, tau), as many as there are joints; qd is empty where
            velocities are not asked for.
        joints: Joint names where the columns have some, else None.
        notes: What was taken for something else, in sentences.
    """

    time: tuple[int, ...]
    unit: str | None
    values: Mapping[str, tuple[int, ...]]
    joints: tuple[str, ...] | None
    notes: tuple[str, ...]


_Found = dict[tuple[str, str], int]


def find_columns(header: Sequence[str], joints: Sequence[str] | None, *, velocity: bool,
                 given: Mapping[str, str] | None = None) -> Columns:
    """Find the columns of a log.

    Args:
        header: Names of the columns.
        joints: Joints of the arm, or None.
        velocity: Whether columns of velocities are needed; where not, they are not looked for.
        given: Columns by kind, as `given_columns` returns them; others are recognised.

    Raises:
        LogError: says which columns are missing, double or of other joints.
    """
    names = [name.strip().lower() for name in header]
    found, notes = _recognised(names)
    time, unit = _time(names)
    for kind, column in (given or {}).items():
        if kind == 't':
            time, unit = _chosen_time(header, column)
        else:
            found = _chosen(found, header, kind, column)
    ids = _joint_ids(found, names, joints, velocity)
    kinds = [kind for kind in KINDS if velocity or kind != 'qd']
    missing = ['t'] if not time else []
    for kind in kinds:
        missing += [_shown(kind, joint) for joint in ids or ['1'] if (kind, joint) not in found]
    if ids and not any(kind == 'tau' for kind, _ in found):
        raise LogError(f'no effort: expected columns tau1..tau{len(ids)} [N·m]: {_help()}')
    if missing:
        raise LogError(f'missing column {", ".join(missing)}: expected a header '
                       f't,q1..,qd1..,tau1..: {_help()}' + _without_velocity(missing))
    numbered = all(joint.isdecimal() for joint in ids)
    named = tuple(joints) if joints and not numbered else tuple(ids)
    return Columns(time, unit, {kind: tuple(found[kind, joint] for joint in ids)
                                if kind in kinds else () for kind in KINDS},
                   None if numbered else named, tuple(notes))


def given_columns(text: str) -> dict[str, str]:
    """Read ``t=stamp,q=pos_*,qd=2..8`` into columns by kind; see `find_columns`.

    Keys are t, q, qd and tau, the last three also with the number of a joint, as in ``q1``. In a
    column ``*`` stands for the joint; numbers count the columns from 1. The unit of the time may
    stand in brackets: ``t=stamp[ms]``.

    Raises:
        LogError: names the part that cannot be read.
    """
    parts = {}
    for part in text.split(','):
        key, equals, column = part.strip().partition('=')
        if not equals or not column or not re.fullmatch(r't|(q|qd|tau)\d*', key):
            raise LogError(f'{argument("columns")} has the part {part!r}: expected KIND=COLUMN '
                           'with t, q, qd or tau')
        parts[key] = column.strip()
    return parts


def _recognised(names: Sequence[str]) -> tuple[_Found, list[str]]:
    found: _Found = {}
    plain = Counter(_without_unit(name)[0] for name in names)
    for index, name in enumerate(names):
        without, unit = _without_unit(name)
        # What differs in brackets is no unit but the joint: position[a], position[b].
        told = name if plain[without] > 1 and not _ANGLE.match(unit) else without
        hit = None if _NOT_MEASURED.search(name) else _kind_and_joint(told)
        if hit is None:
            continue
        if hit in found:
            other = names[found[hit]]
            raise LogError(f'column {name!r} occurs more than once' if other == name else
                           f'columns {other!r} and {name!r} both look like the '
                           f'{KINDS.get(hit[0], hit[0])} of joint {hit[1]!r}: {_help()}')
        found[hit] = index
    currents = {joint: index for (kind, joint), index in found.items() if kind == 'current'}
    notes = []
    if currents and not any(kind == 'tau' for kind, _ in found):
        found.update({('tau', joint): index for joint, index in currents.items()})
        notes.append('currents are taken for the effort: '
                     + option('gain', "{'JOINT': K}", 'JOINT:K') + ' multiplies by K N·m/A')
    return {hit: index for hit, index in found.items() if hit[0] in KINDS}, notes


def _kind_and_joint(name: str) -> tuple[str, str] | None:
    for spelling, plain in _SPELLINGS:
        name = spelling.sub(plain, name)
    for form in _FORMS:
        match = form.fullmatch(name)
        if match is None:
            continue
        joint = match.groupdict().get('joint') or '1'
        if inner := _INNER.fullmatch(joint):  # joint_states[a].position
            joint = inner[1]
        if _GENERIC.fullmatch(joint):
            continue
        kind = next(kind for kind in _WORDS if match[kind])
        return kind, str(int(joint)) if joint.isdecimal() else joint.strip('_. ')
    return None


def _without_unit(name: str) -> tuple[str, str]:
    """Split ``time [ms]`` into the name and the unit; the brackets of ``q[0]`` stay."""
    match = _BRACKETS.fullmatch(name)
    return (match[1], match[2]) if match else (name, '')


def _time(names: Sequence[str]) -> tuple[tuple[int, ...], str | None]:
    """Return where the time is, and its unit where the name tells."""
    candidates = []
    for index, name in enumerate(names):
        plain, unit = _without_unit(name.lstrip('%'))
        match = _TIME.fullmatch(plain)
        if match:
            exact = ('__time', 't', 'time').index(plain) if plain in ('__time', 't', 'time') else 9
            candidates.append((exact, index, _UNIT_NAMES.get(match['unit'] or unit)))
    pair = [next((i for i, name in enumerate(names) if re.fullmatch(form, name)), None)
            for form in (r'(?:.*[/._])?secs?', r'(?:.*[/._])?n(?:ano)?secs?')]
    best = min(candidates, default=None)
    if None not in pair and (best is None or best[0] == 9):
        return tuple(index for index in pair if index is not None), 's'
    return ((), None) if best is None else ((best[1],), best[2])


def _chosen_time(header: Sequence[str], column: str) -> tuple[tuple[int, ...], str | None]:
    if column in header:
        return (header.index(column),), _time([column.lower()])[1]
    plain, unit = _without_unit(column)
    if unit and _UNIT_NAMES.get(unit.lower()) not in UNITS:
        raise LogError(f'{argument("columns")} has the unit {unit!r} of time: expected s, ms, us '
                       'or ns')
    index = _index(header, plain)
    return (index,), _UNIT_NAMES.get(unit.lower()) or _time([header[index].lower()])[1]


def _chosen(found: _Found, header: Sequence[str], kind: str, column: str) -> _Found:
    """Replace the columns of a kind, or of one joint of it, by those that a user names."""
    match = re.fullmatch(r'(\D+)(\d*)', kind)
    assert match is not None  # given_columns has checked it
    kind, number = match.groups()
    if number:
        return found | {(kind, number): _index(header, column)}
    kept = {hit: index for hit, index in found.items() if hit[0] != kind}
    numbers = re.fullmatch(r'(\d+)(?:\.\.(\d+))?', column)
    if '*' in column:
        form = re.compile('(.+)'.join(map(re.escape, column.split('*', 1))))
        hits = {match[1]: i for i, name in enumerate(header)
                if (match := form.fullmatch(_without_unit(name)[0]) or form.fullmatch(name))}
        chosen = {(kind, _id(joint)): index for joint, index in hits.items()}
    elif numbers and column not in header:
        first, last = int(numbers[1]), int(numbers[2] or numbers[1])
        chosen = {(kind, str(i - first + 1)): _index(header, str(i))
                  for i in range(first, last + 1)}
    else:
        chosen = {(kind, '1'): _index(header, column)}
    if not chosen:
        raise LogError(f'{argument("columns")} has {column!r} for {kind}: no such column: '
                       f'{", ".join(header)}')
    return kept | chosen


def _id(joint: str) -> str:
    return str(int(joint)) if joint.isdecimal() else joint.lower()


def _index(header: Sequence[str], column: str) -> int:
    if column in header:
        return list(header).index(column)
    if column.isdecimal() and 1 <= int(column) <= len(header):
        return int(column) - 1
    plain = [_without_unit(name)[0] for name in header]
    if plain.count(column) == 1:
        return plain.index(column)
    raise LogError(f'{argument("columns")} has the column {column!r}: expected one of '
                   f'{", ".join(header) or "1.."}')


def _joint_ids(found: _Found, names: Sequence[str], joints: Sequence[str] | None,
               velocity: bool) -> list[str]:
    """Return what stands for the joints in the names of the columns, in order."""
    ids = list(dict.fromkeys(joint for kind, joint in found if kind == 'q'))
    numbers = sorted((joint for joint in ids if joint.isdecimal()), key=int)
    if joints:
        own = [joint.lower() for joint in joints]
        if all(joint in ids for joint in own):
            return own
        if len(numbers) < len(ids):
            missing = [joint for joint in own if joint not in ids]
            raise LogError(f'no column for the position of joint {", ".join(map(repr, missing))}: '
                           f'the columns are of {", ".join(ids)}: {_help()}')
    if not numbers:
        kinds = ['q', 'tau', *(['qd'] if velocity else [])]
        return [joint for joint in ids if all((kind, joint) in found for kind in kinds)] or ids
    return numbers


def _shown(kind: str, joint: str) -> str:
    return f'{kind}{joint}' if joint.isdecimal() else f'{KINDS[kind]} of {joint!r}'


def _without_velocity(missing: Sequence[str]) -> str:
    if all(name.startswith(('qd', 'velocity')) for name in missing):
        return (f'; or {setting("filter.state_order", "4")}, which takes velocities from the '
                'positions')
    return ''
