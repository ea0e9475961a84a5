# SPDX-License-Identifier: Apache-2.0
"""Checks of a measured log against a model of the arm: gravity, unit and order of the effort.

All work on filtered pairs Y_f θ = τ_f of a few blocks of the log. θ is what least squares make of
them for each joint on its own, so that another gain per joint does not disturb.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.identification.finding import Excerpt, Finding, gain_of, WARNING
from adaptive_blf_control.identification.knowledge import Knowledge
from adaptive_blf_control.identification.parts import Given, PartMaker
from adaptive_blf_control.identification.running_parts import RunningParts
from adaptive_blf_control.identification.settings import IdentifierSettings
from adaptive_blf_control.spelling import option, setting

__all__ = ['LEAST_TORQUE', 'Observer', 'Pairs', 'closed_form_findings', 'filtered_pairs',
           'gravity_findings', 'left_over', 'likeness', 'order_findings', 'turned_gravity',
           'unit_findings']

ROWS = 1500  # pairs of each joint that least squares see
EARLIEST, LATEST = 0.05, 0.15  # s, shifts of the effort that are tried
ANOTHER_UNIT = 30.0  # times the nominal torque, from which it is taken for that
LEAST_TORQUE = 0.5  # N·m: less is lost in friction


class Pairs(NamedTuple):
    """Filtered pairs of a log, K of them, at its period.

    Attributes:
        regressors: Y_f, shape (K, n, m).
        torques: τ_f shifted by each lag, shape (lags, K, n) [N·m].
        changes: How Y_f changes within 20 ms, or two rows, shape (K, n, m).
        lags: Shifts of the effort in rows, shape (lags,).
        period: Median period [s].
    """

    regressors: np.ndarray
    torques: np.ndarray
    changes: np.ndarray
    lags: np.ndarray
    period: float

    @property
    def zero(self) -> int:
        """Which of the lags is none."""
        return int(np.flatnonzero(self.lags == 0)[0])

    @property
    def measured(self) -> np.ndarray:
        """τ_f as it was given, shape (K, n) [N·m]."""
        measured: np.ndarray = self.torques[self.zero]
        return measured


class Observer(Knowledge):
    """The filters of an identifier, which learns nothing."""

    def __init__(self, arm: Arm, settings: IdentifierSettings) -> None:
        """Take the arm and the settings of the filters."""
        settings = settings.replace(**{
            'history.size': 1, 'change.window': 0.0, 'excitation.window': 0.0,
            'update_law': 'concurrent', 'history.selection': 'algorithm_1',
            'initial_estimate': [0.0] * arm.m, 'gamma': [1.0]})
        super().__init__(arm, RunningParts(PartMaker(arm, Given()), settings.resolved(
            joints=arm.n, parameters=arm.m)))

    def observe(self, t: float, q: np.ndarray, qd: np.ndarray, tau: np.ndarray) -> None:
        """Filter a sample."""
        self._parts.observe(t, q, qd, tau)

    def restart(self) -> None:
        """Restart the filters with the next sample."""
        self._parts.restart()


def filtered_pairs(log: Excerpt, arm: Arm, settings: IdentifierSettings, *,
                   shifted: bool = True) -> Pairs | None:
    """Filter an excerpt as the identifier does; None where it is too short for that.

    Args:
        log: Rows in a few long blocks.
        arm: Its regressor is used.
        settings: Those of the filters are used.
        shifted: Whether torques of other lags than zero are wanted.
    """
    lags = np.arange(-round(EARLIEST / log.period), round(LATEST / log.period) + 1)
    lags = lags[:: max(1, len(lags) // 80)] if shifted else np.zeros(1, dtype=int)
    if shifted and 0 not in lags:
        lags = np.sort(np.append(lags, 0))
    identifier = Observer(arm, settings)
    settled = np.zeros(len(log.t), dtype=bool)
    regressors = np.empty((len(log.t), arm.n, arm.m))
    torques = np.empty((len(log.t), arm.n))
    for i, (t, q, qd, tau) in enumerate(zip(log.t.tolist(), log.q, log.qd, log.tau)):
        if i and not log.whole[i - 1]:
            identifier.restart()
        identifier.observe(t, q, qd, tau)
        settled[i] = identifier.settled
        regressors[i], torques[i] = identifier.pair
    run = np.cumsum(np.concatenate([[0], ~log.whole]))
    near = max(1, round(0.01 / log.period))
    first, last = min(lags[0], -near), max(lags[-1], near)
    rows = np.arange(-first, len(log.t) - last)
    rows = rows[settled[rows] & settled[rows + first] & (run[rows + first] == run[rows])
                & (run[rows + last] == run[rows])]
    rows = rows[:: max(1, len(rows) // ROWS)]
    if len(rows) < 2 * arm.m:
        return None
    return Pairs(regressors[rows], torques[rows + lags[:, None]],
                 regressors[rows + near] - regressors[rows - near], lags, log.period)


def gravity_findings(pairs: Pairs, weightless: Pairs, arm: Arm,
                     nominal: np.ndarray) -> Iterator[Finding]:
    """Efforts without gravity, as of drives that compensate it.

    Args:
        pairs: Filtered pairs of the arm.
        weightless: Those of the same rows with an arm without gravity.
        arm: The arm.
        nominal: Filtered gravity torque of the URDF at these rows, shape (K, n) [N·m].
    """
    loaded = nominal.std(axis=0) > np.maximum(LEAST_TORQUE, 0.2 * pairs.measured.std(axis=0))
    for joint in np.flatnonzero(loaded):
        torque = pairs.measured[None, :, joint]
        with_it = left_over(pairs.regressors[:, joint], torque)[0]
        without = left_over(weightless.regressors[:, joint], torque)[0]
        if without < 1.03 * with_it:
            yield Finding('gravity', arm.joints[joint], WARNING, without / with_it,
                          f'no gravity is visible in the effort (the URDF has '
                          f'{nominal[:, joint].std():.3g} N·m of it): compensated by the drive?',
                          setting('gravity', '[0.0,0.0,0.0]'))


def unit_findings(pairs: Pairs, arm: Arm, nominal: np.ndarray,
                  described_by: str = 'the masses of the URDF', most: float = 4.0,
                  guess: str = 'a current in A, or another unit?') -> Iterator[Finding]:
    """Efforts of another size or sign than a model of the arm asks for: currents, for one.

    Args:
        pairs: Filtered pairs of the arm.
        arm: The arm.
        nominal: Filtered torque of the model at these rows, (K, n) [N·m].
        described_by: What the model is made of.
        most: Ratio above which, or below the inverse of which, the size is another one.
        guess: What such a ratio may come from.
    """
    for joint, name in enumerate(arm.joints):
        described, measured = (values - values.mean() for values in (
            nominal[:, joint], pairs.measured[:, joint]))
        energy = float(described @ described)
        if energy < len(described) * LEAST_TORQUE ** 2:
            continue
        ratio = float(described @ measured) / energy
        alike = float(likeness(measured[:, None], described[:, None])[0])
        if alike < -0.6:
            yield Finding('unit', name, WARNING, ratio, 'the effort has the sign opposite to that '
                          f'of what {described_by} need', option(
                              'gain', f'{{{name!r}: -1}}', f'{name}:-1') + ' turns it')
        elif alike > 0.6 and not 1.0 / most < ratio < most:
            yield Finding('unit', name, WARNING, ratio, f'the effort is {ratio:.2g} times what '
                          f'{described_by} need: {guess}',
                          gain_of(name) + ' multiplies it by K N·m per unit')


def closed_form_findings(pairs: Pairs, arm: Arm) -> Iterator[Finding]:
    """Efforts of another size or sign than the nominal parameters of an arm without URDF need.

    These are of one robot of that kind, of which there are small and large ones.
    """
    nominal: np.ndarray | None = getattr(arm, 'nominal', None)
    if nominal is not None:
        yield from unit_findings(pairs, arm, pairs.regressors @ nominal,
                                 "the arm's nominal parameters", ANOTHER_UNIT,
                                 'kN·m, mN·m or a current, or an arm of quite another size?')


def turned_gravity(pairs: Pairs, nominal: np.ndarray, weight: np.ndarray,
                   gravity: np.ndarray) -> Finding | None:
    """Efforts that fit the masses of the URDF with gravity the other way: a base upside down.

    Where the arm is slow, efforts of the wrong sign do so, too; they fit better yet with their own
    sign turned.

    Args:
        pairs: Filtered pairs of the arm.
        nominal: Filtered torque of the URDF without friction at these rows, (K, n) [N·m].
        weight: What gravity is of it, likewise.
        gravity: As it was taken, shape (3,) [m/s²].
    """
    measured = pairs.measured
    loaded = weight.std(axis=0) > np.maximum(LEAST_TORQUE, 0.2 * measured.std(axis=0))
    if not loaded.any():
        return None
    as_told, turned = (likeness(measured[:, loaded], each[:, loaded])
                       for each in (nominal, nominal - 2.0 * weight))
    clearly = (1.0 - turned ** 2 < 0.25 * (1.0 - as_told ** 2)).all()
    if not (clearly and turned.min() > 0.8 and turned.mean() > -as_told.mean()):
        return None
    other = ','.join(f'{0.0 - value:g}' for value in gravity)
    return Finding('gravity', None, WARNING, float(turned.mean()), 'the effort is that of the '
                   'masses of the URDF with gravity the other way (correlation '
                   f'{turned.mean():.2f}, as told {as_told.mean():.2f}): is the base mounted '
                   'upside down?', setting('gravity', f'[{other}]'))


def likeness(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the correlation of each column of two signals, (K, n) each → (n,)."""
    one, other = one - one.mean(axis=0), other - other.mean(axis=0)
    size = np.linalg.norm(one, axis=0) * np.linalg.norm(other, axis=0)
    result: np.ndarray = (one * other).sum(axis=0) / np.maximum(size, 1e-300)
    return result


