# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The node's services: reset, step, pause, record, save."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
import traceback
from typing import Any, Protocol

from std_srvs.srv import SetBool, Trigger

from lava_ros.errors import LavaError
from lava_ros.live.worker import SimulationWorker
from lava_ros.live.worker_status import WorkerState
from lava_ros.ros.allowance import Allowance
from lava_ros.ros.executor import EntityRegistry
from lava_ros.ros.subscribers import InputSubscribers


class ControlledNode(Protocol):
    """Parts of an active node that services control."""

    is_active: bool

    @property
    def step_length(self) -> float:
        """Length of one requested step [s]."""

    def pause(self, paused: bool) -> Future[None]:
        """Pause or resume the simulation."""

    def save(self) -> str:
        """Save maps, and return their path."""

    def start_recording(self) -> str:
        """Start a bag, and return its path."""

    def stop_recording(self) -> str:
        """Close the bag, and return its path; empty if there was none."""


def create_services(
    active: ControlledNode,
    entities: EntityRegistry,
    *,
    worker: SimulationWorker,
    inputs: InputSubscribers,
    allowance: Allowance,
) -> None:
    """Create the services.

    The results of commands are reported like those of inputs. Calls beyond ``allowance`` are
    refused.
    """
    logger = entities.node.get_logger()

    def check_active(name: str) -> None:
        if not active.is_active:
            raise LavaError(name, 'inactive', 'an active node (ros2 lifecycle set ... activate)')

    def commanded(name: str, future: Future[None], text: str) -> str:
        """Return the response to a command, with the reason if it has to wait."""
        inputs.command(name, future)
        blocked_by = worker.status.blocked_by
        return f'{text}, but later: {blocked_by}' if blocked_by else text

    def reset(_: Any) -> str:
        if worker.session.scene is None:
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
        text = 'pausing' if request.data else 'resuming'
        return commanded('pause', active.pause(request.data), text)

    def record(request: Any) -> str:
        if not request.data:
            return f'recorded {active.stop_recording() or "nothing"}'
        check_active('record')
        allowance.take('record')
        return f'recording to {active.start_recording()}'

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
            entities.create(
                'service', kind, f'~/{action.__name__}', partial(answer, action)
            )
