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

"""Limits of memory and time for what reads what nobody means well with."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
import resource
import signal


@contextmanager
def bounded(memory: int, patience: int = 120) -> Iterator[None]:
    """End what takes more memory [bytes] than this process has and so much, or too long [s]."""

    def end(*_: object) -> None:
        raise TimeoutError

    before = resource.getrlimit(resource.RLIMIT_AS)
    now = int(Path('/proc/self/statm').read_text().split()[0]) * resource.getpagesize()
    signal.signal(signal.SIGALRM, end)
    signal.alarm(patience)
    resource.setrlimit(resource.RLIMIT_AS, (now + memory, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)
        signal.alarm(0)
