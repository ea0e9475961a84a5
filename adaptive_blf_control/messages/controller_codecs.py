# SPDX-License-Identifier: Apache-2.0
"""What the controller publishes besides the torque, for the node and for a simulated bag."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from adaptive_blf_control.compiled import borrowed, entry_for, jit
from adaptive_blf_control.control.answered import Answered
from adaptive_blf_control.control.constraints import MarginName
from adaptive_blf_control.control.control_output import ControlOutput
from adaptive_blf_control.control.guarantee import Guarantee
from adaptive_blf_control.messages.joint_state import JointStateCodec
from adaptive_blf_control.messages.topics import BARRIER, REFERENCE, RESERVE, TRACKING_ERROR
from adaptive_blf_control.messages.usual_joint_state import StandingJointStateCodec

__all__ = ['ControllerCodecs', 'MonitorStream', 'margin_names', 'guarantee_names']


def margin_names(margins: Sequence[MarginName]) -> list[str]:
    """Return the names on ``controller/barrier``: the margins of all constraints, then V."""
    return [str(name) for name in margins] + ['V']


def guarantee_names(joints: Sequence[str]) -> list[str]:
    """Return the names on ``controller/guarantee``: (39), (41) per joint, V(0), (40)."""
    return [f'{joint}.{what}' for what in ('error_lower', 'error_upper', 'output_lower',
                                           'output_upper')
            for joint in joints] + ['V0', 'e2_norm']


class ControllerCodecs:
    """Encoders of the adaptation term, reference, errors, margins and guarantee."""

    def __init__(self, joints: Sequence[str], parameters: Sequence[str],
                 margins: Sequence[MarginName], label: str = '',
                 watched: Sequence[str] = ()) -> None:
        """Prepare the templates for the names of joints, parameters, margins and reserves.

        The ``frame_id`` of the adaptation term is the ``label`` of who sends it.
        """
        self._term = StandingJointStateCodec(parameters, label, fields=('position',))
        # y_d, its velocity, and its acceleration [rad/s²] in the third array, effort.
        self._reference = JointStateCodec(joints)
        self._error = StandingJointStateCodec(joints, fields=('position', 'velocity'))
        self._margins = JointStateCodec(margin_names(margins), fields=('position',))
        self._guarantee = JointStateCodec(guarantee_names(joints), fields=('position',))

        self._reserve = JointStateCodec(watched, fields=('position',))

    def reserve(self, stamp: int, values: np.ndarray) -> bytes:
        """Encode what a safety filter says of itself; ``stamp`` in ns."""
        return self._reserve.encode(stamp, values)

    def guarantee(self, stamp: int, guaranteed: Guarantee) -> bytes:
        """Encode what Theorem 2 guarantees; ``stamp`` in ns."""
        return self._guarantee.encode(stamp, np.concatenate([
            guaranteed.error_lower, guaranteed.error_upper, guaranteed.output_lower,
            guaranteed.output_upper, [guaranteed.value, guaranteed.e2_norm]]))

    def adaptation_term(self, stamp: int, output: ControlOutput | Answered) -> bytes:
        """Encode Xᵀe2 of (37) by parameter name; ``stamp`` in ns."""
        return self._term.encode(stamp, output.adaptation_term)

    def tracking_error(self, stamp: int, output: ControlOutput | Answered) -> bytes:
        """Encode e1 with e2; ``stamp`` in ns."""
        return self._error.encode(stamp, output.e1, output.e2)

    def monitors(self, stamp: int, output: ControlOutput | Answered, margins: np.ndarray,
                 lyapunov: float) -> dict[str, bytes]:
        """Encode the reference, and the margins (K,) with V; by topic."""
        return {
            REFERENCE: self._reference.encode(stamp, *output.reference),
            BARRIER: self._margins.encode(stamp, np.append(margins, lyapunov)),
        }


@jit
def _lower_to(least: np.ndarray, values: np.ndarray) -> None:
    """Make each element of a vector the smaller one of two, NaN where one is; for `entry_for`."""
    kept, given = borrowed(least), borrowed(values)
    for i in range(kept.size):
        kept[i] = np.minimum(kept[i], given[i])


class MonitorStream:
    """The messages of each sample: the errors always, the others every few samples.

    Margins are the smallest since the previous message, so that no violation is left out.

    Attributes:
        samples: Samples so far.
        lyapunov: V at the last sample for which it was computed.
    """

    def __init__(self, codecs: ControllerCodecs) -> None:
        """Start without samples."""
        self.samples = 0
        self.lyapunov = 0.0
        self._codecs = codecs
        self._smallest: np.ndarray | None = None
        self._lower_to = entry_for(_lower_to, np.zeros(1), np.zeros(1))

    def messages(self, stamp: int, output: ControlOutput | Answered, margins: np.ndarray,
                 decimation: int, lyapunov: Callable[[], float],
                 watch: Callable[[], np.ndarray] | None = None) -> dict[str, bytes]:
        """Return the messages of a sample by topic.

        Args:
            stamp: Of the sample [ns].
            output: What the controller computed.
            margins: Those of all constraints, shape (K,).
            decimation: Reference, margins and V go out every this many samples.
            lyapunov: Computes V; called for those samples only.
            watch: Returns what a safety filter says of itself, likewise; None for none.
        """
        messages = {TRACKING_ERROR: self._codecs.tracking_error(stamp, output)}
        # The margins may be those of an `Answered`, which change with the next sample.
        smallest = self._smallest
        if smallest is None:
            smallest = self._smallest = margins.copy()
        else:
            self._lower_to(smallest, margins)
        if self.samples % decimation == 0:
            self.lyapunov = lyapunov()
            messages.update(self._codecs.monitors(stamp, output, smallest, self.lyapunov))
            self._smallest = None
            if watch is not None:
                messages[RESERVE] = self._codecs.reserve(stamp, watch())
        self.samples += 1
        return messages
