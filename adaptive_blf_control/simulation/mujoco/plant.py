# SPDX-License-Identifier: Apache-2.0
"""The arm in MuJoCo, as the driver and `simulate` drive it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
import math

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.errors import ArmError
from adaptive_blf_control.parameters.settings import changed_names
from adaptive_blf_control.simulation.actuators import Actuators
from adaptive_blf_control.simulation.mujoco.arm_model import ArmModel
from adaptive_blf_control.simulation.mujoco.library import load_mujoco
from adaptive_blf_control.simulation.mujoco.scene import Scene
from adaptive_blf_control.simulation.plant import Plant
from adaptive_blf_control.simulation.sensors import made_sensor, Measurement, Sensor
from adaptive_blf_control.simulation.settings import PlantSettings
from adaptive_blf_control.simulation.targets import TimedChange
from adaptive_blf_control.simulation.true_arm import Truth
from adaptive_blf_control.simulation.truth_fit import fit_truth, TruthFit

__all__ = ['MujocoPlant']

ROUNDING = 1e-9  # s that summed intervals may differ from the time of a change
# First letters of the parameters that make the scene and can change while it runs.
OF_THE_SCENE = ('true_model', 'true_parameters', 'payload', 'schedule.')


class MujocoPlant(Plant):
    """An arm that MuJoCo moves, with actuators that are late and sensors as everywhere.

    Its inverse dynamics is MuJoCo's; θ* is what fits that best.

    Attributes:
        t: Time since the start [s].
        arm_model: The arm as it is now.
        data: The ``mujoco.MjData``, to look at.
    """

    def __init__(self, settings: PlantSettings, arm: Arm,
                 gravity: Sequence[float] | np.ndarray = (0.0, 0.0, -9.81),
                 sensor: Sensor | type[Sensor] | None = None) -> None:
        """Build the arm at its initial position, without torque.

        Args:
            settings: Those of the driver.
            arm: The arm, with every parameter that θ* may be asked for.
            gravity: In the base frame of an arm that is mounted upright, shape (3,) [m/s²].
            sensor: In place of the sensor that the settings name.

        Raises:
            ParameterError: a value cannot be used, the schedule names what the model does not
                have, or the joint axes are not those of the arm's URDF.
            ArmError: MuJoCo cannot simulate the model.
            MissingExtra: MuJoCo is not installed.
        """
        self._mujoco = load_mujoco()
        self._arm, self._gravity, self._given_sensor = arm, gravity, sensor
        self._settings = settings = settings.resolved(joints=arm.n)
        self.t = 0.0
        self._enter(Scene(settings, arm, gravity), settings.initial_position,
                    settings.initial_velocity)
        self._actuators = Actuators(settings)
        self._sensor = made_sensor(settings.sensors, arm, sensor)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints, in the order of its arrays."""
        return self._arm.joints

    def _enter(self, scene: Scene, q: np.ndarray, qd: np.ndarray) -> None:
        """Go on in a scene from positions q and velocities q̇, shape (n,) [rad, rad/s]."""
        self._changes, self._done = scene.changes, 0
        self._epochs = _epochs(scene.arm_model, scene.changes)
        self._fits: dict[tuple[str, ...], list[TruthFit]] = {}
        self.arm_model, self._surroundings = scene.arm_model, scene.surroundings
        self.data = self._mujoco.MjData(self.arm_model.model)
        self.data.qpos[self.arm_model.position] = q
        self.data.qvel[self.arm_model.velocity] = qd
        self._make_due_changes()

    def retune(self, settings: PlantSettings) -> None:
        """Take another payload, schedule, limit or sensor; state and time stay.

        What does not change goes on as it is, commands under way as well.

        Raises:
            ParameterError: a value cannot be used; nothing has changed.
        """
        before, settings = self._settings, settings.resolved(joints=self._arm.n)
        changed = changed_names(before, settings)
        scene = None
        if any(name.startswith(OF_THE_SCENE) for name in changed):
            scene = Scene(settings, self._arm, self._gravity)
        if settings.sensors != before.sensors:
            self._sensor = made_sensor(settings.sensors, self._arm, self._given_sensor)
        if scene is not None:
            touched = self._surroundings.touched
            self._enter(scene, self.q, self.qd)
            self._surroundings.touched = touched
        self._actuators.retune(settings)
        self._settings = settings

    @property
    def q(self) -> np.ndarray:  # type: ignore[override]
        """True positions, shape (n,) [rad]."""
        return np.asarray(self.data.qpos[self.arm_model.position])

    @property
    def qd(self) -> np.ndarray:  # type: ignore[override]
        """True velocities, shape (n,) [rad/s]."""
        return np.asarray(self.data.qvel[self.arm_model.velocity])

    @property
    def torque(self) -> np.ndarray:  # type: ignore[override]
        """Torque that acts now, shape (n,) [N·m]."""
        return self._actuators.torque

    @property
    def touched(self) -> tuple[tuple[float, float], ...]:
        """Intervals of contact up to now, (begin, end) [s]."""
        return tuple(self._surroundings.touched)

    def measure(self, torque: np.ndarray, dt: float) -> Measurement:
        """Take a sample; see `Plant`.

        The torque is what the actuators measure, see `Actuators.sample`, except for an interval
        of 0 s: before the first motion there is none.
        """
        measured = self._actuators.sample(self.t)
        torque = measured if dt > 0.0 else torque
        return self._sensor.measure(self.q, self.qd, torque, dt)

    def measured_position(self) -> np.ndarray:
        """Return what the sensors show of q now, shape (n,) [rad]; it is no sample."""
        return self._sensor.position(self.q)

    def apply(self, torque: np.ndarray) -> None:
        """Command a torque, shape (n,) [N·m]; it acts after the delay of the actuators."""
        self._actuators.command(self.t, torque)

    def advance(self, dt: float) -> None:
        """Move on by ``dt`` [s], exactly to each change and each command that comes to act.

        Raises:
            ArmError: the simulation has diverged.
        """
        end = self.t + dt
        while self.t < end - ROUNDING:
            self._make_due_changes()
            self._actuators.advance_to(self.t + ROUNDING)
            self._move(min(end, self._next_change, self._actuators.next_switch))
        self._make_due_changes()
        self._actuators.advance_to(self.t + ROUNDING)

    def brake(self) -> None:
        """Hold the arm where it is, without torque."""
        self._actuators.stop()
        self.data.qvel[:] = self.data.qacc_warmstart[:] = 0.0

    def inverse_dynamics(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray,
                         t: float | None = None) -> np.ndarray:
        """Return the torque that a motion needs, shape (n,) [N·m]; see `ArmModel`.

        Args:
            q: Positions, shape (n,) [rad].
            qd: Velocities, shape (n,) [rad/s].
            qdd: Accelerations, shape (n,) [rad/s²].
            t: Time of the schedule whose arm it is [s]; now where None.
        """
        now = self.t if t is None else t
        model = [model for begin, model in self._epochs if begin <= now + ROUNDING][-1]
        return model.inverse_dynamics(q, qd, qdd)

    def truth(self, parameters: Sequence[str] | None = None) -> Truth:
        """Return (t, θ*) of each epoch, θ* being what fits its inverse dynamics best."""
        fits = self.fits(self._arm.parameters if parameters is None else parameters)
        return tuple((t, fit.theta) for (t, _), fit in zip(self._epochs, fits))

    def fits(self, parameters: Sequence[str]) -> list[TruthFit]:
        """Return the fit of each epoch, with what the parameters cannot express."""
        key = tuple(parameters)
        if key not in self._fits:
            self._fits[key] = [fit_truth(self._arm, key, model.inverse_dynamics)
                               for _, model in self._epochs]
        return self._fits[key]

    @property
    def _next_change(self) -> float:
        return self._changes[self._done].t if self._done < len(self._changes) else math.inf

    def _make_due_changes(self) -> None:
        first = self._done
        while self._next_change <= self.t + ROUNDING:
            self._done += 1
        due = self._changes[first:self._done]
        self.arm_model.set(change for change in due if change.target.of_the_arm)
        for change in due:
            if not change.target.of_the_arm:
                self._surroundings.set(self.data, change.target, change.value)

    def _move(self, until: float) -> None:
        """Move on under one torque, in equal steps."""
        model, data, outside = self.arm_model, self.data, self._surroundings
        steps = max(math.ceil((until - self.t) / self._settings.mujoco.step - 1e-6), 1)
        step = model.model.opt.timestep = (until - self.t) / steps
        torque = self._actuators.torque
        data.qfrc_applied[model.velocity] = torque - model.offset
        if outside.act or model.square_root.any():
            for k in range(steps):
                data.qfrc_applied[model.velocity] = (
                    torque - model.resistance(self.qd) + outside.torque(data)[model.velocity])
                self._mujoco.mj_step(model.model, data)
                outside.watch(data, self.t + k * step, self.t + (k + 1) * step)
        else:
            self._mujoco.mj_step(model.model, data, steps)
        if not np.all(np.isfinite(data.qvel)):
            raise ArmError(f'MuJoCo diverges at {self.t:.4f} s with the torque '
                           f'{torque.tolist()}')
        self._actuators.act(until - self.t)
        self.t = until


def _epochs(model: ArmModel, changes: Iterable[TimedChange]) -> list[tuple[float, ArmModel]]:
    """Return the arm over time, (begin [s], model)."""
    epochs = [(0.0, model.copy())]
    for t in sorted({change.t for change in changes if change.target.of_the_arm}):
        following = epochs[-1][1].copy()
        following.set(change for change in changes
                      if change.t == t and change.target.of_the_arm)
        epochs = [each for each in epochs if each[0] != t] + [(t, following)]
    return epochs
