# Copyright 2026 lava_ros contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The node `lava`: a managed node, from its parameters to an operation that does the work."""

from collections.abc import Callable
import gc
import os
import signal
import sys
import traceback
from typing import Any

from rcl_interfaces.msg import SetParametersResult
import rclpy
from rclpy.exceptions import ParameterException
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions

from lava_ros.errors import LavaError
from lava_ros.lava import Lava
from lava_ros.ros import parameters, qos
from lava_ros.ros.entities import Entities
from lava_ros.ros.eruption import SimulationLike
from lava_ros.ros.operation import Operation
from lava_ros.ros.resume import adopt
from lava_ros.ros.sources import load_sources, Sources
from lava_ros.ros.spinning import spin
from lava_ros.scene import Scene


class LavaNode(LifecycleNode):
    """A managed node (ROS 2 design, "Managed nodes"); starts by itself unless told otherwise.

    configure    reads parameters and files, joins the graph, starts on the scene or takes terrain
                 and vents; time stands still and no layer is published
    activate     lets time pass, publishes, records when it shall
    deactivate   holds time; inputs are still taken and diagnostics told
    cleanup      finishes the bag, ends the simulation and leaves the graph

    A transition that is refused leaves the node where it was and says why in the log. One that
    ends in an error nobody expected leaves it unconfigured.

    Attributes:
        refusal: Why a transition went wrong the last time that one did.
    """

    def __init__(
        self,
        *,
        make_simulation: Callable[[Scene], SimulationLike] | None = None,
        **options: Any,
    ) -> None:
        """Declare what has to be known before the node is configured.

        Args:
            make_simulation: Makes simulations in place of the parameters' own.
            options: Passed on to ``rclpy.lifecycle.LifecycleNode``.

        Raises:
            ParameterException: A parameter has the wrong type.
        """
        super().__init__('lava', **options)
        self._make_simulation = make_simulation
        self._operation: Operation | None = None
        self._values: dict[str, Any] = {}
        self._material: Lava | None = None
        self._ending: Operation | None = None
        self.refusal = ''
        self._answer_all_requests()
        declared = parameters.declare(self, parameters.LIFECYCLE)
        self._is_autostarting = bool(declared['autostart'])
        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(self._apply_parameters)

    @property
    def failure(self) -> str:
        """Why the node has to end, empty as long as it has not."""
        return self._operation.failure if self._operation is not None else ''

    def autostart(self) -> bool:
        """Configure and activate, unless the parameter ``autostart`` is false.

        Returns:
            Whether that went well; ``refusal`` says why not.
        """
        good = TransitionCallbackReturn.SUCCESS
        if not self._is_autostarting:
            return True
        return bool(self.trigger_configure() == good and self.trigger_activate() == good)

    def close(self) -> bool:
        """Finish the bag and end the simulation.

        Returns:
            Whether its thread has ended.
        """
        operation, self._operation = self._operation, None
        if operation is not None:
            self._ending = operation
            operation.close()
        if self._ending is not None and self._ending.has_ended():
            self._ending = None
        return self._ending is None

    def report_callback(self, error: Exception) -> None:
        """Report what a callback of the middleware itself raised."""
        if self._operation is not None:
            self._operation.report_callback(error)
        else:
            self.get_logger().error(f'{type(error).__name__}: {error}')

    # transitions

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Read parameters and files, and join the graph."""
        return self._transition('configure', self._configure)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Let time pass, and publish."""
        return self._transition('activate', lambda: self._configured().activate())

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Hold time, and publish no more layers."""
        return self._transition('deactivate', lambda: self._configured().deactivate())

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Finish the bag, end the simulation and leave the graph."""
        return self._transition('clean up', self._close)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Finish the bag and end the simulation, from any state."""
        return self._transition('shut down', self._close)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin anew, unconfigured, after an error nobody expected."""
        return self._transition('clean up after an error', self._close)

    def _transition(self, name: str, action: Callable[[], None]) -> TransitionCallbackReturn:
        # rclpy drops what a transition raises without a word.
        try:
            action()
        except (LavaError, ParameterException) as error:
            hint = ' (a parameter that is not whole is written 5.0)'
            self.refusal = f'{error}{hint * isinstance(error, ParameterException)}'
            self.get_logger().error(f'cannot {name}: {self.refusal}')
            return TransitionCallbackReturn.FAILURE
        except Exception as error:
            self.refusal = f'{type(error).__name__}: {error}'
            self.get_logger().error(f'cannot {name}: {traceback.format_exc()}')
            return TransitionCallbackReturn.ERROR
        return TransitionCallbackReturn.SUCCESS

    def _configure(self) -> None:
        if not self.close():
            right = 'ended; configure again in a while'
            raise LavaError('simulation', 'still in the last step before cleanup', right)
        sources = load_sources(self)
        settings = self._declare_parameters(sources)
        entities = Entities(self)
        try:
            self._operation = Operation(
                self,
                settings,
                lambda: self._values,
                sources,
                entities=entities,
                make_simulation=self._make_simulation,
            )
        except Exception:
            entities.destroy()
            raise

    def _configured(self) -> Operation:
        assert self._operation is not None
        return self._operation

    def _close(self) -> None:
        if not self.close():
            self.get_logger().warning('a step of the simulation goes on until it has ended')
        # Maps are in reference cycles, which an idle process would keep for long.
        gc.collect()

    def _answer_all_requests(self) -> None:
        """Refuse a transition that the state does not have; rclpy would leave it unanswered."""
        change = self._service_change_state
        change_state = change.callback

        def answer(request: Any, response: Any) -> Any:
            try:
                return change_state(request, response)
            except RuntimeError:
                which = request.transition.label or f'of id {request.transition.id}'
                _, state = self._state_machine.current_state
                self.get_logger().error(f'no transition {which} from {state}')
                response.success = False
                return response

        change.callback = answer

    # parameters

    def _declare_parameters(self, sources: Sources) -> parameters.Settings:
        specs = parameters.PARAMETERS + parameters.lava_parameters(sources.lava)
        former, self._material = self._material, sources.lava
        self._values = parameters.declare(self, specs)
        if sources.checkpoint is not None:
            self._values |= adopt(self, sources.checkpoint, self._values, specs)
        elif former is not None:
            self._renew_material(former, sources.lava)
        return parameters.settings_from(self._values)

    def _renew_material(self, former: Lava, lava: Lava) -> None:
        """Take constants from a scene file that has changed, but for those set by hand."""
        old = parameters.lava_values(former)
        changed = {
            name: value
            for name, value in parameters.lava_values(lava).items()
            if self._values[name] == old[name] != value
        }
        parameters.put(self, changed)
        self._values |= changed

    def _check_parameters(self, changed: list[Parameter]) -> SetParametersResult:
        # Unconfigured, one wrong value after the other can be put right; configuring checks all.
        if self._operation is None:
            return SetParametersResult(successful=True)
        try:
            self._operation.check(parameters.settings_from(self._with(changed)))
        except LavaError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _apply_parameters(self, changed: list[Parameter]) -> None:
        self._values = self._with(changed)
        if self._operation is not None:
            self._operation.apply(parameters.settings_from(self._values))

    def _with(self, changed: list[Parameter]) -> dict[str, Any]:
        known = {
            item.name: parameters.plain(item.value)
            for item in changed
            if item.name in self._values
        }
        return {**self._values, **known}


