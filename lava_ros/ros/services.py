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

"""The node's services: reset, step, pause and record."""

from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from lava_ros.errors import LavaError
from lava_ros.ros.worker import SimulationWorker
from lava_ros.ros.worker_status import WorkerState


class Services:
    """Answers at once; what a command comes to is reported as that of an input."""

    def __init__(
        self,
        node: Node,
        worker: SimulationWorker,
        *,
        command: Callable[[str, 'Future[None]'], None],
        step_length: Callable[[], float],
        start_recording: Callable[[], str],
        stop_recording: Callable[[], str],
    ) -> None:
        """Create the services.

        Args:
            node: The node that has them.
            worker: What they command.
            command: Reports how a command ends, by the name of the service.
            step_length: Gives the simulated time of a step [s].
            start_recording: Begins a bag and gives its name, or raises LavaError.
            stop_recording: Finishes the bag and gives its name, empty when there was none.
        """
        self._worker = worker
        self._command = command
        self._step_length = step_length
        self._start_recording = start_recording
        self._stop_recording = stop_recording
        node.create_service(Trigger, '~/reset', self._on_reset)
        node.create_service(Trigger, '~/step', self._on_step)
        node.create_service(SetBool, '~/pause', self._on_pause)
        node.create_service(SetBool, '~/record', self._on_record)

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        return _answer(response, self._reset)

    def _reset(self) -> str:
        if self._worker.scene is None:
            raise LavaError('reset', WorkerState.WAITING.value, 'a simulation that has started')
        self._command('reset', self._worker.reset())
        return 'starting again at time 0'

    def _on_step(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        return _answer(response, self._step)

    def _step(self) -> str:
        state = self._worker.status.state
        if state is not WorkerState.PAUSED:
            raise LavaError('step', state.value, 'a paused simulation')
        duration = self._step_length()
        self._command('step', self._worker.step(duration))
        return f'advancing {duration:g} s'

    def _on_pause(
        self, request: SetBool.Request, response: SetBool.Response
    ) -> SetBool.Response:
        return _answer(response, lambda: self._pause(request.data))

    def _pause(self, paused: bool) -> str:
        self._command('pause', self._worker.pause(paused))
        return 'pausing' if paused else 'going on'

    def _on_record(
        self, request: SetBool.Request, response: SetBool.Response
    ) -> SetBool.Response:
        return _answer(response, lambda: self._record(request.data))

    def _record(self, is_wanted: bool) -> str:
        if is_wanted:
            return f'recording to {self._start_recording()}'
        return f'recorded {self._stop_recording() or "nothing"}'


def _answer(response: Any, action: Callable[[], str]) -> Any:
    try:
        response.message = action()
    except LavaError as error:
        response.message = str(error)
    else:
        response.success = True
    return response
