# SPDX-License-Identifier: Apache-2.0
"""Does gravity act along the direction that was told? Found in the first moments of a motion.

A base that is mounted otherwise than told makes torques that no θ of the arm expresses: a first
joint with a vertical axis, for one, carries no weight in any model. The nominal model predicts the
momentum p = M q̇, and what it lacks is, with the observer of De Luca and Mattone (ICRA 2003),

    r = K (p(t) − p(0) − ∫(τ − Y2 θ + r) dt),    ṙ = K (τ_model − τ − r),

the missing torque behind a low-pass of time constant 1/K. Two explanations are compared:

* links that are each a quarter off, a load at the tip, friction, rotors and drives, all together
  with a covariance C: D0 = rᵀ C⁻¹ r;
* gravity turned besides, to where D1 = (r − B Δg)ᵀ C⁻¹ (r − B Δg) + tilt²/TILT² is smallest. B Δg
  is the weight of the links of the URDF, behind the same low-pass.

Told gravity does not fit where a turned one explains D0 and the first EARLY seconds had asked for
it already: a contact comes later. Either D0 is beyond any chance, or it is not, as where much
friction is possible, but r is that of a turned gravity in all joints: of n torques a turn makes
two, so errors of links, a load and friction look like one to a part ε of D0 with the
probability ε^(n/2 − 1) only, however large they may be. What pulls or holds the arm from its
start on can look the same; a turn about the vertical makes no torque, and one by less than what
the covariance allows is not noticed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.arms.link_weights import LinkWeights
from adaptive_blf_control.arms.urdf import UrdfArm

__all__ = ['GravityCheck', 'GravityMisfit', 'WATCHED', 'gravity_check_of']

WATCHED = 2.0  # s from the start; later it is learned what the nominal model lacks
OBSERVER = 0.04  # s, 1/K
EARLY = 0.1  # s from the start after which what turned gravity has to be there
AGREE = 0.6  # part of its change by which it may differ from what it looked like then
PERIOD = 0.01  # s between two comparisons
SEEN = 5  # comparisons in a row that have to agree
GAP = 0.1  # s without a sample after which it begins again
LINKS = 0.25  # part by which the weight of each link may be off, and its share of the inertia
LOAD = 0.15  # of the mass of all links: a load at the tip that nobody has told of
DRY, ROTOR = 0.015, 1e-3  # friction [N·m] and rotor inertia [kg·m²] over the torque limit
DRIVES = 0.04  # part by which the torques of the drives may be off
LEAST = 0.05  # N·m
TILT = 1.0  # rad, standard deviation of a tilt
BEYOND = 10.0  # D0 that no chance makes where a turned gravity explains most of it ...
EXPLAINED = 0.1  # ... but for this part
SHOWN = 0.5  # D0 that may well be chance, but hardly where all of it looks like turned gravity ...
ALIKE = 0.03  # ... but for this part, the tilt's own share of D1 not counted
SMALLEST = np.radians(5.0)  # rad: less is not called a tilt
FEWEST = 4  # joints: fewer torques can always be explained by a tilt
STEPS = 8


class GravityMisfit(NamedTuple):
    """What was measured where gravity as told does not fit.

    Attributes:
        t: When [s].
        joint: The joint at which it shows most.
        torque: What it carries beyond the nominal model [N·m].
        allowed: Standard deviation of what that may be beside the other joints' torques [N·m].
        gravity: That would fit, in the base's frame, shape (3,) [m/s²].
        tilt: Angle between it and the one that was told [rad].
    """

    t: float
    joint: str
    torque: float
    allowed: float
    gravity: np.ndarray
    tilt: float

    def text(self) -> str:
        """Return it in one sentence."""
        x, y, z = self.gravity
        return (f'gravity as told does not fit: {self.joint} carries {self.torque:.3g} N·m that '
                f'the nominal arm does not (beside the other joints {self.allowed:.2g} N·m may '
                f'be); the base looks tilted by about {np.degrees(self.tilt):.0f}°, gravity '
                f'[{x:.3g}, {y:.3g}, {z:.3g}] m/s² would fit (or something pulls at the arm)')


class GravityCheck:
    """Compares the first torques of a motion with the weight of the nominal arm.

    Attributes:
        misfit: What was found; None while gravity fits.
    """

    def __init__(self, arm: UrdfArm) -> None:
        """Begin with the next sample."""
        self.misfit: GravityMisfit | None = None
        self._arm, self._weights = arm, LinkWeights(arm)
        self._told = np.array(arm.model.gravity.linear, dtype=float)
        limit = np.where(np.isfinite(arm.torque_limit), arm.torque_limit, 0.0)
        self._dry = LEAST + DRY * limit + arm.friction(arm.nominal)[1]
        self._viscous = arm.friction(arm.nominal)[0]
        self._rotor = np.where(arm.rotor > 0.0, LINKS * arm.rotor, ROTOR * limit)
        self._load = LOAD * arm.inertial[:, 0].sum()
        self._able = arm.n >= FEWEST and bool(self._told.any())
        self._off = not self._able
        self._begin: float | None = None
        self._last = self._compared = self._reached = 0.0
        self._agree = 0
        self._early: np.ndarray | None = None
        self._momentum, self._sum, self._missing, self._drive, self._slow = np.zeros((5, arm.n))
        self._links, self._tip = np.zeros((3, arm.n, arm.n)), np.zeros((3, arm.n))

    def restart(self) -> None:
        """Watch another motion from its first sample on."""
        self.misfit, self._begin, self._off = None, None, not self._able

    @property
    def watching(self) -> bool:
        """Whether another sample may still change what is found."""
        return self.misfit is None and not self._off

    def take(self, t: float, q: np.ndarray, qd: np.ndarray, torque: np.ndarray) -> bool:
        """Take a sample; return whether gravity was found not to fit with it.

        Args:
            t: Its time [s].
            q: Positions, shape (n,) [rad].
            qd: Velocities, shape (n,) [rad/s].
            torque: Mean torques since the last sample, shape (n,) [N·m].
        """
        if not self.watching or not all(np.isfinite(each).all() for each in (t, q, qd, torque)):
            return False
        if self._begin is None or not 0.0 < t - self._last <= GAP:
            self._begin_at(t, q, qd)
            return False
        dt, self._last = t - self._last, t
        y1, y2 = self._arm.Y12(q, qd)
        nominal = self._arm.nominal
        self._sum += dt * (torque - y2 @ nominal + self._missing)
        self._missing = (y1 @ nominal - self._momentum - self._sum) / OBSERVER
        part = dt / OBSERVER
        self._slow += part * (qd - self._slow)
        self._drive += part * (torque - self._drive)
        self._reached += part * (1.0 - self._reached)
        if t - self._compared >= PERIOD * (1.0 - 1e-6):
            self._follow(q, min((t - self._compared) / OBSERVER, 1.0))
            self._compared = t
            self._compare(t, q, qd)
        self._off = self._off or t - self._begin > WATCHED
        return self.misfit is not None

    def _begin_at(self, t: float, q: np.ndarray, qd: np.ndarray) -> None:
        n = self._arm.n
        self._begin = self._last = self._compared = t
        self._momentum = self._arm.Y1(q, qd) @ self._arm.nominal
        self._sum, self._missing, self._drive = np.zeros(n), np.zeros(n), np.zeros(n)
        self._slow, self._reached, self._agree, self._early = qd.copy(), 0.0, 0, None
        self._links, self._tip = np.zeros((3, n, n)), np.zeros((3, n))

    def _follow(self, q: np.ndarray, part: float) -> None:
        """Let the weight of links and of a load at the tip pass the low-pass of r."""
        self._links += part * (self._weights.at(q) - self._links)
        direction = self._arm.payload_direction
        if direction is not None:
            rest = np.zeros(self._arm.n)
            told = self._arm.X(q, rest, rest, rest) @ direction
            self._tip += part * (self._told[:, None] * told / (self._told @ self._told)
                                 - self._tip)

    def _compare(self, t: float, q: np.ndarray, qd: np.ndarray) -> None:
        seen = -self._missing  # torque beyond the nominal arm's
        other = self._other_variance(q, qd)
        without = self._covariance(self._told, other)
        if not (np.isfinite(seen).all() and np.isfinite(without).all()):
            self._off = True  # states beyond reason tell nothing about gravity
            return
        misfit = float(seen @ np.linalg.solve(without, seen))
        early = self._begin is not None and t - self._begin < EARLY
        if misfit < SHOWN and not early:
            self._agree = 0
            return
        gravity, left = self._turned(seen, other)
        if early:
            self._early = gravity
        tilt = _angle(self._told, gravity)
        if (not _explained(misfit, left, tilt) or tilt < SMALLEST
                or not self._was_there(gravity)):
            self._agree = 0
            return
        self._agree += 1
        if self._agree >= SEEN:
            information = np.linalg.inv(without)
            deviation = 1.0 / np.sqrt(np.diag(information))  # where the other joints are known
            worst = int(np.argmax(np.abs(information @ seen) * deviation))
            self.misfit = GravityMisfit(
                t, self._arm.joints[worst], float(seen[worst] / self._reached),
                float(deviation[worst] / self._reached), gravity, tilt)

    def _was_there(self, gravity: np.ndarray) -> bool:
        """Return whether the first moments had asked for about the same gravity."""
        if self._early is None:
            return False
        change = float(np.linalg.norm(gravity - self._told))
        return float(np.linalg.norm(gravity - self._early)) <= AGREE * change

    def _other_variance(self, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """Return the variance of what is neither weight nor load, shape (n,) [N²·m²]."""
        faster = (qd - self._slow) / OBSERVER
        mass = np.abs(self._arm.mass_matrix(q))
        inertia = LINKS * mass @ np.abs(faster) + self._rotor * np.abs(faster)
        rubbing = self._reached * (self._dry + self._viscous * np.abs(qd))
        return np.asarray(LEAST ** 2 + inertia ** 2 + rubbing ** 2 + (DRIVES * self._drive) ** 2)

    def _covariance(self, gravity: np.ndarray, other: np.ndarray) -> np.ndarray:
        links = LINKS * np.einsum('a,aik->ik', gravity, self._links)
        tip = self._load * (gravity @ self._tip)
        return np.asarray(np.diag(other) + links @ links.T + np.outer(tip, tip))

    def _turned(self, seen: np.ndarray, other: np.ndarray) -> tuple[np.ndarray, float]:
        """Return the gravity of the told size that fits best, and D1."""
        size = float(np.linalg.norm(self._told))
        weight = self._links.sum(axis=2).T  # (n, 3)
        best, least, gravity = self._told, np.inf, self._told.copy()
        for _ in range(STEPS):
            covariance = self._covariance(gravity, other)
            error = seen - weight @ (gravity - self._told)
            tilt = _angle(self._told, gravity)
            cost = float(error @ np.linalg.solve(covariance, error)) + (tilt / TILT) ** 2
            if cost < least:
                best, least = gravity, cost
            across = np.linalg.svd(gravity[None])[2][1:].T  # directions that turn it, (3, 2)
            columns = weight @ across
            solved = np.linalg.solve(covariance, columns)
            hessian = columns.T @ solved + np.eye(2) / (TILT * size) ** 2
            pull = across.T @ (gravity - self._told) / (TILT * size) ** 2
            step = np.linalg.solve(hessian, solved.T @ error - pull)
            gravity = gravity + across @ step
            gravity = gravity * (size / np.linalg.norm(gravity))
        return best, least


def _explained(misfit: float, left: float, tilt: float) -> bool:
    """Return whether a turned gravity, and hardly anything else, explains what was seen.

    Args:
        misfit: D0.
        left: D1.
        tilt: Angle of the turn [rad].
    """
    beyond = misfit >= BEYOND and left <= EXPLAINED * misfit
    alike = misfit >= SHOWN and left - (tilt / TILT) ** 2 <= ALIKE * misfit
    return beyond or alike


def gravity_check_of(arm: Arm) -> GravityCheck | None:
    """Return the check of an arm; None where it has no URDF that says what its links weigh."""
    return GravityCheck(arm) if isinstance(arm, UrdfArm) else None


def _angle(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(one, other)), one @ other))