def order_findings(pairs: Pairs, arm: Arm, nominal: np.ndarray) -> Iterator[Finding]:
    """Efforts of two joints that stand in each other's column.

    Args:
        pairs: Filtered pairs of the arm.
        arm: The arm.
        nominal: Filtered torque of the URDF without friction at these rows, (K, n) [N·m].
    """
    described, measured = (values - values.mean(axis=0) for values in (
        nominal, pairs.measured))
    sizes = np.linalg.norm(described, axis=0), np.linalg.norm(measured, axis=0)
    loaded = np.flatnonzero((sizes[0] >= LEAST_TORQUE * np.sqrt(len(described)))
                            & (sizes[1] > 0.0))
    alike = (measured.T @ described) / np.maximum(np.outer(sizes[1], sizes[0]), 1e-300)
    left = np.maximum(1.0 - alike ** 2, 1e-6)  # share of the measured variance
    for one, other in combinations(loaded.tolist(), 2):
        exchanged = left[one, other] * left[other, one]
        as_given = left[one, one] * left[other, other]
        if min(alike[one, other], alike[other, one]) > 0.8 and exchanged < 0.25 * as_given:
            yield Finding(
                'order', arm.joints[one], WARNING, float(exchanged / as_given),
                f'the effort is like that of joint {arm.joints[other]!r} by the masses of the '
                f'URDF, and the other way round (correlation {alike[one, other]:.2f} and '
                f'{alike[other, one]:.2f}; with their own {alike[one, one]:.2f} and '
                f'{alike[other, other]:.2f})',
                f'columns {one + 1} and {other + 1} of the effort may be exchanged')


def left_over(regressor: np.ndarray, torques: np.ndarray) -> np.ndarray:
    """Return the RMS that least squares leave of torques, (K, m) and (lags, K) → (lags,)."""
    basis = _column_space(regressor)
    rest = torques - (torques @ basis) @ basis.T
    result: np.ndarray = np.sqrt(np.mean(rest ** 2, axis=1))
    return result


def _column_space(regressor: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis of what the columns of a matrix span, (K, m) → (K, rank)."""
    scale = np.linalg.norm(regressor, axis=0)
    columns = regressor[:, scale > 1e-9 * scale.max(initial=0.0)]
    if columns.shape[1] == 0:
        return columns
    left, size, _ = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), full_matrices=False)
    result: np.ndarray = left[:, size > 1e-8 * size.max(initial=0.0)]
    return result
