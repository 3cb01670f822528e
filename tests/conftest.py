# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Fixtures for every test."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
import fcntl
import json
import os
from pathlib import Path
import signal
import time
from typing import Any

import pytest

from ros_domain import own_domain

#: Takes the name of a kind, and is a context in which one of it is tried; gives its figures.
Trial = Callable[[str], AbstractContextManager[dict[str, Any]]]


def pytest_configure() -> None:
    """Let Ctrl+C reach the programs that tests start, and keep tests out of other ROS graphs.

    A shell without job control has what it starts with ``&`` ignore it, and so would they.
    """
    os.environ['ROS_DOMAIN_ID'] = str(own_domain())
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
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


@pytest.fixture(scope='session')
def figures() -> Iterator[dict[str, Any]]:
    """What was tried and what came of it, by kind; goes to the file LAVA_FUZZ_FIGURES names.

    Several processes share the tests of ``make nightly``: each adds its own to the file.
    """
    result: dict[str, Any] = {}
    yield result
    path = os.environ.get('LAVA_FUZZ_FIGURES')
    if path:
        with Path(path).open('a+', encoding='utf-8') as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            file.seek(0)
            known = json.loads(file.read() or '{}')
            file.truncate(0)
            file.write(json.dumps(_added(known, result), indent=2) + '\n')


@pytest.fixture(scope='session')
def trial(figures: dict[str, Any]) -> Trial:
    """Counts what is tried of a kind, what fails of it, and the longest that one took."""

    @contextmanager
    def one(kind: str) -> Iterator[dict[str, Any]]:
        row = figures.setdefault(kind, {'tried': 0, 'refused': 0, 'failed': 0, 'longest_s': 0.0})
        row['tried'] += 1
        # until it has gone well
        row['failed'] += 1
        start = time.monotonic()
        try:
            yield row
        finally:
            row['longest_s'] = max(row['longest_s'], time.monotonic() - start)
        row['failed'] -= 1

    return one


def _added(known: Mapping[str, Any], more: Mapping[str, Any]) -> dict[str, Any]:
    """Both: sums of what both count in parts, the larger of what they measure."""
    result = dict(known)
    for name, value in more.items():
        if isinstance(value, Mapping):
            value = _added(result.get(name, {}), value)
        elif isinstance(value, int):
            value += result.get(name, 0)
        elif isinstance(value, float):
            value = max(value, result.get(name, value))
        result[name] = value
    return result
