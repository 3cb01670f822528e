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

"""Nothing is lost: not by a worker that dies, not by a run that is killed, not on disk."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
import multiprocessing
import os
from pathlib import Path
import signal
import sys
from typing import Any

from distributed import Client, LocalCluster
import numpy as np
import pytest

from disc_flow import disc_members, disc_plan, HORIZON, same, TERRAIN
from lava_ros.errors import LavaError
from lava_ros.forecast.assimilation import Outline
from lava_ros.forecast.ensemble import (
    default_workers,
    Ensemble,
    run_ensemble,
    run_here,
    run_in_processes,
    run_on_cluster,
    Store,
)
from lava_ros.forecast.members import make_plan, Plan
from lava_ros.forecast.probability import Footprint, footprint_of
from lava_ros.forecast.sampling import draw_members, Member
from lava_ros.maps.forecast import HazardMaps
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.scene.uncertainty import uncertainty_from_dict
from lava_ros.simulation.accuracy import Accuracy

PLAN = disc_plan()

MEMBERS = draw_members(PLAN.scene, 24)


class Discs:
    """Runs members without a solver, last first, and dies after some."""

    def __init__(self, dies_after: int = 1000) -> None:
        self.dies_after = dies_after
        self.ran: list[int] = []

    def __call__(self, plan: Plan, members: Sequence[Member]) -> Iterable[Footprint]:
        for member in reversed(members):
            if len(self.ran) == self.dies_after:
                raise KeyboardInterrupt
            self.ran.append(member.index)
            (fields,) = disc_members(plan, [member])
            yield footprint_of(fields, plan)


def undisturbed(folder: Path, count: int = 24) -> Ensemble:
    """The ensemble in one go."""
    return run_ensemble(PLAN, MEMBERS[:count], Store(folder, PLAN), runner=Discs())


def test_what_was_interrupted_goes_on(tmp_path: Path) -> None:
    """Finished members are not run again, and the maps are those of an undisturbed run."""
    whole = undisturbed(tmp_path / 'whole')
    first = Discs(dies_after=9)
    with pytest.raises(KeyboardInterrupt):
        run_ensemble(PLAN, MEMBERS, Store(tmp_path / 'parts', PLAN), runner=first)
    seen: list[tuple[int, int]] = []
    second = Discs()
    ensemble = run_ensemble(
        PLAN, MEMBERS, Store(tmp_path / 'parts', PLAN), runner=second,
        on_finished=lambda done, resumed: seen.append((done, resumed)),
    )
    assert ensemble.resumed == 9
    assert sorted(first.ran + second.ran) == list(range(24))
    assert seen == [(done, 9) for done in range(10, 25)]
    assert same(ensemble.maps, whole.maps)
    # nothing is left to run, and nothing is
    assert same(
        run_ensemble(PLAN, MEMBERS, Store(tmp_path / 'parts', PLAN), runner=Discs(0)).maps,
        whole.maps,
    )


def test_members_can_be_added(tmp_path: Path) -> None:
    """Eight, then all: the first are kept; eight again are the first eight."""
    few = undisturbed(tmp_path / 'one', 8)
    more = Discs()
    whole = run_ensemble(PLAN, MEMBERS, Store(tmp_path / 'one', PLAN), runner=more)
    assert sorted(more.ran) == list(range(8, 24))
    assert same(whole.maps, undisturbed(tmp_path / 'two').maps)
    assert same(undisturbed(tmp_path / 'one', 8).maps, few.maps)


def test_maps_are_there_while_members_run(tmp_path: Path) -> None:
    """Each time that the first ones have doubled: those of the first 16 are those of 16."""
    plan, members = PLAN, draw_members(PLAN.scene, 70)
    seen: list[HazardMaps] = []

    def ends_first_begun_last(plan: Plan, members: Sequence[Member]) -> Iterator[Footprint]:
        for start in range(0, len(members), 16):
            yield from Discs()(plan, members[start : start + 16][::-1])

    run_ensemble(
        plan, members, Store(tmp_path / 'a', plan), runner=ends_first_begun_last,
        on_maps=seen.append,
    )
    assert [maps.members for maps in seen] == [16, 32, 64]
    assert same(seen[0], undisturbed(tmp_path / 'b', 16).maps)


@pytest.mark.parametrize('damage', ['cut', 'noise', 'empty', 'other', 'partial'])
def test_damaged_members_run_again(damage: str, tmp_path: Path) -> None:
    """A file that was cut off, overwritten, emptied or never finished is as none."""
    whole = undisturbed(tmp_path / 'a')
    path = tmp_path / 'a/members/0000005.npz'
    data = path.read_bytes()
    if damage == 'cut':
        path.write_bytes(data[: len(data) // 2])
    elif damage == 'noise':
        path.write_bytes(data[:100] + bytes(50) + data[150:])
    elif damage == 'empty':
        path.write_bytes(b'')
    elif damage == 'other':
        with path.open('wb') as file:
            np.savez(file, look=np.zeros(3), millimetres=np.zeros(3), corner=np.zeros(2))
    else:
        path.rename(path.with_suffix('.123.partial'))
    again = Discs()
    ensemble = run_ensemble(PLAN, MEMBERS, Store(tmp_path / 'a', PLAN), runner=again)
    assert again.ran == [5]
    assert same(ensemble.maps, whole.maps)


def test_a_folder_has_one_ensemble(tmp_path: Path) -> None:
    """Another scene, plan or seed is refused by what differs, and a folder of other things."""
    Store(tmp_path / 'a', PLAN, seed=1)
    Store(tmp_path / 'a', PLAN, seed=1)
    lava = replace(PLAN.scene.lava, viscosity=200.0)
    ground = Terrain(TERRAIN.elevation + np.float32(1.0), 20.0, epsg=32633,
                     offset=TERRAIN.offset)
    for field, plan, seed in (
        ('seed', PLAN, 2),
        ('plan.horizon_s', replace(PLAN, horizon=7200.0), 1),
        ('scene.lava.viscosity', replace(PLAN, scene=replace(PLAN.scene, lava=lava)), 1),
        ('elevation', replace(PLAN, scene=replace(PLAN.scene, terrain=ground)), 1),
    ):
        with pytest.raises(LavaError) as caught:
            Store(tmp_path / 'a', plan, seed=seed)
        assert caught.value.field == field
    (tmp_path / 'b').mkdir()
    (tmp_path / 'b/letter.txt').write_text('dear')
    with pytest.raises(LavaError, match='--output'):
        Store(tmp_path / 'b', PLAN)
    (tmp_path / 'c').write_text('a file')
    with pytest.raises(LavaError, match='--output'):
        Store(tmp_path / 'c', PLAN)


def test_an_outline_weighs_finished_members(tmp_path: Path) -> None:
    """No member runs again for it; the effective number of members is less; 7200 s is too late."""
    prior = undisturbed(tmp_path / 'a')
    fast = disc_members(PLAN, [replace(MEMBERS[0], discharge=2.0)])[0]
    lava = np.nan_to_num(fast.arrival, nan=np.inf) <= 1200.0
    outline = Outline(1200.0, lava, np.ones_like(lava))
    ensemble = run_ensemble(
        PLAN, MEMBERS, Store(tmp_path / 'a', PLAN), runner=Discs(0), outline=outline
    )
    assert ensemble.weights is not None
    assert ensemble.maps.effective_members < 12.0
    assert ensemble.maps.effective_members == ensemble.weights.effective_members
    # lava that is faster than most goes further
    assert ensemble.maps.probability.sum() > 1.2 * prior.maps.probability.sum()
    late = replace(outline, time=2.0 * HORIZON)
    with pytest.raises(LavaError, match=r'observed\.time'):
        run_ensemble(
            PLAN, MEMBERS, Store(tmp_path / 'a', PLAN), runner=Discs(0), outline=late
        )


def test_a_runner_that_loses_members_is_found_out(tmp_path: Path) -> None:
    """What did not come back is an error, not a map of fewer members."""
    def loses(plan: Plan, members: Sequence[Member]) -> Iterable[Footprint]:
        return Discs()(plan, [member for member in members if member.index != 7])

    with pytest.raises(LavaError, match=r'\[7\]'):
        run_ensemble(PLAN, MEMBERS, Store(tmp_path / 'a', PLAN), runner=loses)


@pytest.fixture(scope='module')
def small(tmp_path_factory: pytest.TempPathFactory) -> tuple[Plan, Sequence[Member], HazardMaps]:
    """Eight members on a slope of 24 x 30 cells, each of which takes a moment; and their maps."""
    y, x = np.mgrid[0:30, 0:24] * 20.0
    scene = Scene(
        Terrain(500.0 - 0.1 * y + 5.0 * np.sin(x / 60.0), 20.0),
        (Vent((240.0, 100.0), 10.0, radius=30.0),),
        Lava(viscosity=5e3),
        uncertainty=uncertainty_from_dict({
            'discharge': {'distribution': 'lognormal', 'median': 1.0, 'factor': 1.5},
            'terrain': {'deviation': 1.0, 'correlation': 60.0},
        }),
    )
    plan = make_plan(scene, horizon=900.0, accuracy=Accuracy(), looks=20)
    members = draw_members(scene, 8)
    store = Store(tmp_path_factory.mktemp('whole') / 'a', plan)
    return plan, members, run_ensemble(plan, members, store, runner=run_here).maps


def listening(pids: Iterable[int]) -> list[str]:
    """What the kernel says of sockets at which processes take connections."""
    own = set()
    for pid in pids:
        for handle in Path(f'/proc/{pid}/fd').iterdir():
            with suppress(OSError):
                own.add(str(handle.readlink()))
    # columns of the state and of the socket's number
    return [
        line
        for kind, state, listens, number in (
            ('tcp', 3, '0A', 9), ('tcp6', 3, '0A', 9), ('unix', 3, '00010000', 6),
        )
        for line in Path(f'/proc/net/{kind}').read_text().splitlines()[1:]
        if line.split()[state] == listens and f'socket:[{line.split()[number]}]' in own
    ]


def test_processes_of_this_machine_are_open_to_nobody(small: Any, tmp_path: Path) -> None:
    """None of an ensemble's processes listens, not even as one is killed, which loses nothing."""
    plan, members, whole = small
    before = listening([os.getpid()])
    seen: list[set[int]] = []

    def look(done: int, resumed: int) -> None:
        workers = {child.pid for child in multiprocessing.active_children() if child.pid}
        seen.append(workers)
        assert listening([os.getpid(), *workers]) == before
        if done == 1:
            os.kill(min(workers), signal.SIGKILL)

    ensemble = run_ensemble(
        plan, members, Store(tmp_path / 'killed', plan),
        runner=partial(run_in_processes, workers=2), on_finished=look,
    )
    assert same(ensemble.maps, whole)
    assert np.nanmax(whole.probability) == 100.0
    assert len(seen[0]) == 2 and not seen[0] & seen[-1]