def main(args: list[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM.

    Returns:
        0 after a signal, 1 when the node cannot start or resume.
    """
    stopping: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: stopping.append(number))
    qos.publish_without_waiting()
    rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = LavaNode()
    except ParameterException as error:
        print(f'lava_node cannot start: {error}', file=sys.stderr)
        rclpy.shutdown()
        return 1
    if not node.autostart():
        print(f'lava_node cannot start: {node.refusal}', file=sys.stderr)
        ended, status = node.close(), 1
    else:
        ended, status = _run(node, lambda: bool(stopping))
    node.destroy_node()
    rclpy.shutdown()
    if not ended:
        # Leaving normally would wait for, or crash in, the thread that is still in the solver.
        sys.stdout.flush()
        os._exit(status)
    return status


def _run(node: LavaNode, is_stopping: Callable[[], bool]) -> tuple[bool, int]:
    """Run callbacks until it is time to stop; whether the simulation has ended, and the status."""
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        spin(
            executor,
            until=lambda: is_stopping() or bool(node.failure),
            on_error=node.report_callback,
        )
    finally:
        failure = node.failure
        ended = node.close()
    if failure:
        node.get_logger().error(failure)
    node.get_logger().info('stopped' if ended else 'stopped; a step of the simulation was cut off')
    executor.shutdown()
    return ended, 1 if failure else 0


if __name__ == '__main__':
    sys.exit(main())
