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

"""What pip installs as `lava` and `lava_node`: Ctrl+C during start-up ends them quietly."""

from importlib import import_module
import os
import signal
from types import FrameType

#: Exit status after Ctrl+C, as shells have it.
INTERRUPTED = 128 + signal.SIGINT


def lava() -> int:
    """Run the command line, and return its exit status."""
    return _run('lava_ros.cli.main')


def lava_node() -> int:
    """Run the node, and return its exit status."""
    return _run('lava_ros.ros.node')


def end_start() -> None:
    """Let Ctrl+C raise KeyboardInterrupt from here on: the command begins."""
    if signal.getsignal(signal.SIGINT) is _leave:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _run(module: str) -> int:
    # nohup has made the signal ignored
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _leave)
    return int(import_module(module).main())


def _leave(number: int, _: FrameType | None) -> None:
    # libraries turn a KeyboardInterrupt during their import into errors, or print it
    os._exit(INTERRUPTED)
