# SPDX-License-Identifier: Apache-2.0
"""The controller's command topic: claimed, used, brought to zero and released."""

from __future__ import annotations

from functools import partial
import math
import time

import numpy as np
from rclpy.duration import Duration
from rclpy.publisher import Publisher
from std_msgs.msg import Float64MultiArray

from adaptive_blf_control.configuration.node_settings import ControllerNodeSettings
from adaptive_blf_control.control.ramp import ramp_down, RAMP_STEP
from adaptive_blf_control.errors import BlfError
from adaptive_blf_control.messages.cdr import Float64MultiArrayCodec
from adaptive_blf_control.messages.topics import ADAPTATION_TERM, COMMANDS
from adaptive_blf_control.runtime.data_node import DataNode
from adaptive_blf_control.runtime.endpoints import Endpoints, UNNAMED

__all__ = ['CommandTopic', 'GIVE_WAY', 'KNOWN']

UNHEARD = 0.02  # s of a motion after which its torques have to be confirmed
UNHEARD_LONGEST = 1.0  # s; a listener that was killed is shown for longer, and confirms nothing
GIVE_WAY = 3.0  # s after a claim in which discovery may still show another controller
DELIVERY_TIMEOUT = Duration(seconds=0.1)  # for the zero torque: sent is not delivered yet
AT_ONCE, CONFIRMATION = Duration(), Duration(seconds=0.015)  # DDS confirms after 5 ms
# s of commands that DDS keeps. It asks for a confirmation of each once that many have been sent,
# and confirms within that time, so that one that was lost on the way can still be sent again.
HISTORY = 0.01
KNOWN = 100  # torques after which the quickest is known: the first of a process takes long


