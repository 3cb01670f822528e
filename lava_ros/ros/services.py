# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The node's services: reset, step, pause, record and save."""

from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
import traceback
from typing import Any

from std_srvs.srv import SetBool, Trigger

from lava_ros.errors import LavaError, RefusalError
from lava_ros.live.worker_status import WorkerState
from lava_ros.ros.node_graph import NodeGraph
from lava_ros.ros.runtime import NodeRuntime


def create_services(runtime: NodeRuntime, graph: NodeGraph) -> None:
    """Create the services; the results of commands are reported like the results of inputs."""
    logger, worker, take = graph.node.get_logger(), runtime.worker, runtime.allowance.take

    def check_active(name: str) -> None:
        if not runtime.is_active:
            remedy = 'Activate it with ros2 lifecycle set'
            raise RefusalError(name, 'The node is inactive', remedy)

    def commanded(name: str, future: Future[None], text: str) -> str:
        """Return the response to a command, with the reason if it has to wait."""
        runtime.inputs.command(name, future)
        blocked_by = worker.status.blocked_by
        return f'{text}, but later: {blocked_by}' if blocked_by else text

    def reset(_: Any) -> str:
        if worker.view.scene is None:
            problem = 'There is no simulation to reset'
            raise RefusalError('reset', problem, 'Publish a terrain first')
        take('reset')
        logger.info('reset: starting again at time 0')
        return commanded('reset', worker.reset(), 'starting again at time 0')

    def step(_: Any) -> str:
        check_active('step')
        state, duration = worker.status.state, runtime.settings.time_scale
        if state is not WorkerState.PAUSED:
            raise RefusalError('step', f'The simulation is {state.value}', 'Pause it first')
        return commanded('step', worker.step(duration), f'advancing {duration:g} s')

    def save(_: Any) -> str:
        check_active('save')
        take('save')
        return f'saved in {runtime.save()}'

    def pause(request: Any) -> str:
        text = 'pausing' if request.data else 'resuming'
        return commanded('pause', runtime.pause(request.data), text)

    def record(request: Any) -> str:
        if not request.data:
            return f'recorded {runtime.stop_recording() or "nothing"}'
        check_active('record')
        take('record')
        return f'recording to {runtime.start_recording()}'

    def answer(action: Callable[[Any], str], request: Any, response: Any) -> Any:
        """Run ``action`` and fill in the response."""
        try:
            response.message = action(request)
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
            graph.create('service', kind, f'~/{action.__name__}', partial(answer, action))
