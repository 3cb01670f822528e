# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A Dask cluster with TLS, as docs/how_to/cluster.md describes it."""

from collections.abc import Iterator
from contextlib import ExitStack
import json
import os
from pathlib import Path
import re
import shlex
import shutil
import signal
import subprocess
import sys
import threading
from typing import Any

import dask
import distributed  # noqa: F401, adds its defaults to the configuration
import numpy as np
import pytest
import rasterio

from command_line import done
from lava_ros.forecast.store import Store

pytestmark = pytest.mark.nightly

ROOT = Path(__file__).parents[2]

BLOCKS = re.findall(
    r'```\w+\n(.*?)```', (ROOT / 'docs/how_to/cluster.md').read_text(encoding='utf-8'), re.DOTALL
)

#: Maximum time until a process of the cluster is up [s].
PATIENCE = 120.0

SCENE = """
terrain: {file: slope.npz}
vents: [{position: [50.0, 100.0], effusion_rate: 10.0}]
lava: {viscosity: 1.0e+4}
"""


def started(stack: ExitStack, line: str, expected: str) -> tuple[subprocess.Popen[str], str]:
    """Start a program of the cluster; return it and what it prints after the expected words."""
    process = subprocess.Popen(
        [sys.executable, '-m', 'dask', *shlex.split(line)[2:]], stderr=subprocess.PIPE, text=True,
        start_new_session=True,
        env={**os.environ, 'DASK_CONFIG': 'cluster.yaml', 'PYTHONPATH': str(ROOT)},
    )
    stack.callback(process.wait)
    stack.callback(kill, process)
    timer = threading.Timer(PATIENCE, kill, [process])
    timer.start()
    stack.callback(timer.cancel)
    assert process.stderr is not None
    for text in process.stderr:
        if found := re.search(rf'{expected}\s*(\S*)', text):
            timer.cancel()
            # the process must not wait for a full pipe
            threading.Thread(target=process.stderr.read, daemon=True).start()
            return process, found[1]
    raise AssertionError(f'{line} ended before it printed {expected!r}')


def kill(process: subprocess.Popen[str]) -> None:
    """Kill a process with its children, without a chance to say goodbye."""
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGKILL)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Enter a folder with a scene, the certificate and the configuration of the page."""
    monkeypatch.chdir(tmp_path)
    _, x = np.mgrid[0:20, 0:30]
    np.savez('slope.npz', elevation=(300.0 - x).astype(np.float32), resolution=10.0, epsg=32633)
    Path('uncertain.yaml').write_text(SCENE)
    subprocess.run(shlex.split(BLOCKS[0]), check=True, capture_output=True)
    Path('cluster.yaml').write_text(BLOCKS[1])


@pytest.fixture
def cluster(folder: None) -> Iterator[tuple[str, list[subprocess.Popen[str]]]]:
    """Start the scheduler and two workers of the page; return the address and the workers."""
    with ExitStack() as stack:
        line = BLOCKS[2].replace('--port 8786', '--port 0 --host 127.0.0.1')
        _, address = started(stack, line, 'Scheduler at:')
        one = BLOCKS[3].replace('tls://HOST:8786', address).replace('--nworkers 4', '')
        workers = [started(stack, one, 'Registered to:')[0] for _ in range(2)]
        yield address, workers


def configured() -> dask.config.set:
    """Use the configuration of the page inside a context, as DASK_CONFIG does for a program."""
    own = dask.config.collect([str(Path('cluster.yaml').resolve())], env={})
    return dask.config.set(dask.config.merge(dask.config.config, own))


def results(folder: str) -> dict[str, Any]:
    """Return the arrays of the maps and of the members of an ensemble."""
    found: dict[str, Any] = {}
    for path in Path(folder).glob('*.tif'):
        with rasterio.open(path) as file:
            found[path.name] = file.read()
    for path in Path(folder).glob('members/*.npz'):
        with np.load(path) as file:
            found.update({f'{path.name}/{name}': file[name] for name in file})
    return found


def test_killed_worker_of_a_cluster_with_tls_changes_nothing(
    cluster: tuple[str, list[subprocess.Popen[str]]], monkeypatch: pytest.MonkeyPatch
) -> None:
    address, workers = cluster
    assert address.startswith('tls://127.0.0.1:')
    line = BLOCKS[4].replace('tls://HOST:8786', address).replace('1h', '5min')
    words = [*shlex.split(line)[2:], '--preset', 'draft', '--device', 'cpu']
    at = words.index('--scheduler')
    here = [*words[:at], '--workers', '1', '-o', 'here', *words[at + 4 :]]
    assert words[at + 2 : at + 4] == ['-o', 'members']
    done(*here)
    written: list[int] = []
    write = Store.write

    def write_and_kill(store: Store, footprint: Any) -> None:
        write(store, footprint)
        written.append(footprint.index)
        if len(written) == 2:
            # the results that it has not yet sent are lost, too
            kill(workers[0])

    monkeypatch.setattr(Store, 'write', write_and_kill)
    with configured():
        done(*words)
    assert workers[0].wait(PATIENCE) == -signal.SIGKILL and workers[1].poll() is None
    assert sorted(written) == list(range(8))
    expected, found = results('here'), results('members')
    assert expected.keys() == found.keys() and len(expected) > 8
    for name, values in expected.items():
        np.testing.assert_array_equal(found[name], values, err_msg=name)
    texts = [Path(name, 'run.json').read_text() for name in ('here', 'members')]
    old, new = map(json.loads, texts)
    assert [name.replace('members/', 'here/') for name in new['files']] == old['files']
    # when, where and how fast
    changed = {key for key in old.keys() | new.keys() if old.get(key) != new.get(key)}
    assert changed <= {
        'begun', 'files', 'members_per_s', 'scheduler', 'wall_time_s', 'workers'
    }


def test_programs_without_the_certificate_are_refused(
    cluster: tuple[str, list[subprocess.Popen[str]]]
) -> None:
    address, _ = cluster
    line = BLOCKS[4].replace('tls://HOST:8786', address)
    without = line.replace('DASK_CONFIG=cluster.yaml', '')
    Path('others').mkdir()
    shutil.copy('cluster.yaml', 'others')
    subprocess.run(shlex.split(BLOCKS[0]), check=True, capture_output=True, cwd='others')
    for command in (
        f'cd others; {line}', without, without.replace('tls://', 'tcp://'),
    ):
        command = command.replace('lava', f'{sys.executable} -m lava_ros.cli.main')
        command = command.replace('uncertain.yaml', f'{Path("uncertain.yaml").resolve()}')
        ended = subprocess.run(
            ['bash', '-c', command], capture_output=True, text=True, check=False,
            env={**os.environ, 'PYTHONPATH': str(ROOT)},
        )
        assert ended.returncode == 2 and '--scheduler is' in ended.stderr, ended
        assert 'with its certificates in DASK_CONFIG' in ended.stderr, ended
