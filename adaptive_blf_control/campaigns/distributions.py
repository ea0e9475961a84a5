# SPDX-License-Identifier: Apache-2.0
"""Distributions of a parameter, and numbers drawn from them reproducibly."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
import math
from statistics import NormalDist
from typing import Any

import numpy as np

from adaptive_blf_control.errors import ParameterError

__all__ = ['DISTRIBUTIONS', 'Distribution', 'read_distribution', 'unit_numbers']

Quantile = Callable[[np.ndarray], list[Any]]


@dataclass(frozen=True)
class Distribution:
    """A distribution as its quantile function, so that every kind of sampling can draw from it.

    Attributes:
        kind: A name of `DISTRIBUTIONS`.
        arguments: What the file gives it.
        quantile: From numbers in [0, 1), shape (N,), to N values.
        grid: Values of which each is to occur equally often, in order; empty but for ``grid``.
    """

    kind: str
    arguments: tuple[Any, ...]
    quantile: Quantile
    grid: tuple[Any, ...] = ()

    def ends(self) -> list[Any]:
        """Return the smallest and the largest value, all of a choice; none of ``normal``."""
        if self.kind == 'normal':
            return []
        if self.kind in ('choice', 'grid'):
            return list(self.arguments)
        return self.quantile(np.array([0.0, np.nextafter(1.0, 0.0)]))


def _numbers(name: str, arguments: Sequence[Any], what: str) -> tuple[float, float]:
    try:
        first, second = (float(value) for value in arguments)
    except (TypeError, ValueError):
        raise ParameterError(name, list(arguments), f'two numbers: {what}') from None
    if not (math.isfinite(first) and math.isfinite(second)):
        raise ParameterError(name, list(arguments), 'finite numbers')
    return first, second


def _interval(name: str, arguments: Sequence[Any]) -> tuple[float, float]:
    low, high = _numbers(name, arguments, 'the smallest and the largest value')
    if not low < high:
        raise ParameterError(name, [low, high], 'the smallest value before the largest')
    return low, high


def _uniform(name: str, arguments: Sequence[Any]) -> Quantile:
    low, high = _interval(name, arguments)
    return lambda u: (low + u * (high - low)).tolist()  # type: ignore[no-any-return]


def _log_uniform(name: str, arguments: Sequence[Any]) -> Quantile:
    low, high = _interval(name, arguments)
    if low <= 0.0:
        raise ParameterError(name, [low, high], 'a smallest value > 0')
    return lambda u: (low * (high / low) ** u).tolist()  # type: ignore[no-any-return]


def _normal(name: str, arguments: Sequence[Any]) -> Quantile:
    mean, deviation = _numbers(name, arguments, 'the mean and the standard deviation')
    if deviation <= 0.0:
        raise ParameterError(name, [mean, deviation], 'a standard deviation > 0')
    normal = NormalDist(mean, deviation)
    tiny = np.finfo(float).tiny
    return lambda u: [normal.inv_cdf(max(value, tiny)) for value in u.tolist()]


def _integers(name: str, arguments: Sequence[Any]) -> Quantile:
    low, high = _interval(name, arguments)
    if low != int(low) or high != int(high):
        raise ParameterError(name, [low, high], 'integers')
    return lambda u: [int(low) + int(value) for value in u * (high - low + 1.0)]


def _choice(name: str, arguments: Sequence[Any]) -> Quantile:
    values = tuple(arguments)
    return lambda u: [values[int(value)] for value in u * len(values)]


DISTRIBUTIONS: dict[str, Callable[[str, Sequence[Any]], Quantile]] = {
    'uniform': _uniform, 'log_uniform': _log_uniform, 'normal': _normal, 'integers': _integers,
    'choice': _choice, 'grid': _choice}
"""Names of distributions: smallest and largest value (uniform, log_uniform, integers, both ends
included there), mean and standard deviation (normal), or the values themselves (choice, grid)."""


def read_distribution(name: str, given: Any) -> Distribution:
    """Return the distribution that a file gives a parameter, e.g. ``{uniform: [0.0, 2.0]}``.

    Args:
        name: The parameter, for messages.
        given: A mapping with one key, the name of a distribution.

    Raises:
        ParameterError: there is no such distribution, or its arguments cannot be used.
    """
    known = ', '.join(DISTRIBUTIONS)
    if not isinstance(given, Mapping) or len(given) != 1:
        raise ParameterError(name, given, f'a mapping with one of {known}')
    (kind, arguments), = given.items()
    if kind not in DISTRIBUTIONS:
        raise ParameterError(name, kind, f'one of {known}')
    if not isinstance(arguments, Sequence) or isinstance(arguments, str) or not arguments:
        raise ParameterError(f'{name}.{kind}', arguments, 'a list of values')
    quantile = DISTRIBUTIONS[kind](f'{name}.{kind}', arguments)
    return Distribution(kind, tuple(arguments), quantile,
                        tuple(arguments) if kind == 'grid' else ())


def unit_numbers(count: int, seed: int, name: str, latin: bool) -> np.ndarray:
    """Return numbers in [0, 1), shape (count,), that depend on nothing but the arguments.

    Args:
        count: How many.
        seed: The campaign's.
        name: What they are for: two names get independent numbers, whatever else varies.
        latin: One number in each of ``count`` equal intervals, in random order (Latin hypercube
            sampling: McKay, Beckman and Conover, Technometrics 21(2), 1979).
    """
    random = np.random.default_rng([seed, *name.encode()])
    if not latin:
        return random.random(count)
    return np.minimum((random.permutation(count) + random.random(count)) / count,
                      np.nextafter(1.0, 0.0))