class CommandTopic:
    """Torques for the arm, from one controller at a time.

    Attributes:
        claimed_at: When it was claimed, monotonic [s].
        pushes: Whether a torque was sent after the last final zero.
        confirmed: Whether torques of this motion have reached all who are shown as listeners.
        senders: Who publishes commands.
        listeners: Who subscribes to them.
    """

    def __init__(self, node: DataNode[ControllerNodeSettings], n: int) -> None:
        """Prepare to send torques for ``n`` joints without claiming the topic of ``node``."""
        self.claimed_at = 0.0
        self.pushes = False
        self._node = node
        self._codec = Float64MultiArrayCodec(n, node.label)
        self._n = n
        self._publisher: Publisher | None = None
        self.confirmed = False
        self._first_at = self._begun_at = 0.0
        self._sent = 0
        self._asked_at: float | None = None  # monotonic [s]; None: not since the last torque
        self._sent_at = 0.0  # monotonic [s]
        self._quickest = math.inf  # from `interval` to the torque [s], of so many torques
        self._timed = 0
        self._depth = max(round(HISTORY * node.settings.loop.rate), 1)
        self.senders = Endpoints(partial(node.get_publishers_info_by_topic, COMMANDS))
        self.listeners = Endpoints(partial(node.get_subscriptions_info_by_topic, COMMANDS))

    @property
    def claimed(self) -> bool:
        """Whether this node sends commands."""
        return self._publisher is not None

    def claim(self) -> None:
        """Begin to send; BlfError with the name of another node that sends commands already."""
        node = self._node
        if len(self.senders):
            names = ', '.join(self.senders.wait_for_names(node.stop)) or UNNAMED
            raise BlfError(f'{node.resolve_topic_name(COMMANDS)}: {names} sends commands already: '
                           f'one controller at a time')
        self._publisher = node.topics.publisher(Float64MultiArray, COMMANDS, depth=self._depth)
        self.claimed_at = time.monotonic()

    def release(self) -> None:
        """Destroy the publisher."""
        if self._publisher is not None:
            self._node.topics.end_publisher(self._publisher)
            self._publisher = None

    def someone_drives(self) -> bool:
        """Whether an arm listens to the commands.

        A recorder does not move one. A listener whose name is not known yet may be that
        recorder and does not count so far.
        """
        return any(name is not None and name.rpartition('/')[2] != 'recorder'
                   for name in self.listeners.names())

    @property
    def heard(self) -> bool:
        """Whether a torque that is sent now reaches an arm."""
        return (self._publisher is not None and self._publisher.get_subscription_count() > 0
                and self.someone_drives())

    def unheard(self) -> bool:
        """Whether the torques of UNHEARD s may have reached no arm, so that it fell behind.

        DDS may show a listener that does not hear yet. One that hears confirms it (reliable
        delivery); a best-effort listener confirms nothing and is taken to hear. Whom the publisher
        has not found yet cannot confirm: that another one does is not enough. Asked before each
        torque, True once for each UNHEARD s, and no longer than UNHEARD_LONGEST in all.
        """
        if self._publisher is None or self.confirmed or not self.pushes or self._node.lockstep:
            return False
        now = time.monotonic()
        late = now - self._begun_at >= UNHEARD and self._sent > self._depth
        found = self._publisher.get_subscription_count() >= len(self.listeners)
        acked = self._publisher.wait_for_all_acked(CONFIRMATION if late else AT_ONCE)
        self.confirmed = ((found and acked)
                          or now - self._first_at >= UNHEARD_LONGEST)
        if self.confirmed or not late:
            return False
        self._begun_at = time.monotonic()
        return True

    def interval(self) -> float:
        """Return the time between the last torque and the one that is computed from now on [s].

        That is sent as long after now as the quickest was, or later: a limit of its rate holds on
        the topic, however long this process was kept from sending the last one. Until the quickest
        is known it counts as sent at once.
        """
        self._asked_at = now = time.monotonic()
        computing = self._quickest if self._timed >= KNOWN else 0.0
        return now + computing - self._sent_at

    @property
    def shared(self) -> bool:
        """Whether another node sends commands, too."""
        return self._node.count_publishers(COMMANDS) > 1

    def others(self) -> str:
        """Return a sentence naming all who send commands; '' where no other node does."""
        names = [name or UNNAMED for name in self.senders.names()]
        return (f'another node sends commands, too: {", ".join(sorted(names))}'
                if self.claimed and len(names) > 1 else '')

    def has_to_give_way(self, now: float) -> bool:
        """Whether another controller began at the same moment as this one.

        It gives way only to a controller of this kind, which gives way likewise, and not to any
        other publisher.

        Args:
            now: Monotonic time [s].
        """
        return (now - self.claimed_at < GIVE_WAY and self.shared
                and self._node.count_publishers(ADAPTATION_TERM) > 1)

    def send(self, torque: np.ndarray, stamp: int = 0, until: float = math.inf) -> bool:
        """Send a torque, unless it is too late or the topic is released; whether it is in time.

        Args:
            torque: Shape (n,) [N·m].
            stamp: Of the state that it answers [ns]; 0: none.
            until: Monotonic time after which it must not be sent [s]. What is still between that
                look at the clock and the topic takes microseconds.
        """
        if self._publisher is None:
            return True
        message = self._codec.encode(torque, stamp)
        if (now := time.monotonic()) > until:
            return False
        if not self.pushes:
            self.pushes, self.confirmed, self._sent = True, False, 0
            self._first_at = self._begun_at = now
        self._publisher.publish(message)
        self._sent, self._sent_at = self._sent + 1, time.monotonic()
        if self._asked_at is not None:  # a ramp computes nothing, and does not ask
            self._quickest = min(self._quickest, self._sent_at - self._asked_at)
            self._timed, self._asked_at = self._timed + 1, None
        return True

    def send_zero(self) -> None:
        """Send the zero torque, unless the topic is released or ROS is shut down."""
        if self._publisher is not None and self._node.context.ok():
            self._publisher.publish(self._codec.encode(np.zeros(self._n)))
            self.pushes = False

    def ramp_down(self, torque: np.ndarray, ramp_time: float, rate_limit: np.ndarray) -> None:
        """Bring the torque to zero and wait until that is delivered; see `ramp.ramp_down`."""
        if not self.pushes or self._publisher is None:
            return
        if not self._node.lockstep:
            for step in ramp_down(torque, ramp_time, rate_limit):
                time.sleep(RAMP_STEP)  # since the command before
                self.send(step)
            time.sleep(RAMP_STEP)
        self.send_zero()
        self._publisher.wait_for_all_acked(DELIVERY_TIMEOUT)
