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

"""The process of the forecasts, from the node's side. No rclpy in here."""

import multiprocessing
import os
from pathlib import Path
import subprocess
import sys
from typing import Any

import lava_ros

#: How long the process may take to end by itself [s].
_END_TIMEOUT = 2.0

#: Name of an answer, and what it says (``lava_ros.forecast.process``).
Answer = tuple[str, dict[str, Any]]


class ForecastProcess:
    """``lava_ros.forecast.process`` in a child process that ends with this one."""

    def __init__(self) -> None:
        """Start it."""
        package = str(Path(lava_ros.__file__).resolve().parents[1])
        paths = [package, *filter(None, [os.environ.get('PYTHONPATH')])]
        self._connection, other_end = multiprocessing.Pipe()
        with other_end:
            self._child = subprocess.Popen(
                [sys.executable, '-m', 'lava_ros.forecast.process', str(other_end.fileno())],
                stdin=subprocess.DEVNULL,
                # compilers and drivers write where they please
                stdout=sys.__stderr__,
                env=os.environ | {'PYTHONPATH': os.pathsep.join(paths)},
                pass_fds=[other_end.fileno()],
            )

    @property
    def pid(self) -> int:
        """Its number."""
        return self._child.pid

    def order(self, name: str, **values: Any) -> None:
        """Send an order.

        Raises:
            OSError: It has ended.
        """
        self._connection.send((name, values))

    def answer(self, timeout: float) -> Answer | None:
        """The next answer, None when there is none within a time [s].

        Raises:
            OSError: It has ended.
        """
        try:
            if not self._connection.poll(timeout):
                return None
            answer: Answer = self._connection.recv()
            return answer
        except (EOFError, OSError) as error:
            text = f'the process of the forecasts has ended ({self._ending()})'
            raise ChildProcessError(text) from error

    def end(self) -> None:
        """End it, if need be in the middle of a step."""
        self._connection.close()
        try:
            self._child.wait(_END_TIMEOUT)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.wait()

    def _ending(self) -> str:
        try:
            status = self._child.wait(_END_TIMEOUT)
        except subprocess.TimeoutExpired:
            return 'or no longer answers'
        return f'killed by signal {-status}' if status < 0 else f'exit status {status}'