def test_a_worker_of_a_cluster_that_is_killed_loses_nothing(small: Any, tmp_path: Path) -> None:
    """One of two processes dies in mid-run: every member is there, and the maps are the same."""
    plan, members, whole = small
    killed: list[int] = []
    with LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50
    ) as cluster:
        with Client(cluster) as client:
            pids = list(client.run(os.getpid).values())

        def kill(done: int, resumed: int) -> None:
            if not killed:
                os.kill(pids[0], signal.SIGKILL)
                killed.append(pids[0])

        ensemble = run_ensemble(
            plan,
            members,
            Store(tmp_path / 'killed', plan),
            runner=partial(run_on_cluster, scheduler=cluster.scheduler_address),
            on_finished=kill,
        )
    assert killed and len(pids) == 2
    assert same(ensemble.maps, whole)
    assert len(list((tmp_path / 'killed/members').glob('*.npz'))) == 8


def test_processes_share_the_gpus(monkeypatch: pytest.MonkeyPatch) -> None:
    """One process for each, by their number; without any, as many as there are cores."""
    gpus = ['cuda:0', 'cuda:1']
    monkeypatch.setattr('warp.get_cuda_devices', lambda: gpus)
    shared: list[str | None] = []

    class Processes:
        """The same in this one."""

        def __init__(self, work: Callable[[Sequence[Member]], object], count: int) -> None:
            self.work, self.count = work, count

        def __call__(self, jobs: Sequence[Sequence[Member]]) -> Iterator[tuple[int, object]]:
            for number, job in enumerate(jobs):
                monkeypatch.setattr('lava_ros.forecast.pool._number', number % self.count)
                yield number, self.work(job)

        def close(self) -> None:
            pass

    def run(plan: Plan, members: Sequence[Member], *, device: str | None) -> list[Footprint]:
        shared.append(device)
        return []

    monkeypatch.setattr('lava_ros.forecast.ensemble.Pool', Processes)
    monkeypatch.setattr('lava_ros.forecast.ensemble.run_here', run)
    monkeypatch.setattr('lava_ros.forecast.ensemble.batch_of', lambda plan, device: 1)
    for device, expected in ((None, ['cuda:0', 'cuda:1', 'cuda:0']), ('cuda:1', ['cuda:1'] * 3)):
        shared.clear()
        workers = default_workers()
        assert workers == 2
        list(run_in_processes(PLAN, MEMBERS[:3], workers=workers, device=device))
        assert shared == expected
    gpus.clear()
    assert default_workers() >= 1
    shared.clear()
    list(run_in_processes(PLAN, MEMBERS[:3], workers=3))
    assert shared == [None] * 3


def test_a_cluster_needs_dask(monkeypatch: pytest.MonkeyPatch) -> None:
    """The error says what to install."""
    monkeypatch.setitem(sys.modules, 'distributed', None)
    with pytest.raises(LavaError, match=r"'lava_ros\[ensemble\]'"):
        list(run_on_cluster(PLAN, MEMBERS, scheduler='tcp://localhost:1'))


def test_a_scheduler_out_of_reach_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """An address where nobody listens, and one that is none."""
    monkeypatch.setattr('lava_ros.forecast.ensemble.PATIENCE', 0.3)
    for address in ('tcp://127.0.0.1:9', 'nonsense'):
        with pytest.raises(LavaError, match='--scheduler'):
            list(run_on_cluster(PLAN, MEMBERS, scheduler=address))
