# SPDX-License-Identifier: Apache-2.0
"""The driver's loop under ``use_sim_time``: no step before all nodes have answered the last state.

Order within a sample: /clock and the state go out; the controller answers with a command and the
adaptation term of that stamp, the identifier with the estimate of that stamp; then the arm moves
on. That is the order of :class:`adaptive_blf_control.simulation.closed_loop.ClosedLoop`, and the
same objects compute it, so that a run equals ``simulate`` and the run before it bit by bit.
"""

from __future__ import annotations

from collections.abc import Callable
import time

from builtin_interfaces.msg import Time
import numpy as np
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.configuration.node_settings import DriverSettings
from adaptive_blf_control.errors import BlfError
from adaptive_blf_control.messages.topics import ADAPTATION_TERM, CLOCK, JOINT_STATES, THETA_HAT
from adaptive_blf_control.nodes.lockstep_answers import LockstepAnswers
from adaptive_blf_control.runtime.endpoints import full_name, process_of
from adaptive_blf_control.runtime.managed_node import ManagedNode
from adaptive_blf_control.simulation.drives import Drives
from adaptive_blf_control.simulation.state_grid import StateGrid

__all__ = ['EPOCH_NS', 'ArmLockstep', 'LockstepTimeout', 'SteppedDriver']

EPOCH_NS = 10**9  # stamp of the first state: 0 means "no time yet" in ROS
CLOCK_QUEUE_DEPTH = 10
ANSWERS = {'controller': ADAPTATION_TERM, 'identifier': THETA_HAT}


class LockstepTimeout(BlfError, TimeoutError):
    """A node has not answered a state in time; the message names it."""


class SteppedDriver(ManagedNode[DriverSettings]):
    """What the lockstep needs of the driver that it steps.

    Attributes:
        arm: The arm, for its joints.
        drives: What moves the arm.
        grid: Period of the states.
    """

    arm: Arm
    drives: Drives
    grid: StateGrid

    @property
    def serves(self) -> bool:
        """Whether the node is configured and has not been asked to stop."""
        raise NotImplementedError

    def heard_by(self, count: int) -> bool:
        """Whether at least ``count`` subscribe to the joint states."""
        raise NotImplementedError

    def send_state(self, stamp_ns: int, effort: np.ndarray, interval: float) -> None:
        """Measure and publish; ``effort`` is the mean torque over the ``interval`` [s] before."""
        raise NotImplementedError


class ArmLockstep:
    """Steps the arm of a driver once every state has its answers.

    Attributes:
        answers: Those to the present state.
    """

    def __init__(self, driver: SteppedDriver) -> None:
        """Subscribe to the answers that are asked for."""
        self._driver = driver
        names = driver.settings.lockstep.answers
        self._time_topic = driver.create_publisher(Clock, CLOCK, CLOCK_QUEUE_DEPTH)
        self._open = True
        self.answers = LockstepAnswers(names, driver.arm.n)
        self._inputs = {name: driver.topics.subscribe(
            JointState, ANSWERS[name], self._hears(name), reliable=True) for name in names}

    def _hears(self, name: str) -> Callable[[bytes, dict[str, int]], None]:
        return lambda data, _: self.answers.hear(name, data)

    def close(self) -> None:
        """Destroy the topics and end the loop."""
        self._open = False
        for subscription in self._inputs.values():
            self._driver.topics.unsubscribe(subscription)
        self._driver.destroy_publisher(self._time_topic)

    @property
    def _goes_on(self) -> bool:
        return self._open and self._driver.serves

    def loop(self) -> bool:
        """Run until the duration is over (True) or the driver does not serve any longer.

        Raises:
            LockstepTimeout: a node does not answer; names it.
        """
        driver = self._driver
        self._wait(self._missing_nodes, 'is not there')
        begin = due = time.monotonic()
        stamp_ns = first_ns = EPOCH_NS
        k, period_ns, interval = 0, driver.grid.period_ns, 0.0
        while self._goes_on:
            while self._goes_on and not driver.active:
                driver.spin_data(0.01)
            with driver.between_samples:
                if not self._goes_on:
                    break
                self._send(stamp_ns, interval)
            self._wait(self.answers.missing,
                       f'has not answered the state of {stamp_ns * 1e-9:.6f} s')
            with driver.between_samples:
                if driver.grid.period_ns != period_ns:  # a live rate begins a new grid
                    k, period_ns, first_ns = 0, driver.grid.period_ns, stamp_ns
                interval = 1.0 / driver.settings.rate
                if driver.active:  # else the brakes hold
                    driver.drives.step(self.answers.torque, interval)
            t = (stamp_ns - EPOCH_NS) * 1e-9
            if 0.0 < driver.settings.duration <= t + 0.5 * interval:
                driver.get_logger().info(f'duration of {driver.settings.duration:g} s is over, '
                                         f'in {time.monotonic() - begin:.1f} s of real time')
                return True
            k += 1
            stamp_ns = first_ns + round(k * interval * 1e9)
            due = self._pace(due, interval)
        return False

    def _send(self, stamp_ns: int, interval: float) -> None:
        self.answers.expect(stamp_ns)
        self._time_topic.publish(
            Clock(clock=Time(sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)))
        self._driver.send_state(stamp_ns, self._driver.drives.plant.torque, interval)
        self._driver.sampled(stamp_ns)

    def _pace(self, due: float, interval: float) -> float:
        """Wait until the next step is due at ``lockstep.rate`` times real time; return when."""
        pace, now = self._driver.settings.lockstep.rate, time.monotonic()
        if pace <= 0.0:
            return now
        due = max(due + interval / pace, now)  # a pause is not caught up
        while self._driver.up and (left := due - time.monotonic()) > 0.0:
            self._driver.stop.wait(min(left, 0.05))
        return due

    def _missing_nodes(self) -> list[str]:
        """Return the nodes not discovered in both directions: each is discovered by itself.

        In one process (``arm_control``) one of the nodes hears the states for both.
        """
        driver = self._driver
        hearing = {full_name(info) or ''  # '' while the name is not known yet
                   for info in driver.get_subscriptions_info_by_topic(JOINT_STATES)}
        if not driver.heard_by(len(hearing)):  # discovered, and not matched yet
            return list(self._inputs)
        answering = {name: driver.get_publishers_info_by_topic(ANSWERS[name])
                     for name in self._inputs}
        processes = {process_of(info) for found in answering.values() for info in found
                     if full_name(info) in hearing}
        return [name for name, subscription in self._inputs.items()
                if subscription.get_publisher_count() == 0
                or not any(process_of(info) in processes for info in answering[name])]

    def _wait(self, missing: Callable[[], list[str]], what: str) -> None:
        driver = self._driver
        timeout = driver.settings.lockstep.timeout
        give_up = time.monotonic() + timeout
        while self._goes_on and (names := missing()):
            if time.monotonic() > give_up:
                raise LockstepTimeout(f'{", ".join(names)} {what} within {timeout:g} s: '
                                      f'is it active, with use_sim_time: true?')
            driver.spin_data(0.01)
