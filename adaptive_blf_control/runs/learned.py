# SPDX-License-Identifier: Apache-2.0
"""What the results of `identify` and `simulate` have in common: an arm that was learned."""

from __future__ import annotations

from typing import Any, TYPE_CHECKING

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.identification.identifier import Identifier
from adaptive_blf_control.parameters.guided import Guided

__all__ = ['Learned']


class Learned(Guided):
    """Base of results that have an ``identifier``: whose parameters it learned, and which."""

    if TYPE_CHECKING:
        @property
        def identifier(self) -> Identifier:
            """What has learned."""

    def __getitem__(self, name: Any) -> Any:
        """Raise TypeError: a result has attributes."""
        raise TypeError(f'{type(self).__name__} has no [{name!r}]: its arrays and names are '
                        f'attributes, such as {"q" if hasattr(self, "q") else "theta"}')

    @property
    def arm(self) -> Arm:
        """The arm whose parameters were learned."""
        return self.identifier.arm

    @property
    def joints(self) -> tuple[str, ...]:
        """Joint names, in the order of every array."""
        return self.arm.joints

    @property
    def parameters(self) -> tuple[str, ...]:
        """Parameter names, in the order of θ̂."""
        return self.arm.parameters

    @property
    def estimate(self) -> dict[str, float]:
        """θ̂ at the end by parameter name."""
        return self.identifier.estimate

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Names of the parameters that the data do not determine; see `Identifier`."""
        return self.identifier.undetermined
