# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The node `lava`: its lifecycle, its parameters and its main loop."""

from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from functools import partial, partialmethod
import gc
import logging
import os
import signal
import sys
import time
import traceback
from typing import Any

from rcl_interfaces.msg import SetParametersResult
import rclpy
from rclpy.exceptions import ParameterException
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.utilities import remove_ros_args

from lava_ros.errors import import_failure, LavaError, RefusalError
from lava_ros.ros import middleware, node_parameters, parameters
from lava_ros.ros.executor import spin, start_ros
from lava_ros.ros.node_graph import ANSWER_TIME, NodeGraph
from lava_ros.ros.rclpy_internals import guard_change_state
from lava_ros.ros.runtime import NodeRuntime
from lava_ros.ros.services import create_services
from lava_ros.ros.startup_inputs import (
    load_startup_inputs,
    overrides_from_checkpoint,
    StartupInputs,
)
from lava_ros.scene import constants_of

#: Exit status for invalid arguments and parameters, as of the other commands.
USAGE_ERROR = 2

# Declared before the node is configured. Configuring declares `lava.*`, whose defaults are those
# of the scene.
_DECLARED = parameters.SOURCES + parameters.PARAMETERS


class LavaNode(LifecycleNode):
    """A managed node (ROS 2 design, "Managed nodes") that starts itself if ``autostart`` is true.

    configure    reads parameters and files, joins the graph, and loads the scene or waits for
                 terrain and vents; simulated time is held and no layer is published
    activate     lets simulated time advance, publishes, and records if configured
    deactivate   holds simulated time; inputs and diagnostics continue
    cleanup      finishes the bag, ends the simulation and leaves the graph

    A refused transition leaves the state unchanged, and the log contains the reason. A transition
    with an unexpected error leaves the node unconfigured. ``refusal`` is the reason of the last
    failed transition; ``has_failed`` is True after an unexpected error.
    """

    def __init__(self, *, typed: Collection[str] = (), **options: Any) -> None:
        """Declare the parameters.

        Args:
            typed: Names of the parameters that the command line sets for this node.
            **options: Further arguments of ``LifecycleNode``.

        Raises:
            LavaError: If a parameter of the lifecycle has a wrong type.
        """
        super().__init__('lava', **options)
        self.runtime: NodeRuntime | None = None
        self._values: dict[str, Any] = {}
        self._constants: Mapping[str, Any] | None = None
        # values of the user that a scene or a checkpoint has replaced, and the new ones, by name
        self._replaced: dict[str, tuple[Any, Any]] = {}
        self._graph: NodeGraph | None = None
        self._ending: NodeRuntime | None = None
        self.refusal = ''
        self.has_failed = self._is_starting = False
        self._typed = typed
        guard_change_state(self, self._refuse_transition)
        declared = node_parameters.declare(self, parameters.LIFECYCLE)
        self._is_autostarting = bool(declared['autostart'])
        node_parameters.fix(self, parameters.LIFECYCLE, fixed=True)
        for spec in _DECLARED:
            # configuring refuses a value of the wrong type
            with suppress(LavaError):
                node_parameters.declare(self, (spec,))
        self.add_pre_set_parameters_callback(partial(node_parameters.with_types, self))
        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(self._apply_parameters)

    @property
    def failure(self) -> BaseException | None:
        """Error that ends the node, None without one."""
        return self.runtime.failure if self.runtime is not None else None

    @property
    def is_answering(self) -> bool:
        """True if the answer to a call of a service has not been sent."""
        return self._graph is not None and self._graph.is_answering

    def autostart(self) -> bool:
        """Configure and activate if ``autostart`` is true; return True without a ``refusal``."""
        good = TransitionCallbackReturn.SUCCESS
        steps = (self.trigger_configure, self.trigger_activate) if self._is_autostarting else ()
        self._is_starting = True
        try:
            return all(step() == good for step in steps)
        finally:
            self._is_starting = False

    def close(self) -> bool:
        """Finish the bag and end the simulation; return True if its thread has ended."""
        runtime, self.runtime = self.runtime, None
        node_parameters.fix(self, _DECLARED, fixed=False)
        if runtime is not None:
            self._ending = runtime
            runtime.close()
        self._restore_parameters()
        if self._ending is not None and self._ending.worker.stop(0.0):
            self._ending = None
        return self._ending is None

    def report_callback(self, error: Exception) -> None:
        """Report an error that the middleware itself raised in a callback."""
        if self.runtime is not None:
            self.runtime.inputs.report_callback(error)
        else:
            self.get_logger().error(f'{type(error).__name__}: {error}')

    def _transition(
        self, name: str, done: str, action: Callable[['LavaNode'], None], _: LifecycleState
    ) -> TransitionCallbackReturn:
        # rclpy discards an exception of a transition without a message
        try:
            action(self)
        except LavaError as error:
            self.refusal = str(error)
            # during autostart, main() prints the reason
            if not self._is_starting:
                self.get_logger().error(f'cannot {name}: {self.refusal}')
            return TransitionCallbackReturn.FAILURE
        except Exception as error:
            self.has_failed = True
            sentence = import_failure(error)
            self.refusal = sentence or f'{type(error).__name__}: {error}'
            self.get_logger().error(f'cannot {name}: {sentence or traceback.format_exc()}')
            return TransitionCallbackReturn.ERROR
        self.get_logger().info(done)
        return TransitionCallbackReturn.SUCCESS

    def _configure(self) -> None:
        if not self.close():
            problem = 'The simulation is still in its last step before the cleanup'
            raise RefusalError('simulation', problem, 'Configure the node again later')
        if self._graph is not None:
            self._graph.destroy(is_answered=True)
        # a later configure starts from the scene: the bags of this process are finished
        startup = load_startup_inputs(self, may_restart=self._constants is None)
        settings = self._declare_parameters(startup)
        self._graph = graph = NodeGraph(self, settings.frame_id)
        try:
            self.runtime = NodeRuntime(graph, settings, lambda: self._values, startup)
            create_services(self.runtime, graph)
        except Exception:
            graph.destroy()
            raise
        node_parameters.fix(self, _DECLARED, fixed=True)

    def _activate(self) -> None:
        assert self.runtime is not None
        self.runtime.activate()

    def _deactivate(self) -> None:
        assert self.runtime is not None
        self.runtime.deactivate()

    def _close(self) -> None:
        if not self.close():
            self.get_logger().warning('the current step of the simulation ends in the background')
        # maps are in reference cycles, which an idle process would keep in memory for a long time
        gc.collect()

    # the callbacks of rclpy, each with a LifecycleState
    on_configure = partialmethod(_transition, 'configure', 'configured', _configure)
    on_activate = partialmethod(_transition, 'activate', 'active', _activate)
    on_deactivate = partialmethod(_transition, 'deactivate', 'inactive', _deactivate)
    on_cleanup = partialmethod(_transition, 'clean up', 'cleaned up', _close)
    on_shutdown = partialmethod(_transition, 'shut down', 'shut down', _close)
    on_error = partialmethod(_transition, 'clean up after an error', 'cleaned up', _close)

    def _refuse_transition(self, request: Any, state: str, response: Any) -> Any:
        which = request.transition.label or f'of id {request.transition.id}'
        self.get_logger().error(f'no transition {which} from {state}')
        response.success = False
        return response

    def _restore_parameters(self) -> None:
        """Restore the values that a scene or a checkpoint has replaced, except those set since."""
        replaced, self._replaced = self._replaced, {}
        given = {
            name: before for name, (before, own) in replaced.items() if self._values[name] == own
        }
        node_parameters.put(self, given)

    def _declare_parameters(self, startup: StartupInputs) -> parameters.Settings:
        constants = constants_of(startup.scene)
        specs = parameters.PARAMETERS + parameters.constant_parameters(constants)
        # constants that the user has not set are those of the previous scene
        self._constants = self._constants or constants
        old, new = map(parameters.constant_values, (self._constants, constants))
        self._values = node_parameters.declare(self, specs)
        for text in node_parameters.without_effect(self, self._typed):
            self.get_logger().warning(text)
        if startup.checkpoint is not None:
            defaults = {spec.name: spec.default for spec in specs} | old
            changed = overrides_from_checkpoint(
                startup.checkpoint, self._values, defaults,
                frame_id=startup.frame_id, is_restart=startup.is_restart,
            )
        else:
            changed = {
                name: value for name, value in new.items()
                if self._values[name] == old[name] != value
            }
        level = startup.scene and startup.scene.terrain.sea_level
        if level is not None and self._values['sea_level'] == parameters.NO_SEA:
            # terrain from topics has the sea of the scene
            changed['sea_level'] = level
        if onset := self._values['onset'] or startup.onset:
            changed['onset'] = parameters.onset_value(onset)
        given = self._values
        node_parameters.put(self, changed)
        self._constants = constants
        self._replaced = {
            name: (given[name], value) for name, value in changed.items() if name not in new
        }
        self._values = given | changed
        return parameters.settings_from(self._values)

    def _check_parameters(self, changed: list[Parameter]) -> SetParametersResult:
        try:
            # unchecked while unconfigured, so that several wrong values can be corrected one after
            # the other
            if self.runtime is not None:
                self.runtime.check(parameters.settings_from(self._with(changed)))
        except LavaError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _apply_parameters(self, changed: list[Parameter]) -> None:
        self._values = self._with(changed)
        if self.runtime is not None:
            self.runtime.apply(parameters.settings_from(self._values))

    def _with(self, changed: list[Parameter]) -> dict[str, Any]:
        new = {item.name: node_parameters.plain(item.value) for item in changed}
        return {name: new.get(name, value) for name, value in self._values.items()}


