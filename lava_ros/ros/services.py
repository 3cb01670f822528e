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

"""The node's services: reset, step, pause, record, save, and the newest map of each layer."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future
from functools import partial
import traceback
from typing import Any, TYPE_CHECKING

from nav_msgs.srv import GetMap
from std_srvs.srv import SetBool, Trigger

from lava_ros.errors import LavaError
from lava_ros.ros.entities import Entities
from lava_ros.ros.input_topics import InputTopics
from lava_ros.ros.layer_publishers import LayerPublishers
from lava_ros.ros.worker import SimulationWorker
from lava_ros.ros.worker_status import WorkerState

if TYPE_CHECKING:
    from lava_ros.ros.active_node import ActiveNode


class Services:
    """Answers at once; what a command comes to is reported as that of an input."""

    def __init__(
        self,
        active: ActiveNode,
        entities: Entities,
        *,
        worker: SimulationWorker,
        inputs: InputTopics,
        layers: Sequence[LayerPublishers[Any]],
    ) -> None:
        """Create the services."""
        self._active = active
        self._logger = entities.node.get_logger()
        self._worker = worker
        self._inputs = inputs
        for service, name, action in (
            (Trigger, 'reset', lambda _: self._reset()),
            (Trigger, 'step', lambda _: self._step()),
            (Trigger, 'save', lambda _: self._save()),
            (SetBool, 'pause', lambda request: self._pause(request.data)),
            (SetBool, 'record', lambda request: self._record(request.data)),
        ):
            entities.create('service', service, f'~/{name}', partial(self._answer, action))
        for publishers in layers:
            for topic in publishers.grid_topics:
                get = partial(_get_map, publishers, topic)
                entities.create('service', GetMap, f'~/{topic}/get_map', get)

    def _reset(self) -> str:
        if self._worker.eruption.scene is None:
            raise LavaError('reset', WorkerState.WAITING.value, 'a simulation that has started')
        self._logger.info('reset: starting again at time 0')
        return self._commanded('reset', self._worker.reset(), 'starting again at time 0')

    def _step(self) -> str:
        self._check_active('step')
        state = self._worker.status.state
        if state is not WorkerState.PAUSED:
            raise LavaError('step', state.value, 'a paused simulation')
        duration = self._active.step_length
        return self._commanded('step', self._worker.step(duration), f'advancing {duration:g} s')

    def _save(self) -> str:
        self._check_active('save')
        return f'saved in {self._active.save()}'

    def _pause(self, paused: bool) -> str:
        text = 'pausing' if paused else 'going on'
        return self._commanded('pause', self._active.pause(paused), text)

    def _commanded(self, name: str, future: Future[None], text: str) -> str:
        """What is said of a command, with what it has to wait for."""
        self._inputs.command(name, future)
        hold_up = self._worker.status.hold_up
        return f'{text}, but later: {hold_up}' if hold_up else text

    def _record(self, is_wanted: bool) -> str:
        if not is_wanted:
            return f'recorded {self._active.stop_recording() or "nothing"}'
        self._check_active('record')
        return f'recording to {self._active.start_recording()}'

    def _check_active(self, name: str) -> None:
        if not self._active.is_active:
            raise LavaError(name, 'inactive', 'an active node (ros2 lifecycle set ... activate)')

    def _answer(self, action: Callable[[Any], str], request: Any, response: Any) -> Any:
        try:
            response.message = action(request)
        except LavaError as error:
            response.message = str(error)
        except Exception as error:
            # Raised from here, the caller would wait for an answer for ever.
            self._logger.error(traceback.format_exc())
            response.message = f'{type(error).__name__}: {error}'
        else:
            response.success = True
        return response


def _get_map(layers: LayerPublishers[Any], topic: str, _: Any, response: Any) -> Any:
    # Without a map there is one of no cells: this type has no other way to say so.
    response.map = layers.newest(topic) or response.map
    return response
