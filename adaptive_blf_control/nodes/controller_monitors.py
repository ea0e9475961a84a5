# SPDX-License-Identifier: Apache-2.0
"""What the controller shows besides its torque: monitors, margins, Theorem 2, set violations."""

from __future__ import annotations

import numpy as np
from sensor_msgs.msg import JointState

from adaptive_blf_control.configuration.node_settings import ControllerNodeSettings
from adaptive_blf_control.control.controller import Controller, ControlOutput
from adaptive_blf_control.control.guarantee import bounded_value, guarantee, GuaranteeMonitor
from adaptive_blf_control.errors import BlfError
from adaptive_blf_control.messages.controller_codecs import ControllerCodecs, MonitorStream
from adaptive_blf_control.messages.topics import BARRIER, GUARANTEE, REFERENCE, TRACKING_ERROR
from adaptive_blf_control.runtime.data_node import DataNode

__all__ = ['ControllerMonitors']

HEARTBEAT = 500  # samples between two repetitions of the guarantee


class ControllerMonitors:
    """Publishes what a user wants to see of the law, and keeps account of the sets.

    Attributes:
        codecs: Messages of the controller.
        margins: Distances to both sets at the last sample, shape (2n,) [rad].
        violations: Samples outside a set.
        first_violation: Joint, value and bound of the first of them, '' where there is none.
    """

    def __init__(self, node: DataNode[ControllerNodeSettings], joints: tuple[str, ...],
                 parameters: tuple[str, ...]) -> None:
        """Make the topics on ``node``."""
        self.codecs = ControllerCodecs(joints, parameters)
        self.margins = np.zeros(2 * len(joints))
        self.violations = 0
        self.first_violation = ''
        self._node = node
        self._joints = joints
        self._topics = {topic: node.data_publisher(JointState, topic)
                        for topic in (REFERENCE, TRACKING_ERROR, BARRIER, GUARANTEE)}
        self._stream = MonitorStream(self.codecs)
        self._guarantee: GuaranteeMonitor | None = None

    def close(self) -> None:
        """Take the topics down."""
        for publisher in self._topics.values():
            self._node.end_data_publisher(publisher)

    def begin(self) -> None:
        """Forget the guarantee of the motion before."""
        self._guarantee = None

    def watch(self, controller: Controller, t: float, stamp: int, q: np.ndarray,
              output: ControlOutput, theta: np.ndarray) -> bool:
        """Take the margins of a sample, publish what is due; False where a set was left."""
        self.margins = controller.margins(q, output)
        inside = bool(self.margins.min() > 0.0)
        if not inside:
            self._violated(controller, q, output)
        for topic, message in self._stream.messages(
                stamp, output, self.margins, self._node.settings.monitor_decimation,
                lambda: controller.lyapunov(q, output, theta)).items():
            self._topics[topic].publish(message)
        self._watch_guarantee(t, stamp, output.e1)
        return inside

    def _violated(self, controller: Controller, q: np.ndarray, output: ControlOutput) -> None:
        n = len(self._joints)
        worst = int(np.argmin(self.margins))
        i, name = worst % n, 'safety' if worst < n else 'performance'
        value = q[i] if worst < n else output.e1[i]
        bounds = controller.safety if worst < n else output.bounds
        text = (f'joint {self._joints[i]!r} has left its {name} set: {value:.5g} rad is not '
                f'within {bounds.lower[i]:.5g} .. {bounds.upper[i]:.5g} rad '
                f'(margin {self.margins[worst]:.3g} rad)')
        self.violations += 1
        self.first_violation = self.first_violation or text
        self._node.fault('set left', text)

    def state_guarantee(self, controller: Controller, stamp: int, output: ControlOutput) -> None:
        """State what Theorem 2 guarantees from here on, given bounds on the unknown arm."""
        settings = self._node.settings.guarantee
        if settings.mode == 'off':
            return
        try:
            smallest, largest = settings.mass
            value = bounded_value(output.e1, output.e2, controller.performance, largest,
                                  settings.theta_error,
                                  np.array([settings.smallest_gamma]))
            guaranteed = guarantee(value, controller.performance, controller.reference.range(),
                                 smallest)
        except (BlfError, ArithmeticError) as error:  # nothing that is only shown ends a motion
            self._node.fault('guarantee', f'Theorem 2 cannot be stated: {error}')
            return
        self._guarantee = GuaranteeMonitor(guaranteed, controller.performance, self._joints)
        self._topics[GUARANTEE].publish(self.codecs.guarantee(stamp, guaranteed))
        bounds = ', '.join(f'{joint} {low:.4g} .. {high:.4g} rad' for joint, low, high in zip(
            self._joints, guaranteed.error_lower, guaranteed.error_upper))
        self._node.get_logger().info(
            f'Theorem 2: V(0) <= {value:.4g}, so e1 stays in {bounds}')

    def _watch_guarantee(self, t: float, stamp: int, e1: np.ndarray) -> None:
        monitor = self._guarantee
        if monitor is None:
            return
        if self._stream.samples % HEARTBEAT == 0:
            self._topics[GUARANTEE].publish(self.codecs.guarantee(stamp, monitor.guaranteed))
        left = monitor.observe(t, e1)
        if left is not None:
            self._node.fault('guarantee', (
                f'joint {left.joint}: e1 = {left.value:.4g} rad is beyond the {left.bound:.4g} '
                f'rad that Theorem 2 guarantees: check the bounds under guarantee, torque limits '
                f'and the delay'))

    def status(self, saturated: np.ndarray) -> dict[str, object]:
        """Return margins, V and saturation for the diagnostics."""
        n = len(self._joints)
        values: dict[str, object] = {'V': f'{self._stream.lyapunov:.6g}'}
        for i, joint in enumerate(self._joints):
            values[f'{joint} safety margin [rad]'] = f'{self.margins[i]:.6g}'
            values[f'{joint} performance margin [rad]'] = f'{self.margins[n + i]:.6g}'
            values[f'{joint} saturated'] = bool(saturated[i])
        if self.violations:
            values['samples outside a set'] = self.violations
            values['first violation'] = self.first_violation
        if self._guarantee is not None and self._guarantee.first is not None:
            values['left what Theorem 2 guarantees at [s]'] = f'{self._guarantee.first.t:.3f}'
        return values
