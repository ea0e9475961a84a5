# SPDX-License-Identifier: Apache-2.0
"""What the controller publishes besides its torque: margins, violations, Theorem 2."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.configuration.node_settings import ControllerNodeSettings
from adaptive_blf_control.control.answered import Answered
from adaptive_blf_control.control.constraints import MarginName
from adaptive_blf_control.control.controller import Controller
from adaptive_blf_control.control.guarantee import bounded_value, guarantee, GuaranteeMonitor
from adaptive_blf_control.control.safety_filter import complaint_of
from adaptive_blf_control.errors import BlfError
from adaptive_blf_control.messages.controller_codecs import ControllerCodecs, MonitorStream
from adaptive_blf_control.messages.topics import ADAPTATION_TERM, GUARANTEE
from adaptive_blf_control.nodes.handover import handed_over_decimation, Handover
from adaptive_blf_control.runtime.data_node import DataNode

__all__ = ['ControllerMonitors']

REPUBLISH_SAMPLES = 500  # after which the guarantee is published again


class ControllerMonitors:
    """Publishes reference, errors, margins and guarantee, and counts violations.

    Attributes:
        codecs: Messages of the controller.
        margins: Those of all constraints at the last sample, shape (K,).
        violations: Samples in which a constraint was violated.
        first_violation: Body, value and bound of the first of them, '' if there is none.
    """

    def __init__(self, node: DataNode[ControllerNodeSettings], joints: tuple[str, ...],
                 parameters: tuple[str, ...], names: tuple[MarginName, ...],
                 watched: tuple[str, ...] = (), handover: Handover | None = None) -> None:
        """Make the topics on ``node``.

        Args:
            node: Whose monitors they are.
            joints: Names of the joints.
            parameters: Names of the parameters.
            names: Those of the margins.
            watched: What the safety filter says of itself.
            handover: Where the identifier of this process takes the adaptation term from.
        """
        self.codecs = ControllerCodecs(joints, parameters, names, node.label, watched)
        self.margins = np.zeros(len(names))
        self.violations = 0
        self.first_violation = ''
        self._node = node
        self._handover = handover
        self._joints = joints
        self._names = names
        self._recovery = ''
        self._outputs = node.topics.declared(node.kind)
        self._stream = MonitorStream(self.codecs)
        self._guarantee: GuaranteeMonitor | None = None

    def close(self) -> None:
        """Destroy the topics."""
        for publisher in self._outputs.values():
            self._node.topics.end_publisher(publisher)

    def begin(self) -> None:
        """Forget the guarantee of the motion before."""
        self._guarantee = None

    def publish_term(self, stamp: int, answered: Answered) -> None:
        """Hand over and publish the adaptation term; ``stamp`` of the sample in ns."""
        if self._handover is not None:
            self._handover.terms.append((stamp, answered.adaptation_term.copy()))
            if self._stream.samples % handed_over_decimation(self._node):
                return
        self._outputs[ADAPTATION_TERM].publish(self.codecs.adaptation_term(stamp, answered))

    def watch(self, controller: Controller, stamp: int, answered: Answered,
              theta: np.ndarray) -> bool:
        """Publish what is due for a sample; return whether all constraints are kept."""
        self.margins = answered.margins
        inside = answered.smallest > 0.0
        if not inside:
            self._violated(controller, answered)
        for topic, message in self._stream.messages(
                stamp, answered, self.margins, self._node.settings.monitor_decimation,
                lambda: controller.lyapunov(answered.output, theta),
                getattr(controller.safety_filter, 'watch', None)).items():
            self._outputs[topic].publish(message)
        if self._guarantee is not None:
            self._watch_guarantee(self._guarantee, stamp, answered)
        complaint = complaint_of(controller.safety_filter)
        if complaint:
            self._node.faults.report('safety filter', complaint)
        return inside

    def _violated(self, controller: Controller, answered: Answered) -> None:
        self.violations += 1
        violation = controller.constraints.violation(answered.output.state)
        if violation is None:
            return
        if not self.first_violation:
            self.first_violation, self._recovery = str(violation), violation.recovery
        self._node.faults.report('set left', str(violation))

    def state_guarantee(self, controller: Controller, stamp: int, answered: Answered) -> None:
        """Publish what Theorem 2 guarantees from here on, given bounds on the unknown arm."""
        settings = self._node.settings.guarantee
        if settings.mode != 'bound':
            return
        weight = controller.settings.resolved(joints=len(self._joints)).barrier_weight.copy()
        try:
            smallest, largest = settings.mass
            value = bounded_value(answered.e1, answered.e2, controller.performance, largest,
                                  settings.theta_error,
                                  np.array([settings.smallest_gamma]), weight)
            guaranteed = guarantee(value, controller.performance, controller.reference.range(),
                                   smallest, weight)
        except (BlfError, ArithmeticError) as error:  # what is only shown ends no motion
            self._node.faults.report('guarantee', f'Theorem 2 cannot be stated: {error}')
            return
        self._guarantee = GuaranteeMonitor(guaranteed, controller.performance, self._joints,
                                           weight)
        self._outputs[GUARANTEE].publish(self.codecs.guarantee(stamp, guaranteed))
        bounds = ', '.join(f'{joint} {low:.4g} .. {high:.4g} rad' for joint, low, high in zip(
            self._joints, guaranteed.error_lower, guaranteed.error_upper))
        self._node.get_logger().info(
            f'Theorem 2: V(0) <= {value:.4g}, so e1 stays in {bounds}')

    def _watch_guarantee(self, monitor: GuaranteeMonitor, stamp: int,
                         answered: Answered) -> None:
        if self._stream.samples % REPUBLISH_SAMPLES == 0:
            self._outputs[GUARANTEE].publish(self.codecs.guarantee(stamp, monitor.guaranteed))
        left = monitor.observe(answered.t, answered.e1)
        if left is not None:
            self._node.faults.report('guarantee', (
                f'joint {left.joint}: e1 = {left.value:.4g} rad is beyond the {left.bound:.4g} '
                f'rad that Theorem 2 guarantees: check the bounds under guarantee, torque limits '
                f'and the delay'))

    def status(self, saturated: np.ndarray) -> dict[str, object]:
        """Return margins, V and saturation for the diagnostics."""
        values: dict[str, object] = {'V': f'{self._stream.lyapunov:.6g}'}
        values.update((name.label, f'{margin:.6g}')
                      for name, margin in zip(self._names, self.margins))
        values.update((f'{joint} saturated', bool(each))
                      for joint, each in zip(self._joints, saturated))
        if self.violations:
            values['samples outside a set'] = self.violations
            values['first violation'] = self.first_violation
            values['recovery'] = self._recovery
        if self._guarantee is not None and self._guarantee.first is not None:
            values['left what Theorem 2 guarantees at [s]'] = f'{self._guarantee.first.t:.3f}'
        return values
