# SPDX-License-Identifier: Apache-2.0
"""A data node with a lifecycle: what moves an arm is configured, activated and deactivated.

With ``autostart`` the node configures itself when it is made and activates itself as soon as it
can, so that ``ros2 run`` is enough; a node that cannot be configured ends with the reason.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, TypeVar

from lifecycle_msgs.msg import State
from lifecycle_msgs.srv import ChangeState
from rclpy.context import Context
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.lifecycle.node import LifecycleNodeMixin

from adaptive_blf_control.configuration.node_settings import LifecycleSettings
from adaptive_blf_control.errors import BlfError
from adaptive_blf_control.runtime.compiling import compiling
from adaptive_blf_control.runtime.data_node import DataNode
from adaptive_blf_control.runtime.rclpy_internals import (
    answer_transitions,
    end_transitions,
    lifecycle_state,
)

__all__ = ['ManagedNode']

ManagedSettings = TypeVar('ManagedSettings', bound=LifecycleSettings)


class ManagedNode(LifecycleNodeMixin, DataNode[ManagedSettings], Generic[ManagedSettings]):
    """Subclasses define what a transition does; a BlfError that it raises refuses it.

    Attributes:
        active: Whether the arm may be moved.
        wants_activation: Whether the node is to activate itself as soon as it can.
    """

    def __init__(self, kind: str, settings_class: type[ManagedSettings], *,
                 context: Context | None = None, **options: Any) -> None:
        """Make the node; with ``autostart`` configure it, BlfError where that fails."""
        DataNode.__init__(self, kind, settings_class, context=context, **options)
        LifecycleNodeMixin.__init__(self)
        answer_transitions(self, self._answer_request)
        self.active = False
        self._refused: BlfError | None = None
        self._by_itself = False
        self.wants_activation = self.settings.autostart
        if self.wants_activation and not self._changes(self.trigger_configure):
            error = self._refused
            self.destroy_node()
            raise error or BlfError(f'{kind} could not be configured')

    def destroy_node(self) -> None:
        """Leave the graph."""
        super().destroy_node()
        end_transitions(self)

    def configure(self) -> None:
        """Validate, build and compile everything; make topics."""
        raise NotImplementedError

    def activate(self) -> None:
        """Check that the arm may be moved from here on."""

    def deactivate(self) -> None:
        """Bring the torque to zero."""

    def cleanup(self) -> None:
        """Release what :meth:`configure` made."""

    def activate_by_itself(self) -> bool:
        """Activate if that is still wanted; raise the reason if it is refused."""
        if self.state_id != State.PRIMARY_STATE_INACTIVE or not self.wants_activation:
            return False
        self.wants_activation = False
        try:
            if self._changes(self.trigger_activate):
                return True
        except RuntimeError as error:  # rcl: a request is changing the state at this moment
            self.get_logger().warning(f'not activated: {error}')
            return False
        raise self._refused or BlfError(f'{self.kind} could not be activated')

    def deactivate_by_itself(self) -> None:
        """Deactivate, unless a request is changing the state at this very moment."""
        try:
            with self.between_samples:
                self.trigger_deactivate()
        except RuntimeError as error:  # rcl: no such transition from there
            self.get_logger().warning(f'not deactivated: {error}')

    @property
    def state_id(self) -> int:
        """Present state, a constant of lifecycle_msgs/State."""
        return lifecycle_state(self)[0]

    def _changes(self, trigger: Callable[[], TransitionCallbackReturn]) -> bool:
        with self.between_samples:
            self._refused, self._by_itself = None, True
            try:
                return trigger() == TransitionCallbackReturn.SUCCESS
            finally:
                self._by_itself = False

    def _answer_request(self, answer: Callable[..., Any], request: ChangeState.Request,
                        response: ChangeState.Response) -> ChangeState.Response:
        """Answer a request for a transition, also for one that does not exist from this state.

        For such a request rclpy raises and answers nothing. The whole request is handled between
        two samples: in the middle of one the node may be activating itself.
        """
        with self.between_samples:
            try:
                answered: ChangeState.Response = answer(request, response)
            except RuntimeError as error:  # rcl's
                asked = request.transition.label or request.transition.id
                state = lifecycle_state(self)[1]
                self.faults.report('refused', (
                    f'transition {asked!r}: there is none from {state!r}: '
                    f'{str(error).split(", at /")[0]}'))
                response.success = False
                return response
            return answered

    def _transition(self, action: Callable[[], None]) -> TransitionCallbackReturn:
        try:
            with self.between_samples:
                action()
        except BlfError as error:
            self._refused = error
            if not self._by_itself:  # else it is raised, and logged where it ends the node
                self.faults.report('refused', str(error))
            return TransitionCallbackReturn.FAILURE
        except Exception as error:  # rclpy would swallow it and leave the node half configured
            self._refused = BlfError(f'{type(error).__name__}: {error}')
            self.faults.report('failed transition', str(self._refused))
            return TransitionCallbackReturn.ERROR
        return TransitionCallbackReturn.SUCCESS

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End the process rather than stay half configured; its end sends the zero torque."""
        self.active, self.exit_code = False, 2
        self.stop.set()
        return TransitionCallbackReturn.FAILURE

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Configure; settings that cannot be used refuse it with the reason."""
        def action() -> None:
            with compiling(self.get_logger(), self.stop):
                self.configure()
        return self._transition(action)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Activate, or refuse with joint, value and bound."""
        def action() -> None:
            self.activate()
            self.active = True
        return self._transition(action)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Bring the torque to zero; the node does not activate itself again."""
        def action() -> None:
            self.wants_activation = False
            if self.active:
                self.active = False
                self.deactivate()
        return self._transition(action)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Go back to unconfigured; the node does not activate itself again."""
        self.wants_activation = False
        return self._transition(self.cleanup)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Bring the torque to zero and end the process."""
        done = self.on_deactivate(state)
        self.stop.set()
        return done
