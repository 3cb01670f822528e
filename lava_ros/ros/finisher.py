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

"""The thread that finishes snapshots while the simulation goes on. No rclpy in here."""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait


class Finisher:
    """Does one thing at a time in a thread of its own; for the use of one thread."""

    def __init__(self) -> None:
        """Begin at rest."""
        self._pool = ThreadPoolExecutor(1, thread_name_prefix='lava snapshots')
        self._latest: Future[None] | None = None

    @property
    def is_busy(self) -> bool:
        """Whether something is under way."""
        return self._latest is not None and not self._latest.done()

    def begin(
        self,
        action: Callable[[], None],
        *,
        then: Callable[[], None],
        on_error: Callable[[Exception], object],
    ) -> None:
        """Begin something.

        Args:
            action: What to do in the thread.
            then: Called there when that is done.
            on_error: Called there with what the action has raised, in place of ``then``.
        """

        def act() -> None:
            try:
                action()
            except Exception as error:
                on_error(error)
            else:
                then()

        self._latest = self._pool.submit(act)

    def afterwards(self, action: Callable[[], object]) -> None:
        """Call something in any thread when nothing is under way any more."""
        if self._latest is None:
            action()
        else:
            self._latest.add_done_callback(lambda _: action())

    def wait(self) -> bool:
        """Wait for what is under way, and say whether there was anything since the last wait."""
        latest, self._latest = self._latest, None
        if latest is not None:
            wait([latest])
        return latest is not None

    def close(self) -> None:
        """Wait for what is under way and end the thread."""
        self.wait()
        self._pool.shutdown()
