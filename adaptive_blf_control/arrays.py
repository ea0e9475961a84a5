# SPDX-License-Identifier: Apache-2.0
"""Arrays as callers give them: lists, scalars, float32 become what the compiled laws take."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import math
import re
from typing import Any, TypeVar

import numpy as np

from adaptive_blf_control.errors import ParameterError

__all__ = ['are_vectors', 'by_name', 'check_unmasked', 'checked_array', 'checked_count',
           'checked_finite', 'checked_number', 'checked_theta', 'checked_vectors', 'dimensions',
           'joint_places', 'labels_of', 'record', 'same_values']

Record = TypeVar('Record', bound=type)

_FLOAT64 = np.dtype(np.float64)  # not the same object as that of an array numba returns
_NUMBERS = 'biuf'  # kinds of dtype; no text, no complex numbers, no objects
_NUMBERED = re.compile(r'(\D*)(\d+)')
_LISTED = 12  # names that a message lists


def checked_array(name: str, value: Any, shape: tuple[int, ...],
                  each: Sequence[str] = ()) -> np.ndarray:
    """Return ``value`` as the compiled laws take it, itself where it is that already.

    They are compiled for contiguous arrays of float64 that may be written, and check no length.

    Args:
        name: What the caller calls it, for the message.
        value: A list, a scalar where one element is asked, or an array of any real type; where
            the last length is 1 that axis may be left out. A pandas Series or a data frame with
            the names of ``each`` is put in their order.
        shape: The shape that is needed; -1 stands for any length.
        each: What the elements along the last axis stand for, e.g. the joints.

    Raises:
        ParameterError: the value holds no real numbers, has another shape or masked elements, or
            names that are neither those of ``each`` nor numbers.
    """
    if (type(value) is np.ndarray and value.shape == shape and value.dtype == _FLOAT64
            and value.flags.carray):
        return value
    check_unmasked(name, value)
    try:
        given = np.asarray(value)
    except (TypeError, ValueError):  # rows of different lengths
        given = np.array(None)
    given = _in_order(name, value, given, each)
    if given.dtype.kind not in _NUMBERS and given.size:
        raise ParameterError(name, value, f'numbers of shape {_text(shape)}{_each(each)}'
                             + _member(name, value))
    if given.ndim == len(shape) - 1 and shape[-1] == 1:
        given = given[..., None]
    if given.ndim != len(shape) or any(
            wanted not in (-1, length) for wanted, length in zip(shape, given.shape)):
        raise ParameterError(name, value, f'shape {_text(shape)}{_each(each)}, not '
                             f'{_text(given.shape)}')
    array = np.ascontiguousarray(given, dtype=np.float64)
    return array if array.flags.writeable else array.copy()


def check_unmasked(name: str, value: Any) -> None:
    """Raise ParameterError where an element is masked: NumPy would take what lies behind it.

    Args:
        name: What the caller calls it, for the message.
        value: Anything; a masked array, or a list of such, is looked at.
    """
    if isinstance(value, (list, tuple)) and any(
            isinstance(each, np.ma.MaskedArray) for each in value):
        try:
            value = np.ma.array(value)  # type: ignore[no-untyped-call]
        except ValueError:  # rows of different lengths, which are refused as such
            return
    if not isinstance(value, np.ma.MaskedArray):
        return
    places = np.argwhere(np.ma.getmaskarray(value))  # type: ignore[no-untyped-call]
    if len(places):
        first = f'[{", ".join(map(str, places[0]))}]' if places.shape[1] else ''
        raise ParameterError(name, value, f'no masked elements: {name}{first} is masked, '
                             f'{len(places)} of {value.size} are; filled(numpy.nan) has NaN '
                             'there, and samples with NaN are left out of a log')


def labels_of(value: Any) -> list[str] | None:
    """Return the names along the last axis of a pandas Series or a data frame, else None.

    Of names on several levels those of the level on which all differ.
    """
    labels = getattr(value, 'columns', None)
    labels = getattr(value, 'index', None) if labels is None else labels
    if labels is None or callable(labels):  # the index of a list is a method
        return None
    names = list(labels)
    if names and all(isinstance(each, tuple) for each in names):
        levels = [level for level in zip(*names) if len(set(level)) == len(names)]
        names = list(levels[-1]) if levels else []
    return names if names and all(isinstance(each, str) for each in names) else None


def by_name(value: Any) -> Any:
    """Return a pandas Series with names as a mapping, any other value itself."""
    labels = labels_of(value)
    return value if labels is None else dict(zip(labels, np.asarray(value).tolist()))


def _in_order(name: str, value: Any, given: np.ndarray, each: Sequence[str]) -> np.ndarray:
    """Return what is given in the order of ``each`` where the value itself has names.

    Names that only number the elements, such as q2 and q1, are put in the order of the numbers.
    """
    labels = labels_of(value) if each else None
    if labels is None or given.shape[-1:] != (len(labels),):
        return given
    if sorted(labels) == sorted(each):
        return np.asarray(given[..., [labels.index(one) for one in each]])
    if set(labels) & set(each):
        raise ParameterError(name, labels, f'one value for each of {", ".join(each)}')
    if len(labels) != len(each):
        return given
    numbers = [_NUMBERED.fullmatch(label) for label in labels]
    if not all(numbers) or len({found[2] for found in numbers if found}) != len(labels) or len(
            {found[1] for found in numbers if found}) != 1:
        raise ParameterError(name, labels, f'the names {", ".join(each)}; to_numpy() of it is an '
                             'array without names, whose order is taken')
    return np.asarray(given[..., np.argsort([int(found[2]) for found in numbers if found])])


def checked_theta(name: str, value: Any, parameters: Sequence[str]) -> np.ndarray:
    """Return parameters of an arm as an array, shape (m,); see `checked_array`.

    Args:
        name: What the caller calls them, for the message.
        value: An array or list; values by name; or what has such an ``estimate``: an identifier,
            or what `identify` returns.
        parameters: Names of the parameters, length m.

    Raises:
        ParameterError: they are not the m parameters of the arm.
    """
    given = getattr(value, 'estimate', value)
    if isinstance(given, Mapping) and set(given) == set(parameters):
        value = [given[each] for each in parameters]
    return checked_array(name, value, (len(parameters),), parameters)


def are_vectors(shape: tuple[int, ...], *values: Any) -> bool:
    """Return whether all are what `checked_array` returns: the short way past it."""
    for value in values:
        if (type(value) is not np.ndarray or value.shape != shape
                or value.dtype != _FLOAT64 or not value.flags.carray):
            return False
    return True


def checked_vectors(joints: Sequence[str], **values: Any) -> list[np.ndarray]:
    """Return arguments by name as arrays with one element for each joint; see `checked_array`."""
    shape = (len(joints),)
    return [checked_array(name, value, shape, joints) for name, value in values.items()]


def checked_number(name: str, value: Any, expected: str = 'a number') -> float:
    """Return ``value`` as a float; it may be infinite or NaN.

    Raises:
        ParameterError: it is not one real number.
    """
    if type(value) is float:
        return value
    check_unmasked(name, value)
    try:
        given = np.asarray(value)
        if given.size == 1 and given.dtype.kind in _NUMBERS:
            return float(given.reshape(())[()])
    except (TypeError, ValueError):
        pass
    raise ParameterError(name, value, expected)


def checked_finite(name: str, value: Any, expected: str = 'a finite number', *,
                   above: float = -math.inf) -> float:
    """Return ``value`` as a finite float above a bound; ParameterError where it is none."""
    number = checked_number(name, value, expected)
    if not (math.isfinite(number) and number > above):
        raise ParameterError(name, value, expected)
    return number


def checked_count(name: str, value: Any) -> int:
    """Return ``value`` as an integer of at least 1; ParameterError where it is none."""
    if type(value) is int and value >= 1:
        return value
    if isinstance(value, np.integer) and value >= 1:
        return int(value)
    raise ParameterError(name, value, 'an integer >= 1')


def dimensions(value: Any) -> int:
    """Return the number of axes of what may become an array; -1 for rows of different lengths."""
    try:
        axes = np.ndim(value)
    except (TypeError, ValueError):
        return -1
    return axes if isinstance(axes, int) else -1  # NumPy itself has an ndim that is a function


def joint_places(joints: Sequence[str], known: Sequence[str]) -> list[int] | None:
    """Return where joints stand among those that are known; None where one is not among them.

    A name that only differs in capitals is taken for the same: columns may have small letters.

    Args:
        joints: Names of joints.
        known: Those that a log has.
    """
    small = [name.lower() for name in known]
    places = [list(known).index(name) if name in known else
              small.index(name.lower()) if small.count(name.lower()) == 1 else -1
              for name in joints]
    return None if -1 in places else places


def _member(name: str, value: Any) -> str:
    """Return what is said of an object that has the array which is meant, such as a result."""
    members = ('torque', 'theta') if name in ('tau', 'torque') else ('theta',)
    has = [each for each in members if isinstance(getattr(value, each, None), np.ndarray)]
    return f': its {has[0]}' if has else ''


def _text(shape: tuple[int, ...]) -> str:
    return str(tuple('N' if length == -1 else length for length in shape)).replace("'", '')


def _each(names: Sequence[str]) -> str:
    if not names:
        return ''
    if len(names) > _LISTED:
        return f' (one for each of {len(names)}, from {names[0]} to {names[-1]})'
    return f' (one for each of {", ".join(names)})'


def same_values(one: Any, other: Any) -> bool:
    """Return whether two values are equal: arrays in every element, NaN being equal to NaN."""
    if one is other:
        return True
    if isinstance(one, tuple) and isinstance(other, tuple):
        return len(one) == len(other) and all(map(same_values, one, other))
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        try:
            return np.array_equal(one, other, equal_nan=True)
        except TypeError:  # no numbers
            return np.array_equal(one, other)
    return bool(one == other)


def record(cls: Record) -> Record:
    """Decorate a NamedTuple of arrays so that ``==``, ``in`` and ``numpy.asarray`` mean something.

    A tuple would ask arrays whether they are true, which NumPy refuses without naming anything.
    It is an array where all of its fields have one shape, else TypeError says what it has.
    """
    names = cls._fields  # type: ignore[attr-defined]

    def __eq__(self: Any, other: object) -> bool:
        return isinstance(other, tuple) and same_values(tuple(self), tuple(other))

    def __ne__(self: Any, other: object) -> bool:
        return not self == other

    def __contains__(self: Any, value: object) -> bool:
        return any(same_values(each, value) for each in self)

    def __array__(self: Any, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        shapes = {np.shape(each) if dimensions(each) >= 0 else None for each in self}
        if len(shapes) > 1 or None in shapes:
            raise TypeError(f'{cls.__name__} is no array: it has {", ".join(names)}')
        return np.array(list(self), dtype)

    for method in (__eq__, __ne__, __contains__, __array__):
        setattr(cls, method.__name__, method)
    return cls
