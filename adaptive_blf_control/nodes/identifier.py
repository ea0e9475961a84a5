# SPDX-License-Identifier: Apache-2.0
"""``identifier``: joint states in, parameter estimate and the rank of its history out."""

from __future__ import annotations

from functools import partial
import traceback
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
import numpy as np
from rclpy.context import Context
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from adaptive_blf_control.configuration.build_identifier import build_identifier
from adaptive_blf_control.configuration.node_settings import IdentifierNodeSettings
from adaptive_blf_control.configuration.payload import build_payload
from adaptive_blf_control.control.refusal import Refusal
from adaptive_blf_control.errors import ArmError
from adaptive_blf_control.identification.rank_condition import rank_warning
from adaptive_blf_control.messages.identifier_codecs import EstimateStream, HistoryFigures
from adaptive_blf_control.messages.topics import ADAPTATION_TERM, JOINT_STATES
from adaptive_blf_control.nodes.estimate_saver import EstimateSaver, resumed_estimate
from adaptive_blf_control.nodes.handover import emptied, handed_over_decimation, Handover
from adaptive_blf_control.nodes.model_output import ModelOutput
from adaptive_blf_control.nodes.payload_output import PayloadOutput
from adaptive_blf_control.nodes.set_output import SetOutput
from adaptive_blf_control.nodes.state_input import JointSample, StateInput
from adaptive_blf_control.nodes.term_input import TermInput
from adaptive_blf_control.runtime.compiling import compiling
from adaptive_blf_control.runtime.data_node import DataNode
from adaptive_blf_control.runtime.robot_description import arm_of
from adaptive_blf_control.runtime.status_report import Status

__all__ = ['IdentifierNode']


SILENCE = 0.1  # s without joint states after which another source may send them
_REASONS = {'changes': 'the arm has changed: the history is emptied',
            'alarms': 'present data contradict the recorded pairs: nothing is recorded until the '
                      'reason is known',
            'loads': 'it is a load at the tip: the recorded pairs are corrected by it',
            'contacts': 'it was a contact: the recorded pairs hold again'}


