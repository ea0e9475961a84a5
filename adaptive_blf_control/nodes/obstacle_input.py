# SPDX-License-Identifier: Apache-2.0
"""The controller's side of ``controller/obstacles``: obstacles that move."""

from __future__ import annotations

from collections.abc import Hashable
import math

import numpy as np

from adaptive_blf_control.configuration.node_settings import ControllerNodeSettings
from adaptive_blf_control.control.motion import Motion
from adaptive_blf_control.errors import BagError, BlfError
from adaptive_blf_control.limits.obstacles import box, capsule, Obstacles, sphere
from adaptive_blf_control.messages.marker_reader import Marker, read_markers
from adaptive_blf_control.messages.topics import OBSTACLES
from adaptive_blf_control.runtime.data_node import DataNode

__all__ = ['ObstacleInput', 'obstacle_of']

ADD, DELETE, DELETE_ALL = 0, 2, 3
CUBE, SPHERE, CYLINDER = 1, 2, 3


class ObstacleInput:
    """Brings the obstacles of each message to a motion, all of them or, with an error, none."""

    def __init__(self, node: DataNode[ControllerNodeSettings], motion: Motion) -> None:
        """Take the node, for its loop and its faults, and the motion."""
        self._node = node
        self._motion = motion

    def receive(self, data: bytes) -> None:
        """Take a message as CDR; a message that cannot be used is dropped as a whole."""
        if self._node.settings.safety_filter == 'none':
            self._node.faults.drop('obstacles without a safety filter', 'nothing keeps away from '
                                   'them: controller.safety_filter is none')
            return
        try:
            markers = read_markers(data)
            seen, gone, clears = self._told(markers)
        except BlfError as error:
            self._node.faults.drop('unusable obstacles', f'{OBSTACLES}: {error}')
            return
        with self._node.between_samples:
            self._motion.see(seen, None if clears else frozenset(gone))

    def _told(self, markers: tuple[Marker, ...],
              ) -> tuple[dict[Hashable, Obstacles], set[Hashable], bool]:
        """Return the obstacles there are, those deleted, and whether all earlier ones are."""
        frame = self._node.settings.limits.obstacles.frame
        seen: dict[Hashable, Obstacles] = {}
        gone: set[Hashable] = set()
        clears = False
        for marker in markers:
            key = (marker.ns, marker.id)
            if marker.action == DELETE_ALL:
                seen.clear()
                clears = True
            elif marker.action == DELETE:
                seen.pop(key, None)
                gone.add(key)
            elif marker.action == ADD:
                seen[key] = obstacle_of(marker, frame)
            else:
                raise BagError(f'marker {key} has action {marker.action}: expected 0 (add), 2 '
                               '(delete) or 3 (delete all)')
        return seen, gone, clears


def obstacle_of(marker: Marker, frame: str) -> Obstacles:
    """Return the obstacle that a marker shows; a cylinder with round ends.

    Raises:
        BagError: another frame or shape than expected, or numbers that cannot be used.
    """
    what = f'marker ({marker.ns!r}, {marker.id})'
    if marker.frame.removeprefix('/') != frame:
        raise BagError(f'{what} is in the frame {marker.frame!r}: expected {frame!r}, see '
                       'limits.obstacles.frame')
    if not all(map(math.isfinite, (*marker.position, *marker.orientation, *marker.scale))):
        raise BagError(f'{what} has position {marker.position}, orientation '
                       f'{marker.orientation}, scale {marker.scale}: expected finite numbers')
    if marker.type not in (CUBE, SPHERE, CYLINDER) or not min(marker.scale) > 0.0:
        raise BagError(f'{what} has type {marker.type} and scale {marker.scale}: expected a cube '
                       '(1), sphere (2) or cylinder (3) and lengths > 0 m')
    if marker.type == SPHERE:
        return sphere(marker.position, 0.5 * max(marker.scale))
    norm = math.sqrt(sum(value * value for value in marker.orientation))
    if not 0.9 < norm < 1.1:
        raise BagError(f'{what} has orientation {marker.orientation}: expected a quaternion of '
                       'length 1')
    axes = _rotation(*(value / norm for value in marker.orientation))
    if marker.type == CUBE:
        return box(marker.position, marker.scale, axes)
    half = 0.5 * marker.scale[2] * axes[:, 2]
    return capsule((np.array(marker.position) - half).tolist(),
                   (np.array(marker.position) + half).tolist(), 0.5 * max(marker.scale[:2]))


def _rotation(x: float, y: float, z: float, w: float) -> np.ndarray:
    """Return the rotation of a unit quaternion, shape (3, 3)."""
    return np.array([
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)]])