class _PackageLog(logging.Handler):
    """Forwards log records of the package, including those of Warp, to the log of a node."""

    def __init__(self, node: LavaNode) -> None:
        super().__init__()
        self._logger = node.get_logger()

    def emit(self, record: logging.LogRecord) -> None:
        if record.levelno >= logging.ERROR:
            # with the traceback
            self._logger.error(logging.Formatter().format(record))
        elif record.levelno >= logging.WARNING:
            self._logger.warning(record.getMessage())
        else:
            self._logger.info(record.getMessage())


def main(args: list[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM.

    Returns:
        Exit status: 0; 2 if arguments or parameters are not valid; 1 if the node cannot start or
        resume for another reason.
    """
    stopping: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: stopping.append(number))
    # By default, Fast DDS sends in the publishing thread, which then blocks for seconds while data
    # is resent to a subscriber that has stopped reading. Set this before rclpy.init; other
    # middleware ignores it.
    os.environ.setdefault(middleware.PUBLICATION_MODE, 'ASYNCHRONOUS')
    words = sys.argv[1:] if args is None else args
    try:
        start_ros(args)
        rest = remove_ros_args(['lava_node', *words])[1:]
        if rest:
            expected = '--ros-args and its arguments (lava ros node --help)'
            raise LavaError('an argument', rest[0], expected)
        node = LavaNode(typed=node_parameters.typed(words))
    except (LavaError, ParameterException) as error:
        print(f'lava_node cannot start: {error}', file=sys.stderr)
        rclpy.try_shutdown()
        return USAGE_ERROR
    package = logging.getLogger('lava_ros')
    for text in node_parameters.without_section(words, node.get_fully_qualified_name()):
        node.get_logger().warning(text)
    # replaces the handler that the command line installs
    package.handlers[:] = [_PackageLog(node)]
    package.setLevel(logging.INFO)
    if not node.autostart():
        print(f'lava_node cannot start: {node.refusal}', file=sys.stderr)
        ended, status = node.close(), 1 if node.has_failed else USAGE_ERROR
    else:
        text, is_found = middleware.described()
        if is_found:
            node.get_logger().info(text)
        else:
            node.get_logger().warning(text)
        ended, status = _run(node, lambda: bool(stopping))
    node.destroy_node()
    rclpy.shutdown()
    if not ended:
        # a normal exit would wait for, or crash in, the thread that is still in the solver
        sys.stdout.flush()
        os._exit(status)
    return status


def _run(node: LavaNode, is_stopping: Callable[[], bool]) -> tuple[bool, int]:
    """Run callbacks until the stop; return whether the simulation has ended, and the status."""
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        spin(
            executor,
            until=lambda: is_stopping() or node.failure is not None,
            on_error=node.report_callback,
        )
    finally:
        failure = node.failure
        ended = node.close()
        end = time.monotonic() + 2.0 * ANSWER_TIME
        spin(
            executor,
            until=lambda: not node.is_answering or time.monotonic() > end,
            on_error=node.report_callback,
        )
    if failure is not None:
        node.get_logger().error(f'cannot resume: {failure}')
    node.get_logger().info('stopped' if ended else 'stopped; a step of the simulation was cut off')
    executor.shutdown(timeout_sec=0.0)
    status = 0 if failure is None else USAGE_ERROR if isinstance(failure, LavaError) else 1
    return ended, status


if __name__ == '__main__':
    sys.exit(main())