class IdentifierNode(DataNode[IdentifierNodeSettings]):
    """Torque-filtered concurrent learning on the joint states of a running arm.

    Attributes:
        identifier: The object that learns; its ``theta`` and ``stack`` are what is published.
        terms: The adaptation terms of the controller.
        saver: Writes the estimate file.
        model: Publishes and writes the physically consistent model.
        payload: Finds and publishes the load.
        states: The joint states it believes.
        last_ns: Stamp of the last state [ns]; 0 before the first.
        handover: What it exchanges with the controller in the same process; None where that is in
            a process of its own.
        failure: Why nothing is learned any longer, '' where it is.
    """

    def __init__(self, *, context: Context | None = None, handover: Handover | None = None,
                 **options: Any) -> None:
        """Build the identifier from the parameters."""
        self.handover = handover
        self.failure = ''
        super().__init__('identifier', IdentifierNodeSettings, context=context, **options)
        with compiling(self.get_logger(), self.stop):
            self.arm = arm_of(self, self.settings)
            self.identifier = build_identifier(self.settings, self.arm,
                                               resumed_estimate(self, self.arm.parameters))
            self.identifier.warm_up()
            payload = build_payload(self.settings, self.arm, self.identifier.memory)
        self._check_rank()
        self._found = self.identifier.found
        self.terms = TermInput(self, self.arm.parameters)
        self._zero_ns: int | None = None
        self._reset_requested = False
        self.states = StateInput(self, self.arm.joints, lambda: SILENCE)
        self._stream = EstimateStream(self.arm.parameters, self.arm.joints,
                                      self.settings.external_torque_decimation, self.label)
        self._outputs = self.topics.declared(self.kind)
        self.last_ns = 0
        self._reported = self.identifier.theta, 0.0
        if handover is None:
            self.topics.subscribe(JointState, ADAPTATION_TERM, self.terms.receive,
                                  wake=self.lockstep, reliable=self.lockstep)
            self.topics.subscribe(JointState, JOINT_STATES, self.on_joint_states,
                                  reliable=self.lockstep)
        else:
            handover.arm, handover.learn = self.arm, self.learn
        self.create_service(Trigger, '~/reset_history', self.on_reset_history)
        self.create_service(Trigger, '~/save_estimate', self.on_save_estimate)
        self.create_service(Trigger, '~/save_model', self.on_save_model)
        self.saver = EstimateSaver(self, self.identifier.snapshot)
        self.model = ModelOutput(self, self.identifier, self._outputs)
        self.payload = PayloadOutput(self, payload, self._outputs)
        self.parameter_set = SetOutput(self, self.arm, self._outputs, handover)

    def _check_rank(self) -> None:
        warning = rank_warning(self.identifier.settings, self.arm.n, self.arm.m)
        if warning:
            self.caution(warning)

    def finish(self) -> None:
        """Write what was learned since the last time."""
        if self.settings.estimate_period > 0.0:
            self.saver.save_news()

    def retune(self, settings: IdentifierNodeSettings, changed: set[str]) -> None:
        """Change gains, filters, monitor or history between two samples."""
        self.identifier.retune(settings)
        self._stream.decimation = settings.external_torque_decimation
        self._check_rank()
        if 'estimate_period' in changed:
            self.saver.retune(settings.estimate_period)
        if 'model_period' in changed:
            self.model.retune(settings.model_period)

    def on_joint_states(self, data: bytes, info: dict[str, int]) -> None:
        """Learn from one joint state as a message."""
        sample = self.states.read(data, info)
        if isinstance(sample, Refusal):
            self.faults.refuse(sample)
        else:
            self.on_state(sample)

    def learn(self) -> None:
        """Learn from what the controller of this process has seen since the last time.

        While a request holds the node, the states are left for the next time, so that no torque
        waits for it. A failure ends learning, but not the controller: θ̂ stays, and the
        diagnostics say so.
        """
        if not self.between_samples.acquire(blocking=self.lockstep):
            return
        try:
            self.work(self._take_states)
        except Exception as error:
            if not self.context.ok():
                raise
            self._fail(error)
        finally:
            self.between_samples.release()

    def _take_states(self) -> int:
        if self.handover is None or self.failure:
            return 0
        for term in emptied(self.handover.terms):
            self.terms.take(*term)
        handled = 0
        for sample in emptied(self.handover.states):
            handled += 1
            self.on_state(sample)
        return handled + self.topics.handle()  # in lockstep a sample may have waited

    def _fail(self, error: Exception) -> None:
        self.failure = f'nothing is learned any longer: {type(error).__name__}: {error}'
        self.exit_code = 2
        self.faults.report('learning failed', self.failure)
        self.get_logger().error(traceback.format_exc())

    def on_state(self, sample: JointSample) -> None:
        """Learn from one joint state and publish θ̂."""
        second = self.states.refuse(sample)
        if second is not None:
            self.faults.refuse(second)
            return
        stamp, q, qd, tau, _, info = sample
        if self.lockstep and self.terms.misses(self.last_ns, stamp):
            self.topics.later(partial(self.on_state, sample))
            return
        self.topics.drain()  # each state of a backlog needs the term that was sent before it
        if stamp < self.last_ns:
            self.terms.forget_from(stamp)
        self.last_ns = stamp
        self.aged(info)
        if self._reset_requested:
            self._reset_requested = False
            self.identifier.reset_history()
        if self._zero_ns is None:
            self._zero_ns = stamp  # seconds since 1970 as a double would cost 2e-7 s of precision
        t = (stamp - self._zero_ns) * 1e-9
        theta = self.identifier.take(t, q, qd, tau, self.terms.held(stamp))
        self.payload.observe(stamp, t, self.identifier)
        self.parameter_set.observe(stamp, t, self.identifier)
        if self.handover is not None:
            self.handover.estimates.append((stamp, theta.copy()))
            self._stream.estimate_decimation = handed_over_decimation(self)
        self._publish(stamp, theta)
        self.model.observe(stamp, t)
        self.sampled(stamp)
        self._report_changes()

    def _publish(self, stamp: int, theta: np.ndarray) -> None:
        stack = self.identifier.stack
        for topic, message in self._stream.messages(
                stamp, theta, stack.insertions, lambda: HistoryFigures(
                    stack.rank, stack.sigma_min, self.identifier.excitation),
                lambda: self.identifier.external_torque).items():
            self._outputs[topic].publish(message)

    def _report_changes(self) -> None:
        found = self.identifier.found
        if found == self._found:
            return
        before, self._found = self._found, found
        for reason, text in _REASONS.items():
            if found[reason] != before[reason]:
                self.get_logger().warning(f'{text} ({found[reason]} so far)')

    def on_reset_history(self, request: Trigger.Request,
                         response: Trigger.Response) -> Trigger.Response:
        """Empty the history stack before the next sample; θ̂ stays."""
        self._reset_requested = True
        response.success = True
        response.message = f'{self.identifier.stack.count} pairs will be forgotten'
        return response

    def on_save_estimate(self, request: Trigger.Request,
                         response: Trigger.Response) -> Trigger.Response:
        """Write θ̂ to the file of the parameter ``estimate_file``."""
        try:
            path = self.saver.save()
        except (OSError, ValueError) as error:
            response.success, response.message = False, str(error)
        else:
            response.success, response.message = True, str(path.resolve())
        return response

    def on_save_model(self, request: Trigger.Request,
                      response: Trigger.Response) -> Trigger.Response:
        """Write the consistent model and its URDF; see the parameter ``model_file``."""
        try:
            model, urdf = self.model.save()
        except (ArmError, OSError, ValueError, np.linalg.LinAlgError) as error:
            response.success, response.message = False, str(error)
        else:
            response.success = True
            response.message = f'{model.resolve()} {urdf.resolve()}'
        return response

    def _external(self) -> dict[str, object]:
        """Return the external torque of each joint where it is beyond its bound."""
        external = self.identifier.external_torque
        if external is None:
            return {}
        beyond = [f'{joint} {torque:.3g} of {bound:.3g}'
                  for joint, torque, bound in zip(self.arm.joints, *external)
                  if abs(torque) > bound]
        return {'external torque beyond its bound [N*m]': ', '.join(beyond) or 'none'}

    def _drift(self) -> float:
        """Return ‖Δθ̂‖ over the time since the last diagnostics [per second]."""
        theta, t = self.identifier.theta, self.last_ns * 1e-9
        before, since = self._reported
        self._reported = theta, t
        return float(np.linalg.norm(theta - before)) / (t - since) if t > since > 0.0 else 0.0

    def status(self) -> Status:
        """Report rank, σ_min and the samples that were not used."""
        stack, identifier = self.identifier.stack, self.identifier
        values: dict[str, object] = {
            'rank': stack.rank, 'parameters': self.arm.m, 'sigma_min': f'{stack.sigma_min:.6g}',
            'pairs': stack.count, 'insertions': stack.insertions,
            'change of theta_hat per second, norm': f'{self._drift():.6g}',
            'filter restarts': identifier.restarts,
            'samples with a joint at its position limit': identifier.at_limit,
            'changes of the arm': identifier.changes, 'response': identifier.response,
            **{f'{reason} found': identifier.found[reason]
               for reason in ('alarms', 'contacts', 'loads')},
            **self._external(),
            'artificial noise': 'in use' if identifier.artificial_noise else 'not in use',
            'excitation index': identifier.excitation,
            'norm of theta_hat': f'{np.linalg.norm(identifier.theta):.6g}',
            **self.payload.status(), **self.parameter_set.status(),
            **{f'samples {reason}': count for reason, count in identifier.dropped.items()}}
        if self.failure:
            return DiagnosticStatus.ERROR, self.failure, values
        second = '' if self.lockstep else (self.states.heard.second_source()
                                           or self.terms.heard.second_source())
        if second:
            return DiagnosticStatus.ERROR, second, values
        if identifier.artificial_noise:
            return DiagnosticStatus.WARN, ('theta_hat is biased: it is learned with artificial '
                                           'noise (history.noise)'), values
        if identifier.response == 'held':
            return DiagnosticStatus.WARN, ('the recorded pairs are contradicted: a contact, a '
                                           'load or another arm; nothing is recorded'), values
        if stack.rank < self.arm.m:
            return DiagnosticStatus.OK, f'learning: rank {stack.rank} of {self.arm.m}', values
        return DiagnosticStatus.OK, 'rank full', values
