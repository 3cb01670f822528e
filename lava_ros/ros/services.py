# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The node's services: reset, step, pause, record, save."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
import traceback
from typing import Any, TYPE_CHECKING

from std_srvs.srv import SetBool, Trigger

from lava_ros.errors import LavaError
from lava_ros.ros.allowance import Allowance
from lava_ros.ros.input_topics import InputTopics
from lava_ros.ros.spinning import Entities
from lava_ros.ros.worker import SimulationWorker
from lava_ros.ros.worker_status import WorkerState

if TYPE_CHECKING:
    from lava_ros.ros.active_node import ActiveNode


def create_services(
    active: ActiveNode,
    entities: Entities,
    *,
    worker: SimulationWorker,
    inputs: InputTopics,
    allowance: Allowance,
) -> None:
    """Create the services.

    The result of a command is reported as that of an input is. Calls beyond ``allowance`` are
    refused.
    """
    logger = entities.node.get_logger()

    def check_active(name: str) -> None:
        if not active.is_active:
            raise LavaError(name, 'inactive', 'an active node (ros2 lifecycle set ... activate)')

    def commanded(name: str, future: Future[None], text: str) -> str:
        """What is said of a command, with what it has to wait for."""
        inputs.command(name, future)
        hold_up = worker.status.hold_up
        return f'{text}, but later: {hold_up}' if hold_up else text

    def reset(_: Any) -> str:
        if worker.eruption.scene is None:
            raise LavaError('reset', WorkerState.WAITING.value, 'a simulation that has started')
        allowance.take('reset')
        logger.info('reset: starting again at time 0')
        return commanded('reset', worker.reset(), 'starting again at time 0')

    def step(_: Any) -> str:
        check_active('step')
        state, duration = worker.status.state, active.step_length
        if state is not WorkerState.PAUSED:
            raise LavaError('step', state.value, 'a paused simulation')
        return commanded('step', worker.step(duration), f'advancing {duration:g} s')

    def save(_: Any) -> str:
        check_active('save')
        allowance.take('save')
        return f'saved in {active.save()}'

    def pause(request: Any) -> str:
        text = 'pausing' if request.data else 'going on'
        return commanded('pause', active.pause(request.data), text)

    def record(request: Any) -> str:
        if not request.data:
            return f'recorded {active.stop_recording() or "nothing"}'
        check_active('record')
        allowance.take('record')
        return f'recording to {active.start_recording()}'

    def answer(action: Callable[[Any], str], request: Any, response: Any) -> Any:
        """Answer at once."""
        try:
            response.message = action(request)
        except LavaError as error:
            response.message = str(error)
        except Exception as error:
            # Raised from here, the caller would wait for an answer for ever.
            logger.error(traceback.format_exc())
            response.message = f'{type(error).__name__}: {error}'
        else:
            response.success = True
        return response

    for kind, actions in ((Trigger, (reset, step, save)), (SetBool, (pause, record))):
        for action in actions:
            entities.create(
                'service', kind, f'~/{action.__name__}', partial(answer, action)
            )
