# SPDX-License-Identifier: Apache-2.0
"""What the identifier publishes about each sample, for the node and for a simulated bag."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.errors import BagError
from adaptive_blf_control.identification.change_monitor import ExternalTorque
from adaptive_blf_control.identification.payload import PayloadEstimate
from adaptive_blf_control.identification.republish import HistoryPublication
from adaptive_blf_control.limits.cause_intervals import CauseBounds
from adaptive_blf_control.messages.cdr import encode_float64, encode_int32
from adaptive_blf_control.messages.inertia import InertiaCodec
from adaptive_blf_control.messages.joint_state import JointStateCodec
from adaptive_blf_control.messages.joint_state_reader import JointStateReader
from adaptive_blf_control.messages.topics import (
    EXCITATION,
    EXTERNAL_TORQUE,
    HISTORY_RANK,
    HISTORY_SIGMA_MIN,
    PAYLOAD,
    PAYLOAD_STD,
    THETA_HAT,
)
from adaptive_blf_control.messages.usual_joint_state import StandingJointStateCodec

__all__ = ['BoundsReader', 'EstimateStream', 'HistoryFigures', 'ParameterSetCodec',
           'PayloadStream']

_ROWS = [0, 1, 3, 2, 4, 5]  # of the inertia as the message has it: ixx, ixy, ixz, iyy, iyz, izz


class HistoryFigures(NamedTuple):
    """Rank and σ_min of the history, and the excitation index, None where switched off."""

    rank: int
    sigma_min: float
    excitation: float | None


class EstimateStream:
    """The estimate after every sample, the figures of the history where they have changed.

    Attributes:
        decimation: Samples from one external torque to the next; 0: never.
        estimate_decimation: Samples from one estimate to the next.
    """

    def __init__(self, parameters: Sequence[str], joints: Sequence[str], decimation: int,
                 label: str = '') -> None:
        """Prepare the messages for the names of the parameters and of the joints.

        The ``frame_id`` of an estimate is the ``label`` of who sends it.
        """
        self._theta = StandingJointStateCodec(parameters, label, fields=('position',))
        self._external = JointStateCodec([*joints, *(f'{joint}.bound' for joint in joints)],
                                         fields=('position',))
        self._history = HistoryPublication()
        self.decimation = decimation
        self.estimate_decimation = 1
        self._samples = 0

    def messages(self, stamp: int, theta: np.ndarray, insertions: int,
                 figures: Callable[[], HistoryFigures],
                 external: Callable[[], ExternalTorque | None]) -> dict[str, bytes]:
        """Return the messages of a sample by topic; the estimate, which answers it, is the last.

        Args:
            stamp: Of the sample [ns].
            theta: θ̂ after the sample, shape (m,).
            insertions: Pairs that the history has taken so far.
            figures: Called where those of the history are due.
            external: Called where the external torque is due.
        """
        messages: dict[str, bytes] = {}
        if self._history.due(insertions):
            rank, sigma_min, excitation = figures()
            messages[HISTORY_RANK] = encode_int32(rank)
            messages[HISTORY_SIGMA_MIN] = encode_float64(sigma_min)
            if excitation is not None:
                messages[EXCITATION] = encode_float64(excitation)
        if self.decimation and self._samples % self.decimation == 0:
            torque = external()
            if torque is not None:
                messages[EXTERNAL_TORQUE] = self._external.encode(stamp, np.concatenate(torque))
        if self._samples % self.estimate_decimation == 0:
            messages[THETA_HAT] = self._theta.encode(stamp, theta)
        self._samples += 1
        return messages


class PayloadStream:
    """The load with its standard deviations, in the frame that carries it."""

    def __init__(self, frame: str) -> None:
        """Prepare the messages for a frame."""
        self._codec = InertiaCodec(frame)

    def messages(self, stamp: int, estimate: PayloadEstimate) -> dict[str, bytes]:
        """Return the messages of a sample of stamp ``stamp`` [ns] by topic."""
        return {topic: self._codec.encode(stamp, body.mass, body.com, body.inertia[_ROWS])
                for topic, body in ((PAYLOAD, estimate.load), (PAYLOAD_STD, estimate.std))}


def _bound_names(causes: Sequence[str]) -> list[str]:
    """Return the names under which the message of a set has the bounds of causes."""
    return [f'prior.{cause}' for cause in causes]


class BoundsReader:
    """Decoder of what the message of a set, see `ParameterSetCodec`, says of the causes."""

    def __init__(self, causes: Sequence[str]) -> None:
        """Take the names of those that are looked for."""
        self._causes = tuple(causes)
        self._reader = JointStateReader(_bound_names(causes))

    @property
    def source(self) -> bytes:
        """frame_id of the message read last: what it says of its publisher."""
        return self._reader.source

    def read(self, data: bytes) -> CauseBounds:
        """Return the bounds of all causes.

        Raises:
            BagError: one is missing, or its numbers are no interval.
        """
        _, middle, half, _ = self._reader.read(data)
        if not (np.isfinite(middle).all() and np.isfinite(half).all() and (half >= 0.0).all()):
            raise BagError(f'intervals of {", ".join(self._causes)}: expected finite numbers, '
                           'half widths >= 0')
        return CauseBounds(self._causes, middle - half, middle + half)


class ParameterSetCodec:
    """Encoder of the set that holds θ*."""

    def __init__(self, parameters: Sequence[str], causes: Sequence[str], label: str = '') -> None:
        """Prepare the template for the names of parameters and causes.

        The ``frame_id`` is the ``label`` of who sends it.
        """
        self._codec = JointStateCodec(
            [*parameters, 'size', 'falsified', *_bound_names(causes)], label,
            fields=('position', 'velocity'))

    def encode(self, stamp: int, centre: np.ndarray, half_widths: np.ndarray, size: float,
               falsified: int, least: np.ndarray, most: np.ndarray) -> bytes:
        """Encode a set.

        Args:
            stamp: Stamp [ns].
            centre: Of the ellipsoid, shape (m,).
            half_widths: How far it reaches in each parameter, shape (m,).
            size: Geometric mean of its semi-axes.
            falsified: How often it was contradicted.
            least: Smallest value of each cause, shape (ν,).
            most: Largest value, shape (ν,).
        """
        return self._codec.encode(
            stamp, np.concatenate((centre, [size, falsified], 0.5 * (least + most))),
            np.concatenate((half_widths, [0.0, 0.0], 0.5 * (most - least))))
