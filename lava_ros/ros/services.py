# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The node's services: reset, step, pause, record and save.

A service that commands the simulation answers when its thread has executed or refused the command.
Until then the executor runs other callbacks, and polls the waiting answers.
"""

from collections.abc import Awaitable, Callable
from concurrent.futures import Future
from functools import partial
import traceback
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from std_srvs.srv import SetBool, Trigger

from lava_ros.errors import LavaError, RefusalError
from lava_ros.live.worker import STOPPED
from lava_ros.live.worker_status import step_refusal, WorkerState
from lava_ros.ros.node_graph import NodeGraph
from lava_ros.ros.runtime import NodeRuntime


def create_services(runtime: NodeRuntime, graph: NodeGraph) -> None:
    """Create the services; the results of commands are reported like the results of inputs."""
    # the callbacks of the default group would wait for an answer
    group = ReentrantCallbackGroup()
    services: dict[str, Any] = {}
    logger, worker, take = graph.node.get_logger(), runtime.worker, runtime.allowance.take

    def check_active(name: str) -> None:
        if not runtime.is_active:
            remedy = 'Activate it with ros2 lifecycle set'
            raise RefusalError(name, 'The node is inactive', remedy)

    async def commanded(name: str, future: Future[None]) -> None:
        """Wait until the simulation has executed a command; raise its error if it is refused."""
        runtime.inputs.command(name, future)
        await graph.wait(services[name], future)
        if future.cancelled():
            raise RefusalError(name, 'A newer call has replaced this one', 'Wait for its answer')
        if not future.done() or future.exception() is STOPPED:
            problem = f'The node has ended the simulation before {name} was complete'
            raise RefusalError(name, problem, 'Configure the node, and call the service again')
        future.result()

    async def reset(_: Any) -> str:
        if worker.view.scene is None:
            problem = 'There is no simulation to reset'
            raise RefusalError('reset', problem, 'Publish a terrain first')
        take('reset')
        logger.info('reset: starting again at time 0')
        await commanded('reset', worker.reset())
        return 'started again at time 0'

    async def step(_: Any) -> str:
        check_active('step')
        state, duration = worker.status.state, runtime.settings.time_scale
        if state is not WorkerState.PAUSED:
            raise step_refusal(state)
        await commanded('step', worker.step(duration))
        return f'advancing {duration:g} s'

    async def save(_: Any) -> str:
        check_active('save')
        take('save')
        return f'saved in {runtime.save()}'

    async def pause(request: Any) -> str:
        await commanded('pause', runtime.pause(request.data))
        return 'paused' if request.data else 'resumed'

    async def record(request: Any) -> str:
        if not request.data:
            return f'recorded {runtime.stop_recording() or "nothing"}'
        check_active('record')
        take('record')
        return f'recording to {runtime.start_recording()}'

    async def answer(
        action: Callable[[Any], Awaitable[str]], request: Any, response: Any
    ) -> Any:
        """Run ``action`` and fill in the response."""
        try:
            response.message = await action(request)
        except LavaError as error:
            response.message = str(error)
        except Exception as error:
            # An exception raised here would leave the caller waiting for ever.
            logger.error(traceback.format_exc())
            response.message = f'{type(error).__name__}: {error}'
        else:
            response.success = True
        return response

    for kind, actions in ((Trigger, (reset, step, save)), (SetBool, (pause, record))):
        for action in actions:
            name, reply = action.__name__, partial(answer, action)
            services[name] = graph.create(
                'service', kind, f'~/{name}', reply, callback_group=group
            )
