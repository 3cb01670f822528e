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

from collections.abc import Mapping
from contextlib import suppress
import os
from pathlib import Path
import queue
import subprocess
import sys
import threading
from typing import Any

import lava_ros
from lava_ros.forecast import wire

#: How long the process may take to end by itself [s].
_END_TIMEOUT = 2.0

Answer = tuple[dict[str, Any], bytes]


class ForecastProcess:
    """``lava_ros.forecast.process`` in a child process that ends with this one."""

    def __init__(self) -> None:
        """Start it."""
        package = str(Path(lava_ros.__file__).resolve().parents[1])
        paths = [package, *filter(None, [os.environ.get('PYTHONPATH')])]
        child = subprocess.Popen(
            [sys.executable, '-m', 'lava_ros.forecast.process'],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=os.environ | {'PYTHONPATH': os.pathsep.join(paths)},
        )
        assert child.stdin is not None
        assert child.stdout is not None
        self._child, self._stdin, self._stdout = child, child.stdin, child.stdout
        self._answers: queue.Queue[Answer | None] = queue.Queue()
        self._reader = threading.Thread(
            target=self._read, name='lava forecast answers', daemon=True
        )
        self._reader.start()

    @property
    def pid(self) -> int:
        """Its number."""
        return self._child.pid

    def order(self, header: Mapping[str, Any], body: bytes = b'') -> None:
        """Send an order.

        Raises:
            OSError: It has ended.
        """
        wire.write(self._stdin, header, body)

    def answer(self, timeout: float) -> Answer | None:
        """The next answer, None when there is none within a time [s].

        Raises:
            OSError: It has ended.
        """
        try:
            answer = self._answers.get(timeout=timeout)
        except queue.Empty:
            return None
        if answer is None:
            raise ChildProcessError(f'the process of the forecasts has ended ({self._ending()})')
        return answer

    def end(self) -> None:
        """End it, if need be in the middle of a step."""
        # what it has not read of its orders it need not
        with suppress(OSError):
            self._stdin.close()
        try:
            self._child.wait(_END_TIMEOUT)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.wait()
        self._reader.join()
        self._stdout.close()

    def _ending(self) -> str:
        try:
            status = self._child.wait(_END_TIMEOUT)
        except subprocess.TimeoutExpired:
            return 'or no longer answers'
        return f'killed by signal {-status}' if status < 0 else f'exit status {status}'

    def _read(self) -> None:
        try:
            while (answer := wire.read(self._stdout)) is not None:
                self._answers.put(answer)
        finally:
            self._answers.put(None)
