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

"""Fixtures for every test."""

import os
import signal

import pytest


def pytest_configure() -> None:
    """Let Ctrl+C reach the programs that tests start.

    A shell without job control has what it starts with ``&`` ignore it, and so would they.
    """
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if 'PYTEST_XDIST_WORKER' in os.environ:
        # they share the cores
        os.environ.setdefault('LAVA_THREADS', '1')


def _devices() -> list[str]:
    import warp as wp

    import lava_ros.simulation  # noqa: F401  (quietens Warp)

    return [str(device) for device in wp.get_devices()]


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Run a test that asks for ``device`` on every device there is."""
    if 'device' in metafunc.fixturenames:
        metafunc.parametrize('device', _devices())
