# SPDX-License-Identifier: Apache-2.0
"""Distances between the collision bodies of a URDF arm, and to a floor."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import itertools
import os
from typing import Any

import numpy as np

from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.arms.urdf_model import JointOrder, load_pinocchio
from adaptive_blf_control.arms.urdf_source import package_roots
from adaptive_blf_control.errors import ArmError

__all__ = ['Clearance']

_FLOOR = 'floor'
_EXTENT = 20.0  # m, of the floor
_POSTURES = 60
_ALWAYS = 0.95  # part of random postures in which bodies that belong together touch


class Clearance:
    """Pairs of bodies that may come near each other, as convex hulls.

    Bodies of one link and of links that a joint connects are left out, what an SRDF disables, and
    pairs that touch in nearly every posture.

    Each pair has to keep a distance; of those that are nearer in the middle of the range, as links
    are that two joints next to each other connect, half of what they have there.

    Attributes:
        pairs: Names of the bodies of each pair.
        wanted: The distance that each pair has to keep, shape (k,) [m].
        ignored: Pairs that touch nearly everywhere.
        bodies: Number of collision bodies.
    """

    def __init__(self, arm: UrdfArm, range_: tuple[np.ndarray, np.ndarray],
                 distance: float, *, floor: float | None = None, srdf: str | None = None,
                 package_dirs: Sequence[str | os.PathLike[str]] = ()) -> None:
        """Read the collision bodies of an arm.

        Args:
            arm: The arm.
            range_: Positions that it may take, two of shape (n,) [rad].
            distance: How far apart bodies have to stay [m].
            floor: Height of a plane in the base frame that only the base may touch [m].
            srdf: Text of an SRDF whose disabled pairs are left out.
            package_dirs: Further folders of packages, for meshes.

        Raises:
            ArmError: a body cannot be read.
        """
        self._pin = load_pinocchio()
        self._order = JointOrder(arm.model, arm.joints)
        self._model, self._bodies = self._read(arm, package_dirs)
        self.bodies = len(self._bodies.geometryObjects)
        if floor is not None:
            self._add_floor(floor)
        self._add_pairs()
        if srdf is not None:
            self._pin.removeCollisionPairsFromXML(self._model, self._bodies, srdf)
        self._begin()
        self.ignored = self._leave_out(range_)
        here = self._distances(0.5 * (range_[0] + range_[1]))
        self.wanted = np.where(here > 0.0, np.minimum(distance, 0.5 * here), distance)

    @property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """Names of the bodies of each pair."""
        return tuple(self._names(pair) for pair in self._bodies.collisionPairs)

    def least(self, q: np.ndarray) -> tuple[float, tuple[str, str]]:
        """Return the least distance in N postures, (N, n), and between which bodies [m].

        It is that of the pair which keeps least, or misses most, of what it has to keep: negative
        where bodies touch, infinity where there is no pair.
        """
        least, which = self._slack(q)
        return (least + float(self.wanted[which]), self.pairs[which]) if self.pairs else (
            np.inf, ('', ''))

    def kept(self, q: np.ndarray) -> bool:
        """Return whether every pair keeps its distance in N postures, shape (N, n)."""
        return self._slack(q)[0] >= 0.0

    def _slack(self, q: np.ndarray) -> tuple[float, int]:
        least, which = np.inf, 0
        for posture in q if self.pairs else ():
            slack = self._distances(posture) - self.wanted
            k = int(np.argmin(slack))
            if slack[k] < least:
                least, which = float(slack[k]), k
        return least, which

    def near(self, q: np.ndarray, within: float) -> Iterator[tuple[int, float, np.ndarray]]:
        """Yield posture, distance beyond the wanted one [m] and its gradient, (n,), of near pairs.

        Args:
            q: Postures, shape (N, n) [rad].
            within: Distance beyond the wanted one below which a pair counts [m].
        """
        for k, posture in enumerate(q if self.pairs else ()):
            distances = self._distances(posture) - self.wanted
            near = np.flatnonzero(distances < within)
            if near.size:
                self._pin.computeJointJacobians(self._model, self._data,
                                                self._order.position(posture))
            for pair in near:
                yield k, float(distances[pair]), self._slope(int(pair))

    # -- construction -------------------------------------------------------------------------

    def _read(self, arm: UrdfArm, package_dirs: Sequence[str | os.PathLike[str]],
              ) -> tuple[Any, Any]:
        pin = self._pin
        full = pin.buildModelFromXML(arm.xml)
        roots = [str(root) for root in package_roots(package_dirs)]
        try:
            bodies = pin.buildGeomFromUrdfString(full, arm.xml, pin.GeometryType.COLLISION,
                                                 package_dirs=roots)
        except Exception as error:  # the binding may raise any type for a C++ exception
            raise ArmError('collision bodies of the URDF cannot be read (--package-dir, or '
                           '--no-collisions): '
                           f'{" ".join(str(error).split())}') from error
        locked = [i for i in range(1, full.njoints) if full.names[i] not in arm.joints]
        if locked:
            full, bodies = pin.buildReducedModel(full, bodies, locked, pin.neutral(full))
        for body in bodies.geometryObjects:
            if hasattr(body.geometry, 'buildConvexRepresentation'):  # a mesh
                body.geometry.buildConvexRepresentation(False)
                body.geometry = body.geometry.convex
        return full, bodies

    def _add_floor(self, height: float) -> None:
        import coal
        place = self._pin.SE3(np.eye(3), np.array([0.0, 0.0, height - 0.5 * _EXTENT]))
        self._bodies.addGeometryObject(self._pin.GeometryObject(
            _FLOOR, 0, 0, place, coal.Box(_EXTENT, _EXTENT, _EXTENT)))

    def _add_pairs(self) -> None:
        bodies, parents = self._bodies.geometryObjects, self._model.parents
        for a, b in itertools.combinations(range(len(bodies)), 2):
            one, other = bodies[a].parentJoint, bodies[b].parentJoint
            if one != other and parents[one] != other and parents[other] != one:
                self._bodies.addCollisionPair(self._pin.CollisionPair(a, b))

    def _begin(self) -> None:
        self._data = self._model.createData()
        self._results = self._bodies.createData()

    def _leave_out(self, range_: tuple[np.ndarray, np.ndarray]) -> tuple[tuple[str, str], ...]:
        random = np.random.default_rng(0)
        touch = np.mean([self._distances(random.uniform(*range_)) < 0.0
                         for _ in range(_POSTURES)], axis=0)
        found = [self._bodies.collisionPairs[int(k)] for k in np.flatnonzero(touch >= _ALWAYS)]
        names = tuple(map(self._names, found))
        for pair in found:
            self._bodies.removeCollisionPair(pair)
        self._begin()
        return names

    # -- distances ----------------------------------------------------------------------------

    def _names(self, pair: Any) -> tuple[str, str]:
        bodies = self._bodies.geometryObjects
        return bodies[pair.first].name, bodies[pair.second].name

    def _distances(self, posture: np.ndarray) -> np.ndarray:
        self._pin.computeDistances(self._model, self._data, self._bodies, self._results,
                                   self._order.position(posture))
        return np.array([result.min_distance for result in self._results.distanceResults])

    def _slope(self, k: int) -> np.ndarray:
        """Return the gradient of the distance of pair k where the Jacobians were computed."""
        pair, result = self._bodies.collisionPairs[k], self._results.distanceResults[k]
        normal = np.array(result.normal)  # from the first body to the second
        total = np.zeros(self._model.nv)
        for body, point, sign in ((pair.first, result.getNearestPoint1(), -1.0),
                                  (pair.second, result.getNearestPoint2(), 1.0)):
            joint = self._bodies.geometryObjects[body].parentJoint
            if joint:
                twists = self._pin.getJointJacobian(self._model, self._data, joint,
                                                    self._pin.ReferenceFrame.WORLD)
                total += sign * (normal @ twists[:3] + np.cross(point, normal) @ twists[3:])
        result_: np.ndarray = total[self._order.rows]
        return result_
