# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Fixtures for every test."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
import fcntl
import json
import math
import os
from pathlib import Path
import signal
import sys
import threading
import time
from typing import Any

import pytest

from deleted_effects import is_left_out
from recording import GRIDS, record
from ros_domain import leave_network, own_domain
from scripts import load_script
from volume import DOUBLE, SINGLE, volume_errors

#: Context of one trial of a kind, by its name; gives the figures of the kind.
Trial = Callable[[str], AbstractContextManager[dict[str, Any]]]


def pytest_configure() -> None:
    """Let Ctrl+C reach the programs that tests start, and isolate the ROS graph of the tests.

    Background programs of a shell without job control ignore Ctrl+C, and so do their children.
    """
    leave_network()
    os.environ['ROS_DOMAIN_ID'] = str(own_domain())
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if 'PYTEST_XDIST_WORKER' in os.environ:
        # workers share the cores
        os.environ.setdefault('LAVA_THREADS', '1')


def pytest_ignore_collect(collection_path: Path) -> bool | None:
    """Leave out tests that name an effect that has been deleted."""
    return is_left_out(collection_path) or None


def _devices() -> list[str]:
    import warp as wp

    import lava_ros.simulation  # noqa: F401  (quietens Warp)

    return [str(device) for device in wp.get_devices()]


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Run a test that uses ``device`` on every device."""
    if 'device' in metafunc.fixturenames:
        metafunc.parametrize('device', _devices())


@pytest.fixture(scope='session', autouse=True)
def listed_writes() -> None:
    """Check that kernels write only what docs/kernels.md lists, whenever a test builds one."""
    compiled = sys.modules.get('lava_ros.simulation.backend.compiled')
    if compiled is not None:
        script = load_script(Path(__file__).parents[1] / 'docs/kernels.py')
        compiled.on_new_kernel.append(script.check)


@pytest.fixture(autouse=True)
def conserved_volume(
    request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> Iterator[None]:
    """Check that simulations conserve the volume of the lava, and that maps show it.

    Each snapshot is checked, and after the test its simulations. The latter only if they are of
    the test's own thread: workers of nodes may be in the middle of a step.
    """
    module = sys.modules.get('lava_ros.simulation.simulation')
    if module is None or request.node.get_closest_marker('spoils_volume'):
        yield
        return
    solver = sys.modules['lava_ros.simulation.particles.lava']
    cells = sys.modules['lava_ros.simulation.cells.lava'].CellLava
    advancing, flown = module.Simulation.advancing, {}
    snapshot_of, begin_snapshot, lost = solver.snapshot_of, cells.begin_snapshot, []

    def recorded(simulation: Any, *arguments: Any, **options: Any) -> Any:
        if threading.current_thread() is threading.main_thread():
            flown[id(simulation)] = simulation
        return advancing(simulation, *arguments, **options)

    def checked(*arguments: Any) -> Any:
        snapshot = snapshot_of(*arguments)
        lost.extend(volume_errors(snapshot, SINGLE))
        return snapshot

    def begun(own: Any, **options: Any) -> Any:
        pending = begin_snapshot(own, **options)
        snapshot = pending.result()
        # of float64, and of the clock by which vents emit
        emitted = 2.0 * math.ulp(snapshot.time) * sum(vent.peak for vent in own.scene.vents)
        rounding = DOUBLE + emitted / max(snapshot.budget.emitted, emitted, DOUBLE)
        lost.extend(volume_errors(snapshot, rounding))
        return pending

    monkeypatch.setattr(module.Simulation, 'advancing', recorded)
    monkeypatch.setattr(solver, 'snapshot_of', checked)
    monkeypatch.setattr(cells, 'begin_snapshot', begun)
    yield
    for simulation in flown.values():
        simulation.begin_snapshot().result()
    assert not lost, '\n'.join(lost)


@pytest.fixture(scope='session')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a bag of unrounded layers with frames at 200, 400, 600 and 800 s."""
    return record(tmp_path_factory.mktemp('floats') / 'bag')


@pytest.fixture(scope='session')
def grids(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a bag of the same frames as grids, which are rounded."""
    return record(tmp_path_factory.mktemp('grids') / 'bag', config=GRIDS)


@pytest.fixture(scope='session')
def figures() -> Iterator[dict[str, Any]]:
    """Collect figures of trials by kind, and add them to the file that LAVA_FUZZ_FIGURES names.

    The processes of ``make nightly`` add to the same file.
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
    """Return a context that counts the trials and failures of a kind, and the longest time."""

    @contextmanager
    def one(kind: str) -> Iterator[dict[str, Any]]:
        row = figures.setdefault(kind, {'tried': 0, 'refused': 0, 'failed': 0, 'longest_s': 0.0})
        row['tried'] += 1
        # subtracted on success
        row['failed'] += 1
        start = time.monotonic()
        try:
            yield row
        finally:
            row['longest_s'] = max(row['longest_s'], time.monotonic() - start)
        row['failed'] -= 1

    return one


def _added(known: Mapping[str, Any], more: Mapping[str, Any]) -> dict[str, Any]:
    """Return the figures of both: sums of counts, the larger of measured values."""
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
