# SPDX-License-Identifier: Apache-2.0
"""The safety filter ``limits``: made of settings, asked once a sample."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
import copy

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.compiled import handle
from adaptive_blf_control.control.constraints import Constraint
from adaptive_blf_control.control.safety_filter import FilterSample
from adaptive_blf_control.control.settings import ControllerSettings
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.limits.acceleration_error import no_posture
from adaptive_blf_control.limits.braking import Asked, checked_braking, Resting
from adaptive_blf_control.limits.cause_intervals import CauseBounds
from adaptive_blf_control.limits.filter_look import (
    FilterParts,
    JointLimits,
    Moment,
    Scene,
    Stop,
)
from adaptive_blf_control.limits.filter_step import filter_step, IDLE, Report, SOFTENED
from adaptive_blf_control.limits.governor import Governor, LEAD, SPEED_PART
from adaptive_blf_control.limits.limit_constraints import (
    ClearanceConstraint,
    FARTHEST,
    VelocityConstraint,
)
from adaptive_blf_control.limits.moving_obstacles import MovingObstacles
from adaptive_blf_control.limits.obstacles import joined, Obstacles
from adaptive_blf_control.limits.pace import Pace
from adaptive_blf_control.limits.prediction import Prediction
from adaptive_blf_control.limits.scene import scene_of, scene_with
from adaptive_blf_control.limits.set_model import SetModel

__all__ = ['LimitsFilter']

KINDS = ('let through', 'filtered', 'braking', 'softened')
LONGEST = 0.1
"""A longer time between two samples is a gap and says nothing about the next one [s]."""


class LimitsFilter:
    """Lets through what keeps velocities, positions and obstacles for every θ* of the prior.

    Attributes:
        limits: Of the joints.
        constraints: Velocities, and distances from obstacles.
        governor: Of the reference; None where ``limits.govern`` is off.
        report: Of the last sample; None before the first.
        counts: How many samples were idle, active, braking and softened.
        watched: What `watch` returns.
    """

    def __init__(self, arm: Arm, settings: ControllerSettings) -> None:
        """Make the model and check that the braking is possible.

        Args:
            arm: One that compiled functions know.
            settings: With arrays of full length.

        Raises:
            ParameterError: a value cannot be used, or the torque limit does not allow the
                braking; the posture is named.
            ArmError: the arm has no arrays, or no inertia with a θ of the prior.
        """
        self._arm = arm
        self.report: Report | None = None
        self._state: tuple[np.ndarray, np.ndarray] | None = None
        self._t = np.inf  # no sample was before
        self.counts = [0, 0, 0, 0]
        self.watched = (*(f'{joint}.reserve' for joint in arm.joints), 'clearance',
                        'stop_clearance', 'path_rate', 'path_off', 'kind')
        self._worst: tuple[np.ndarray, tuple[float, ...]] | None = None
        self._moving = MovingObstacles(settings.limits.obstacles)
        self._shown: Scene | None = None
        self.model = SetModel(arm, settings.limits.prior)
        self._heard: float | None = None  # when the model was narrowed; None: it is the prior
        self._ahead = Prediction(arm.n, settings.loop.delay)
        self._take(settings)

    def _take(self, settings: ControllerSettings) -> None:
        limits, safety = settings.limits, settings.safety
        speed = _speed(self._arm, limits.velocity)
        braking = checked_braking(
            Resting(self._arm, self.model.prior, limits.prior.unexplained,
                    settings.torque_limit),
            Asked(limits.braking, limits.braking_rule, speed, safety.lower, safety.upper))
        self.limits = JointLimits(safety.lower.copy(), safety.upper.copy(), speed, braking)
        scene = self._scene = scene_of(self._arm, limits)
        self._shown = None
        self._margin = limits.obstacles.margin
        self._moving = self._moving.retuned(limits.obstacles)
        self.constraints: tuple[Constraint, ...] = (
            VelocityConstraint(self._arm.joints, self.limits.speed),)
        if scene.spheres.radius.size:
            self._near = ClearanceConstraint(scene)
            self.constraints = (*self.constraints, self._near)
        self._period = limits.period or 1.0 / settings.loop.rate
        self._learns, self._believed = limits.learn, limits.learn_timeout
        self._parts = handle(FilterParts(self.model.handle, handle(scene), self.limits, 0.0, False,
                                         no_posture(self._arm.n)))
        self.governor: Governor | None = None
        if limits.govern:
            self.governor = self._governor(settings, scene)

    def _governor(self, settings: ControllerSettings, scene: Scene) -> Governor:
        """Return the governor of a new motion, with limits that leave room for e1."""
        safety, performance = settings.safety, settings.performance
        narrow = self.limits._replace(
            lower=safety.lower - performance.lower, upper=safety.upper - performance.upper,
            speed=SPEED_PART * self.limits.speed)
        return Governor(
            Pace(self._arm, self.model.known, self.limits.speed, settings.torque_limit,
                 slowly=settings.limits.braking_rule == 'short_stops'),
            self._parts.value._replace(scene=handle(self._wider(scene)), limits=narrow,
                                       lead=LEAD),
            self._period)

    def _wider(self, scene: Scene) -> Scene:
        """Return the scene that the reference keeps clear of."""
        return scene._replace(spheres=scene.spheres._replace(
            radius=scene.spheres.radius + self._margin))

    def see(self, seen: Mapping[Hashable, Obstacles], gone: frozenset[Hashable] | None) -> None:
        """Take obstacles that move, see `MovingObstacles.update`, at the time of the last sample.

        They are there from the next sample on. What is there cannot be refused: an arm that they
        come too close to brakes, and the clearance says so.
        """
        if self._scene.spheres.body.size:
            self._moving.update(self._t if np.isfinite(self._t) else 0.0, seen, gone)

    def narrow(self, bounds: CauseBounds | None) -> None:
        """Take what is known of each cause of the prior for sure; None for no more than that.

        It counts for ``limits.learn_timeout`` from the last sample on.

        Raises:
            ParameterError: the bounds are not of the prior's causes, or exclude it; the filter
                goes on with the prior.
        """
        try:
            model = self.model.narrowed(bounds)
        except ParameterError:
            self.narrow(None)
            raise
        self._heard = None if bounds is None else self._t
        if model is self.model:
            return
        self.model = model
        self._parts = handle(self._parts.value._replace(model=model.handle))
        if self.governor is not None:
            self.governor.narrow(model.handle, model.known)

    def _look(self, t: float) -> None:
        """Put the obstacles that move where they are at ``t`` [s]."""
        if self._moving.heard is None:
            return
        still, shown = self._scene, self._shown
        obstacles = joined([still.obstacles, self._moving.at(t)])
        if shown is None or not _alike(obstacles, shown.obstacles):
            shown = self._show(scene_with(still.chain, still.spheres, obstacles,
                                          still.pairs[still.pairs[:, 1] < 0]))
        else:  # the handles point at these arrays: to make others would take longer than the rest
            for column, values in zip(shown.obstacles, obstacles):
                column[...] = values
        self._near.scene = shown
        if self.governor is not None:
            self.governor.waits = self._moving.silent(t)

    def _show(self, scene: Scene) -> Scene:
        """Show filter and governor a scene whose obstacles this filter, and no other, may move."""
        self._shown = scene
        self._parts = handle(self._parts.value._replace(scene=handle(scene)))
        if self.governor is not None:
            self.governor.look(self._wider(scene))
        return scene

    def retuned(self, settings: ControllerSettings) -> LimitsFilter:
        """Return the filter that goes on with other settings.

        Raises:
            ParameterError: the state of the last sample does not allow them, with numbers.
        """
        other = copy.copy(self)
        other._take(settings)
        if other.governor is not None and self.governor is not None:
            other.governor.go_on_from(self.governor)
        if self._state is not None:
            check_state(self._arm, other.limits, *self._state)
            other._check_clearance(settings)
        return other

    def _check_clearance(self, settings: ControllerSettings) -> None:
        """Refuse obstacles that the arm touches, or cannot stop before."""
        if self._state is None:
            return
        q, qd = self._state
        limit = settings.torque_limit.copy()
        report = filter_step(self._parts, Moment(q, qd, -limit, limit, self._period),
                             np.zeros_like(q), Stop(q, qd, np.zeros_like(q)), 0.0)
        if report.stop_clearance < 0.0 and report.clearance < np.inf:
            raise ParameterError(
                'controller.limits.obstacles', settings.limits.obstacles.values(),
                f'obstacles that the arm stops before: at q = {np.round(q, 3).tolist()} rad it is '
                f'{report.clearance:.3g} m from one, {report.stop_clearance:.3g} m when it stands')

    @property
    def complaint(self) -> str:
        """Why the limits were not kept for every θ at the last sample, '' where they were."""
        report = self.report
        if self._moving.silent(self._t):
            return 'nothing was heard of the obstacles that move: the reference comes to rest'
        if report is None or report.kind != SOFTENED:
            return ''
        joint = int(np.argmin(report.reserve))
        return (f'no torque within the limits keeps velocity, position and obstacles for every '
                f'theta of the prior: they give way as little as they can; reserve of '
                f'{self._arm.joints[joint]} {report.reserve[joint]:.4g} N*m, clearance when the '
                f'arm stands {report.stop_clearance:.4g} m')

    def status(self) -> dict[str, object]:
        """Return what the filter and the governor do, for the diagnostics."""
        values: dict[str, object] = {
            f'samples {word}': count for word, count in zip(KINDS, self.counts)}
        if self.report is not None:
            values.update((f'{joint} reserve [N*m]', f'{value:.6g}')
                          for joint, value in zip(self._arm.joints, self.report.reserve))
            values['clearance when stopped [m]'] = f'{self.report.stop_clearance:.6g}'
        if self._learns:
            values['parameter set'] = 'the prior' if self._heard is None else (
                f'{100.0 * self.model.part:.3g} % of the prior in the mean of the causes')
        if self.governor is not None:
            values['rate of the path'] = f'{self.governor.pace.rate:.6g}'
        return values

    def __copy__(self) -> LimitsFilter:
        """Return a filter that goes on from here without a trace in this one."""
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__)
        other._ahead = copy.deepcopy(self._ahead)
        other.governor = copy.copy(self.governor)
        return other

    def filtered(self, sample: FilterSample) -> np.ndarray:
        """Return the torque to command, see `SafetyFilter`.

        The torque is taken to act after ``loop.delay``, for ``limits.period``, or as long as the
        one before was where that is longer.
        """
        held = sample.t - self._t
        self._look(sample.t)
        self._believe(sample.t)
        q, qd = self._ahead.state(self._parts, sample.t, sample.q, sample.qd)
        period = self._period
        if period < held <= LONGEST:
            period = held
        left = Stop(q, qd, np.zeros_like(q))
        if self.report is not None and 0.0 < held <= LONGEST:  # after a gap there is none
            left = self.report.stop
        else:
            held = 0.0
        at = Moment(q, qd, sample.least, sample.most, period)
        report = self.report = filter_step(self._parts, at, sample.torque, left, held)
        self.counts = [count + (kind == report.kind) for kind, count in enumerate(self.counts)]
        self._t, self._state = sample.t, (sample.q.copy(), sample.qd.copy())
        self._note(report)
        answer = sample.torque if report.kind == IDLE else report.torque
        self._ahead.commanded(sample.t, answer)
        return answer

    def _believe(self, t: float) -> None:
        """Take the prior again where nothing was heard of what is known for too long."""
        if self._heard is not None:
            self._heard = min(self._heard, t)
            if t - self._heard > self._believed:
                self.narrow(None)

    def _note(self, report: Report) -> None:
        """Keep the worst of what is watched: the least, of what counts up the largest."""
        governor = self.governor
        reserve = report.reserve
        others: tuple[float, ...] = (
            min(report.clearance, FARTHEST), min(report.stop_clearance, FARTHEST),
            1.0 if governor is None else governor.pace.rate,
            0.0 if governor is None else -governor.off, -float(report.kind))
        if self._worst is not None:
            reserve = np.minimum(self._worst[0], reserve)
            others = tuple(map(min, self._worst[1], others))
        self._worst = reserve, others

    def watch(self) -> np.ndarray:
        """Return the worst of each of ``watched`` since the last call; NaN without a sample."""
        if self._worst is None:
            return np.full(len(self.watched), np.nan)
        reserve, others = self._worst
        self._worst = None
        return np.array([*reserve, *others[:-2], -others[-2], -others[-1]])


def check_state(arm: Arm, limits: JointLimits, q: np.ndarray, qd: np.ndarray) -> None:
    """Raise ParameterError where a state, (n,) and (n,), does not allow the limits of the joints.

    The safety set itself is checked by the controller.
    """
    stop = q + qd * np.abs(qd) / (2.0 * limits.braking)
    for i, joint in enumerate(arm.joints):
        if abs(qd[i]) > limits.speed[i]:
            raise ParameterError('controller.limits.velocity', limits.speed.tolist(),
                                 f'at least the present {abs(qd[i]):.4g} rad/s of {joint}')
        if not limits.lower[i] <= stop[i] <= limits.upper[i]:
            raise ParameterError(
                'controller.limits.braking', limits.braking.tolist(),
                f'braking that stops {joint} in its safety set {limits.lower[i]:.4g} .. '
                f'{limits.upper[i]:.4g} rad: from {q[i]:.4g} rad at {qd[i]:.4g} rad/s it stands '
                f'at {stop[i]:.4g} rad')


def _alike(obstacles: Obstacles, others: Obstacles) -> bool:
    """Return whether as many obstacles are there, and the same ones of them move."""
    return obstacles.radius.size == others.radius.size and bool(
        (obstacles.velocity.any(axis=1) == others.velocity.any(axis=1)).all())


def _speed(arm: Arm, velocity: np.ndarray) -> np.ndarray:
    """Return the largest velocities, shape (n,) [rad/s]."""
    own = np.broadcast_to(getattr(arm, 'velocity_limit', np.inf), arm.n)
    speed = np.where(velocity > 0.0, velocity, own)
    if not np.isfinite(speed).all():
        raise ParameterError('controller.limits.velocity', velocity.tolist(),
                             'a velocity > 0 rad/s for every joint whose URDF gives none')
    return speed
