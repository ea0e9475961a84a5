# SPDX-License-Identifier: Apache-2.0
"""The model of the safety filter ``limits``: an arm with the set that its θ* is in."""

from __future__ import annotations

from typing import Any

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.arms.mass_and_bias import model_of
from adaptive_blf_control.arms.regressors import arrays_of
from adaptive_blf_control.compiled import handle
from adaptive_blf_control.control.limit_settings import PriorSettings
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.limits.acceleration_error import Model
from adaptive_blf_control.limits.cause_intervals import CauseBounds
from adaptive_blf_control.limits.prior import inertia_range, stated_prior

__all__ = ['SetModel']

WORTH = 0.1
"""Part of the mean half width that an interval has to lose for the model to be made again, which
takes longer than a sample of the filter."""
ROUNDING = 1e-9
"""Of z: an end that comes back from a message as middle and half width is not the same."""


class SetModel:
    """A model and its set, which is the prior or a narrower one; never changed, made again.

    Attributes:
        prior: What is known before any motion.
        known: What is known now.
        handle: Of the `Model` with that set.
    """

    def __init__(self, arm: Arm, stated: PriorSettings) -> None:
        """Begin with the prior that is stated, with arrays of full length.

        Raises:
            ParameterError: a value cannot be used.
            ArmError: the arm has no arrays, or no inertia with a θ of the prior.
        """
        self.prior = stated_prior(arm, stated)
        self._arm = arm
        self._ends = inertia_range(arm, mass_error=stated.mass_error, payload=stated.payload)
        self._unexplained = stated.unexplained.copy()
        self._whole = self  # the model of the prior
        count = self.prior.generators.shape[1]
        self._take(-np.ones(count), np.ones(count))

    def _take(self, least: np.ndarray, most: np.ndarray) -> None:
        """Make the model of a box of z."""
        self._box = least, most
        self.known = self.prior.narrowed(least, most)
        inertial = np.array([cause.inertial for cause in self.prior.causes])
        lighter, heavier = (end + self.prior.generators @ np.where(inertial, beyond, 0.0)
                            for end, beyond in zip(self._ends, (least + 1.0, most - 1.0)))
        self.handle: Any = handle(Model(
            arrays_of(self._arm), model_of(self._arm, self.known.centre),
            model_of(self._arm, lighter), model_of(self._arm, heavier),
            np.ascontiguousarray(self.known.generators), self._unexplained))

    @property
    def part(self) -> float:
        """How wide the intervals of the causes are, of those of the prior, in the mean."""
        return float(np.mean(0.5 * (self._box[1] - self._box[0])))

    def narrowed(self, bounds: CauseBounds | None) -> SetModel:
        """Return the model for what the bounds leave of the prior; this one where that is alike.

        Args:
            bounds: What is known of each cause, of a prior of the same arm; None for nothing.

        Raises:
            ParameterError: the bounds lack a cause of this prior, or exclude it.
        """
        if bounds is None:
            return self._whole
        least, most = self._within(bounds)
        if least.max() == -1.0 and most.min() == 1.0:
            return self._whole
        before = self._box[1] - self._box[0]
        wider = bool((least < self._box[0] - ROUNDING).any()
                     or (most > self._box[1] + ROUNDING).any())
        if not wider and (before - (most - least)).max() < WORTH * before.mean():
            return self
        other = object.__new__(SetModel)
        other.__dict__.update(self.__dict__)
        other._take(least, most)
        return other

    def _within(self, bounds: CauseBounds) -> tuple[np.ndarray, np.ndarray]:
        place = {name: at for at, name in enumerate(bounds.names)}
        least, most = [], []
        for cause in self.prior.causes:
            at = place.get(cause.name)
            if at is None:
                raise ParameterError(
                    'controller.limits.prior', cause.name, 'causes that identifier.parameter_set.'
                    f'prior has, too: {", ".join(bounds.names)}')
            ends = [(float(end[at]) - cause.middle) / cause.half
                    for end in (bounds.least, bounds.most)]
            least.append(max(ends[0], -1.0))
            most.append(min(ends[1], 1.0))
            if not least[-1] <= most[-1]:
                raise ParameterError(
                    f'{cause.name} of identifier/parameter_set',
                    [float(bounds.least[at]), float(bounds.most[at])],
                    f'an interval that meets that of controller.limits.prior, '
                    f'{cause.middle - cause.half:.4g} to {cause.middle + cause.half:.4g}')
        return np.array(least), np.array(most)
