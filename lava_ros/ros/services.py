# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The node's services (reset, step, pause, record, save) and limits of their rates."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
import time
import traceback
from typing import Any, NamedTuple, Protocol

from std_srvs.srv import SetBool, Trigger

from lava_ros.errors import LavaError
from lava_ros.live.worker import SimulationWorker
from lava_ros.live.worker_status import WorkerState
from lava_ros.ros.executor import EntityRegistry
from lava_ros.ros.subscribers import InputSubscribers


class Limit(NamedTuple):
    """A rate limit: a burst of ``calls`` requests, then one more every ``period`` [s]."""

    calls: int
    period: float


#: Limits by name of the service or of the group of parameters. A reset or a change of effects may
#: compile kernels and so delay the simulation; bags use disk space.
LIMITS = {
    'reset': Limit(5, 2.0),
    'effects': Limit(5, 2.0),
    'record': Limit(5, 10.0),
    'save': Limit(5, 10.0),
}


class Allowance:
    """Counts requests and refuses those beyond ``LIMITS``."""

    def __init__(
        self,
        refused: Callable[[str, LavaError], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Allow the full number of calls of each limit.

        Args:
            refused: Called with the name and the error of each refused request.
            clock: Returns wall time [s].
        """
        self._refused = refused
        self._clock = clock
        self._left = {name: (float(limit.calls), clock()) for name, limit in LIMITS.items()}

    def take(self, name: str) -> None:
        """Count a request.

        Args:
            name: Key of ``LIMITS``.

        Raises:
            LavaError: If there are too many such requests.
        """
        calls, period = LIMITS[name]
        left, counted = self._left[name]
        now = self._clock()
        left = min(float(calls), left + (now - counted) / period)
        is_allowed = left >= 1.0
        self._left[name] = left - is_allowed, now
        if not is_allowed:
            expected = f'at most {calls} at once and one more each {period:g} s; try again later'
            self.refuse(name, LavaError(name, 'too often', expected))

    def refuse(self, name: str, error: LavaError) -> None:
        """Report the error of a refused request, and raise it."""
        self._refused(name, error)
        raise error


class _Runtime(Protocol):
    """The parts of ``NodeRuntime`` that services control."""

    is_active: bool

    @property
    def step_length(self) -> float: ...
    def pause(self, paused: bool) -> Future[None]: ...
    def save(self) -> str: ...
    def start_recording(self) -> str: ...
    def stop_recording(self) -> str: ...


def create_services(
    active: _Runtime,
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
