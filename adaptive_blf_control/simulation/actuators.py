# SPDX-License-Identifier: Apache-2.0
"""The actuators of a simulated arm: a command is limited, acts later, and with a wrong gain.

`Actuators` holds the arrays between samples; the closed loop calls the functions itself, for many
samples in one compiled function.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.compiled import borrowed, jitable
from adaptive_blf_control.control.law import limited
from adaptive_blf_control.simulation.delay_line import delayed, DelayLine, new_delay_line
from adaptive_blf_control.simulation.settings import PlantSettings

__all__ = ['ActuatorArrays', 'Actuators', 'CommandQueue', 'acting_torque', 'command',
           'idle_actuators', 'let_act', 'measured_torque', 'next_switch', 'note_span']

FIRST, COUNT = range(2)  # elements of `CommandQueue.ends`
CAPACITY = 16  # commands that can be under way at first


class CommandQueue(NamedTuple):
    """Commands under way in the order in which they were given, a ring of room for C.

    Attributes:
        times: When each may act, shape (C,) [s].
        torques: Shape (C, n) [N·m].
        ends: By name: place of the FIRST one, and their COUNT, shape (2,).
    """

    times: np.ndarray
    torques: np.ndarray
    ends: np.ndarray


class ActuatorArrays(NamedTuple):
    """Actuators as compiled functions take them; arrays of shape (n,), changed in place.

    Attributes:
        acting: Torque that acts, but for the gain [N·m].
        commanded: Commanded last, within the limit [N·m].
        limit: Where the drives saturate [N·m].
        gain: What acts of what the actuators take it to be.
        bias: Constant error of the measured torque [N·m].
        impulse: What has acted since the last sample [N·m·s].
        span: For how long, shape (1,) [s].
        delay: After which a command acts [s].
        jitter: Largest further delay [s].
        mean: Whether the mean since the last sample is measured; else what acts at the sample.
        waits: Whether there is a dead time in samples.
        line: Commands in that dead time.
        queue: Commands under way after it.
        random: Where the jitter comes from.
    """

    acting: np.ndarray
    commanded: np.ndarray
    limit: np.ndarray
    gain: np.ndarray
    bias: np.ndarray
    impulse: np.ndarray
    span: np.ndarray
    delay: float
    jitter: float
    mean: bool
    waits: bool
    line: DelayLine
    queue: CommandQueue
    random: np.random.Generator


def idle_actuators(n: int) -> ActuatorArrays:
    """Return actuators of ``n`` joints that do nothing to a command."""
    nothing = [np.zeros(n) for _ in range(4)]
    queue = CommandQueue(np.empty(CAPACITY), np.empty((CAPACITY, n)), np.zeros(2, dtype=np.intp))
    return ActuatorArrays(
        acting=nothing[0], commanded=nothing[1], limit=np.full(n, np.inf), gain=np.ones(n),
        bias=nothing[2], impulse=nothing[3], span=np.zeros(1), delay=0.0, jitter=0.0, mean=True,
        waits=False, line=new_delay_line(1, nothing[1]), queue=queue,
        random=np.random.default_rng(0))


@jitable
def acting_torque(actuators: ActuatorArrays) -> np.ndarray:
    """Return the torque that acts now, shape (n,) [N·m]."""
    actuators = borrowed(actuators)
    return actuators.gain * actuators.acting


@jitable
def next_switch(actuators: ActuatorArrays) -> float:
    """Return the time from which the next command acts [s]; infinity without one under way."""
    queue = borrowed(actuators).queue
    return queue.times[queue.ends[FIRST]] if queue.ends[COUNT] > 0 else math.inf


@jitable
def let_act(actuators: ActuatorArrays, t: float) -> None:
    """Let act what is due at ``t`` [s]."""
    actuators = borrowed(actuators)
    queue, acting = actuators.queue, actuators.acting
    ends, times = queue.ends, queue.times
    while ends[COUNT] > 0 and times[ends[FIRST]] <= t:
        acting[:] = queue.torques[ends[FIRST]]
        ends[FIRST] = (ends[FIRST] + 1) % times.size
        ends[COUNT] -= 1


@jitable
def _send(actuators: ActuatorArrays, t: float, torque: np.ndarray) -> None:
    actuators = borrowed(actuators)
    queue = actuators.queue
    late = actuators.jitter * actuators.random.random() if actuators.jitter > 0.0 else 0.0
    place = (queue.ends[FIRST] + queue.ends[COUNT]) % queue.times.size
    queue.times[place] = t + actuators.delay + late
    queue.torques[place] = torque
    queue.ends[COUNT] += 1
    let_act(actuators, t)


@jitable
def command(actuators: ActuatorArrays, t: float, torque: np.ndarray) -> None:
    """Take a command of time ``t`` [s], shape (n,) [N·m]; the queue has room for it."""
    actuators = borrowed(actuators)
    actuators.commanded[:] = limited(torque, actuators.limit)
    if not actuators.waits:
        _send(actuators, t, actuators.commanded)


@jitable
def note_span(actuators: ActuatorArrays, dt: float) -> None:
    """Note that the present torque has acted for ``dt`` [s]."""
    actuators = borrowed(actuators)
    actuators.impulse[:] += dt * actuators.acting
    actuators.span[0] += dt


@jitable
def measured_torque(actuators: ActuatorArrays, t: float) -> np.ndarray:
    """Return what is measured at ``t`` [s] of the time since the last sample, (n,) [N·m].

    Then the command whose dead time ends with the sample goes on its way.
    """
    actuators = borrowed(actuators)
    span = actuators.span[0]
    if actuators.mean and span > 0.0:
        measured = actuators.impulse / span
    else:
        measured = actuators.acting.copy()
    actuators.impulse[:] = 0.0
    actuators.span[0] = 0.0
    if actuators.waits:
        due = np.empty_like(measured)
        delayed(actuators.line, actuators.commanded, due)
        _send(actuators, t, due)
    return measured + actuators.bias


class Actuators:
    """Commands on their way to the joints, in the order in which they were given.

    A command of time t acts from t + delay + jitter·u on, u drawn uniformly from [0, 1) for each
    command; one that would overtake an older one acts together with it. With a dead time t is the
    time of the sample so many samples later. What acts is (1 + gain_error) times what the
    actuators take it to be, and measure.

    Attributes:
        arrays: Their state; what is given away of it is changed in place.
    """

    def __init__(self, settings: PlantSettings) -> None:
        """Start without torque; arrays of the settings are of shape (n,)."""
        actuator = settings.actuator
        self.arrays = idle_actuators(settings.torque_limit.size)._replace(
            gain=1.0 + actuator.gain_error, bias=actuator.torque_bias.copy(),
            delay=float(actuator.delay), jitter=float(actuator.jitter),
            mean=actuator.effort == 'mean', random=np.random.default_rng(actuator.seed))
        self._dead_time = 0
        self.retune(settings)
        limited(self.arrays.commanded, self.arrays.limit)  # compiles it before it is urgent

    def retune(self, settings: PlantSettings) -> None:
        """Take another limit and dead time; what was commanded last is under way for that long."""
        self.arrays.limit[:] = settings.torque_limit
        if settings.dead_time != self._dead_time:
            self._dead_time = settings.dead_time
            self.arrays = self.arrays._replace(
                waits=settings.dead_time > 0,
                line=new_delay_line(max(settings.dead_time, 1), self.arrays.commanded))

    def reserve(self, commands: int) -> None:
        """Make room for so many commands more."""
        queue = self.arrays.queue
        count = queue.ends[COUNT]
        if count + commands <= queue.times.size:
            return
        places = (queue.ends[FIRST] + np.arange(count)) % queue.times.size
        times, torques = (np.empty((2 * (count + commands), *each.shape[1:]))
                          for each in (queue.times, queue.torques))
        times[:count], torques[:count] = queue.times[places], queue.torques[places]
        self.arrays = self.arrays._replace(queue=CommandQueue(
            times, torques, np.array([0, count], dtype=np.intp)))

    @property
    def torque(self) -> np.ndarray:
        """Torque that acts now, shape (n,) [N·m]."""
        return acting_torque(self.arrays)

    @property
    def next_switch(self) -> float:
        """Time from which the next command acts [s]; infinity where none is on its way."""
        return next_switch(self.arrays)

    def command(self, t: float, torque: np.ndarray) -> None:
        """Take a command of time ``t`` [s], shape (n,) [N·m]."""
        self.reserve(1)
        command(self.arrays, t, torque)

    def advance_to(self, t: float) -> None:
        """Let act what is due at ``t`` [s]."""
        let_act(self.arrays, t)

    def act(self, dt: float) -> None:
        """Note that the present torque has acted for ``dt`` [s]."""
        note_span(self.arrays, dt)

    def sample(self, t: float) -> np.ndarray:
        """Return the torque that is measured of the time since the last sample, (n,) [N·m].

        Its mean, or with ``effort: instant`` that of now; without the error of the gain. Then the
        command whose dead time ends with the sample goes on its way.

        Args:
            t: Time of the sample [s].
        """
        self.reserve(1)
        return measured_torque(self.arrays, t)

    def stop(self) -> None:
        """Drop every command, without torque from now on."""
        for each in (self.arrays.queue.ends, self.arrays.acting, self.arrays.commanded,
                     self.arrays.line.commands):
            each[:] = 0
