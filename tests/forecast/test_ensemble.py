# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Ensembles survive dead workers, interrupted runs and damaged files."""

from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
import os
from pathlib import Path
import re
import signal
from typing import Any

import numpy as np
import pytest

from disc_flow import disc_members, disc_plan, HORIZON, same
from lava_ros.errors import LavaError
from lava_ros.forecast import ensemble as ensembles
from lava_ros.forecast.assimilation import Outline
from lava_ros.forecast.ensemble import Ensemble, run_here, run_in_processes, run_on_cluster
from lava_ros.forecast.members import make_plan, Plan, run_members
from lava_ros.forecast.probability import Footprint, footprint_of, spacing_error_of
from lava_ros.forecast.sampling import draw_members, Member
from lava_ros.forecast.sentinels import is_sentinel
from lava_ros.forecast.store import maps_at, Store
from lava_ros.layers.forecast import HazardMaps
from lava_ros.layers.places import Places
from lava_ros.layers.spacing_error import pair_of
from lava_ros.processes.requests import ChildProcess
from lava_ros.runs.provenance import program
from lava_ros.runs.store import known_record, write_record
from lava_ros.scene.events import TerrainEvent
from lava_ros.simulation.accuracy import Accuracy
from slope_scenes import uncertain_scene

PLAN = disc_plan()
MEMBERS = draw_members(PLAN.scene, 70)


class Discs:
    """Runs members without a solver: sentinels first, then the last of every 16."""

    def __init__(self, dies_after: int = 1000) -> None:
        self.dies_after = dies_after
        self.ran: list[int] = []

    def __call__(self, plan: Plan, members: Sequence[Member]) -> Generator[Footprint, None, None]:
        def turn(item: Member) -> tuple[bool, int, int]:
            return not is_sentinel(item.index), item.index // 16, -item.index

        for member in sorted(members, key=turn):
            if len(self.ran) == self.dies_after:
                raise KeyboardInterrupt
            self.ran.append(member.index)
            (fields,) = disc_members(plan, [member])
            yield footprint_of(fields, plan)


def run(folder: Path, runner: Any = None, count: int = 24, **options: Any) -> Ensemble:
    store, runner = Store(folder, PLAN), runner or Discs()
    return ensembles.run_ensemble(MEMBERS[:count], store, runner=runner, **options)


def test_interrupted_ensemble_resumes(tmp_path: Path) -> None:
    whole, folder = run(tmp_path / 'whole'), tmp_path / 'parts'
    first, second = Discs(dies_after=9), Discs()
    with pytest.raises(KeyboardInterrupt):
        run(folder, first)
    recorded: list[tuple[int, int]] = []
    ensemble = run(folder, second, on_finished=lambda *numbers: recorded.append(numbers))
    assert ensemble.resumed == 9
    assert sorted(first.ran + second.ran) == list(range(24))
    assert recorded == [(done, 9) for done in range(10, 25)]
    assert same(ensemble.maps, whole.maps)
    # no member is left to run
    assert same(run(folder, Discs(0)).maps, whole.maps)


def test_members_can_be_added(tmp_path: Path) -> None:
    few, more = run(tmp_path / 'one', count=8), Discs()
    whole = run(tmp_path / 'one', more)
    assert sorted(more.ran) == list(range(8, 24))
    assert same(whole.maps, run(tmp_path / 'two').maps)
    assert same(run(tmp_path / 'one', Discs(0), count=8).maps, few.maps)


def test_maps_are_published_while_members_run(tmp_path: Path) -> None:
    recorded: list[HazardMaps] = []
    run(tmp_path / 'a', count=70, on_maps=recorded.append)
    # member 32 is a sentinel, and has run before member 31
    assert [maps.members for maps in recorded] == [16, 33]
    assert same(recorded[0], run(tmp_path / 'b', count=16).maps)


def _change(path: Path, name: str, value: Any) -> None:
    """Replace an array of a member, or its first cell by an integer; None removes it."""
    with np.load(path) as stored:
        arrays = dict(stored)
    if isinstance(value, int):
        arrays[name].flat[0] = value
    else:
        arrays[name] = value
    with path.open('wb') as file:
        np.savez(file, **{name: value for name, value in arrays.items() if value is not None})


#: Invalid arrays of a member: name, value and error.
WRONG_ARRAYS: dict[str, tuple[str, Any, str]] = {
    'a row of looks': ('look', np.zeros(3, np.uint16), 'is .* shape'),
    'other cells': ('millimetres', np.zeros((2, 3), np.uint32), r'is .* shape \(2, 3\)'),
    'metres': ('millimetres', np.full((2, 3), np.nan), 'is .*float64'),
    'no looks': ('look', None, 'is missing'),
    'three corners': ('corner', np.zeros(3, np.int32), r'is .*\(3,\)'),
    'a corner far away': ('corner', np.array([0, 2**31 - 1], np.int32), 'is 2147483647'),
    'a corner before the first cell': ('corner', np.array([-1, 0], np.int32), 'is -1'),
    'a late look': ('look', 60, 'is 60'),
    'lava of 4295 km': ('millimetres', 2**32 - 1, 'is 4294967295'),
    'two numbers of a pair': ('pair', np.zeros(2), r'is .*\(4,\)'),
    'no number of a pair': ('pair', np.array([0.1, 0.0, np.nan, 0.1]), 'is nan'),
    'no fraction': ('left', np.array([np.nan]), 'is nan'),
    'a fraction of 7': ('left', np.array([7.0]), 'is 7'),
}

DAMAGES: dict[str, Callable[[Path], object]] = {
    'cut': lambda path: path.write_bytes(path.read_bytes()[: path.stat().st_size // 2]),
    'noise': lambda path: path.write_bytes(
        path.read_bytes()[:100] + bytes(50) + path.read_bytes()[150:]
    ),
    'empty': lambda path: path.write_bytes(b''),
    'partial': lambda path: path.rename(path.with_suffix('.123.partial')),
}


@pytest.mark.parametrize('damage', DAMAGES)
def test_damaged_members_run_again(damage: str, tmp_path: Path) -> None:
    whole, again = run(tmp_path), Discs()
    DAMAGES[damage](tmp_path / 'members/0000005.npz')
    ensemble = run(tmp_path, again)
    assert again.ran == [5]
    assert same(ensemble.maps, whole.maps)


@pytest.mark.parametrize('damage', WRONG_ARRAYS)
def test_wrong_arrays_are_named(
    damage: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    run(tmp_path)
    path = tmp_path / 'members/0000005.npz'
    name, value, error = WRONG_ARRAYS[damage]
    _change(path, name, value)
    message = f'{name} of {re.escape(str(path))} {error}'
    none = np.zeros(0, int)
    places = Places((), (), none, none, (), none, none, none, none)
    with pytest.raises(LavaError, match=f'^{message}'):
        maps_at(tmp_path, PLAN, places, members=24)
    again = Discs()
    run(tmp_path, again)
    assert again.ran == [5]
    assert re.search(f'a member is damaged and runs again: {message}', caplog.text)
    assert maps_at(tmp_path, PLAN, places, members=24).members == 24


def test_folder_of_another_ensemble_is_refused(tmp_path: Path) -> None:
    # a folder without members may become that of any ensemble
    for seed in (2, 1):
        Store(tmp_path / 'a', PLAN, seed=seed)
    (tmp_path / 'a/members/0000000.npz').touch()
    Store(tmp_path / 'a', PLAN, seed=1)
    scene = PLAN.scene
    lava = replace(scene.lava, viscosity=200.0)
    ground = replace(scene.terrain, elevation=scene.terrain.elevation + np.float32(1.0))
    wide = replace(scene.vents[0], radius=2.0 * scene.vents[0].radius)
    event = TerrainEvent(600.0, 'new ground', scene.terrain)
    for field, plan, seed in (
        ('seed', PLAN, 2),
        ('plan.horizon_s', replace(PLAN, horizon=7200.0), 1),
        ('scene.lava.viscosity', replace(PLAN, scene=replace(scene, lava=lava)), 1),
        ('--output', replace(PLAN, scene=replace(scene, terrain=ground)), 1),
        ('--output', replace(PLAN, covered=np.ones(scene.terrain.shape, np.float32)), 1),
        ('scene.vents[0].radius', replace(PLAN, scene=replace(scene, vents=(wide,))), 1),
        ('--output', replace(PLAN, scene=replace(scene, vents=(*scene.vents, wide))), 1),
        ('--output', replace(PLAN, scene=replace(scene, events=(event,))), 1),
    ):
        with pytest.raises(LavaError) as caught:
            Store(tmp_path / 'a', plan, seed=seed)
        assert caught.value.field == field
    (tmp_path / 'b').mkdir()
    (tmp_path / 'b/letter.txt').write_text('dear')
    (tmp_path / 'c').write_text('a file')
    for name in 'bc':
        with pytest.raises(LavaError, match='--output'):
            Store(tmp_path / name, PLAN)


def test_members_keep_the_program_that_computed_them(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = Store(tmp_path, PLAN)
    assert not caplog.text
    (tmp_path / 'members/0000000.npz').touch()
    write_record(tmp_path, folder.record | {'program': program() | {'commit': 'abc'}})
    folder.close()
    folder = Store(tmp_path, PLAN)
    assert 'were computed by commit abc' in caplog.text
    assert known_record(tmp_path)['program']['commit'] == 'abc'
    folder.restart(())
    assert known_record(tmp_path)['program'] == program()


def test_an_outline_weighs_finished_members(tmp_path: Path) -> None:
    prior = run(tmp_path)
    fast = disc_members(PLAN, [replace(MEMBERS[0], discharge=2.0)])[0]
    lava = np.nan_to_num(fast.arrival, nan=np.inf) <= 1200.0
    outline = Outline(1200.0, lava, np.ones_like(lava))
    ensemble = run(tmp_path, Discs(0), outline=outline)
    assert ensemble.weights is not None and ensemble.weighted is not None
    assert ensemble.weighted.effective_members < 12.0
    assert ensemble.weighted.effective_members == ensemble.weights.effective_members
    # faster lava flows farther
    assert ensemble.weighted.probability.sum() > 1.2 * prior.maps.probability.sum()
    assert same(ensemble.maps, prior.maps)
    with pytest.raises(LavaError, match=r'observed\.time'):
        run(tmp_path, Discs(0), outline=replace(outline, time=2.0 * HORIZON))


def test_members_lost_by_a_runner_are_an_error(tmp_path: Path) -> None:
    def loses(plan: Plan, members: Sequence[Member]) -> Generator[Footprint, None, None]:
        return Discs()(plan, [member for member in members if member.index != 7])

    with pytest.raises(LavaError, match='Members 7 have not run'):
        run(tmp_path, loses)


#: Runs an ensemble of ``small`` in a folder, and returns its maps.
Runs = Callable[..., HazardMaps]


def test_pairs_of_members_are_kept_with_them(tmp_path: Path) -> None:
    scene = uncertain_scene(10.0)
    plan = make_plan(scene, horizon=400.0, accuracy=Accuracy(refinement=0.5), samples=20)
    drawn, store = draw_members(scene, 6), Store(tmp_path, plan)
    found = ensembles.run_ensemble(drawn, store, runner=run_here).maps
    plan = store.plan
    members = list(store.finished(6))
    assert [item.pair is not None for item in members] == [index % 4 == 0 for index in range(6)]
    first, coarser = (
        run_members(replace(one, forced=None), [drawn[0]], device='cpu')[0]
        for one in (plan, plan.coarser)
    )
    assert plan.coarser.accuracy.spacing == pytest.approx(1.4 * plan.accuracy.spacing)
    shape = plan.scene.terrain.shape
    assert members[0].pair == pair_of(*first.on(shape), *coarser.on(shape))
    assert found.spacing_error is not None and found.spacing_error.pairs == 2
    assert found.spacing_error == spacing_error_of(members[::-1], plan)
    # maps that are made again from the stored members have the same correction
    none = np.zeros(0, int)
    nowhere = Places((), (), none, none, (), none, none, none, none)
    assert same(maps_at(tmp_path, plan, nowhere, members=6), found)
    # members of a running simulation continue with its particles
    live = replace(plan, start=Any)
    assert not any(live.has_pair(item) for item in drawn)


def test_both_runs_of_a_pair_run_side_by_side_on_a_gpu(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = uncertain_scene(10.0)
    plan = make_plan(scene, horizon=200.0, accuracy=Accuracy(refinement=0.3), samples=4)
    drawn = draw_members(scene, 5)
    alone = run_members(plan, drawn, device='cpu')
    most = 0

    def in_turns(routes: Iterable[Iterator[None]], device: str, *, at_once: int) -> Iterator[None]:
        nonlocal most
        active = list(routes)
        most = len(active)
        while active:
            for route in tuple(active):
                if next(route, active) is active:
                    active.remove(route)
                yield

    monkeypatch.setattr('lava_ros.simulation.batch.side_by_side', in_turns)
    together = run_members(plan, drawn, device='cpu')
    assert most == 7 and [item.index for item in together] == [0, 1, 2, 3, 4]
    for one, other in zip(alone, together, strict=True):
        assert one.pair == other.pair and (one.pair is None) == (one.index not in (0, 4))
        assert np.array_equal(one.arrival, other.arrival, equal_nan=True)


@pytest.fixture(scope='module')
def small(tmp_path_factory: pytest.TempPathFactory) -> tuple[Runs, HazardMaps]:
    """Return a function that runs eight members on a slope, and the maps of one run."""
    scene = uncertain_scene(10.0)
    plan, members = make_plan(scene, horizon=900.0, accuracy=Accuracy(), samples=20), 8

    def runs(folder: Path, runner: Any, **options: Any) -> HazardMaps:
        drawn, store = draw_members(scene, members), Store(folder, plan)
        return ensembles.run_ensemble(drawn, store, runner=runner, **options).maps

    return runs, runs(tmp_path_factory.mktemp('whole'), run_here)


def listening(pids: Iterable[int]) -> list[str]:
    """Return the lines of /proc/net about the listening sockets of processes."""
    own = set()
    for pid in pids:
        for handle in Path(f'/proc/{pid}/fd').iterdir():
            with suppress(OSError):
                own.add(str(handle.readlink()))
    # columns of the state and of the inode
    return [
        line
        for kind, state, listens, number in (
            ('tcp', 3, '0A', 9), ('tcp6', 3, '0A', 9), ('unix', 3, '00010000', 6),
        )
        for line in Path(f'/proc/net/{kind}').read_text().splitlines()[1:]
        if line.split()[state] == listens and f'socket:[{line.split()[number]}]' in own
    ]


@pytest.mark.nightly
def test_local_processes_do_not_listen_and_survive_a_kill(
    small: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs, whole = small
    before = listening([os.getpid()])
    started: list[ChildProcess] = []
    recorded: list[set[int]] = []

    class Noted(ChildProcess):
        def __init__(self, loop: str) -> None:
            super().__init__(loop)
            started.append(self)

    def look(done: int, resumed: int) -> None:
        workers = {child.pid for child in started if child.is_usable}
        recorded.append(workers)
        assert listening([os.getpid(), *workers]) == before
        if done == 1:
            for pid in workers:
                os.kill(pid, signal.SIGKILL)

    monkeypatch.setattr('lava_ros.forecast.pool.ChildProcess', Noted)
    maps = runs(tmp_path, partial(run_in_processes, workers=2), on_finished=look)
    assert same(maps, whole)
    assert np.nanmax(whole.probability) == 100.0
    assert len(recorded[0]) == 2 and not recorded[0] & recorded[-1]


def test_processes_share_the_gpus(monkeypatch: pytest.MonkeyPatch) -> None:
    gpus = ['cuda:0', 'cuda:1']
    # device, and number of processes that divide its memory
    shared: list[tuple[str | None, int]] = []

    class Processes:
        def __init__(self, work: Callable[[Sequence[Member]], object], count: int) -> None:
            self.work, self.count = work, count

        def __call__(self, jobs: Sequence[Sequence[Member]]) -> Iterator[tuple[int, object]]:
            for number, job in enumerate(jobs):
                monkeypatch.setattr('lava_ros.forecast.pool._number', number % self.count)
                yield number, self.work(job)

        def close(self) -> None:
            pass

    def run(
        plan: Plan, members: Sequence[Member], *, device: str | None, sharing: int
    ) -> list[Footprint]:
        shared.append((device, sharing))
        return []

    def device_of(name: str | None, method: str) -> Device:
        return Device(name or (gpus[0] if gpus and method == 'particles' else 'cpu'))

    monkeypatch.setattr('warp.get_cuda_devices', lambda: gpus)
    monkeypatch.setattr('lava_ros.simulation.setup.defaults.device_of', device_of)
    monkeypatch.setattr(ensembles, 'count_processes', lambda gpu, method: 4)
    monkeypatch.setattr(ensembles, 'Pool', Processes)
    monkeypatch.setattr(ensembles, 'run_here', run)
    monkeypatch.setattr(ensembles, 'batch_of', lambda plan, device, sharing: 1)
    many, cores = 512 * len(gpus), ensembles.usable_cores()
    on_cells = replace(PLAN, accuracy=replace(PLAN.accuracy, method='cells'))
    for plan, count, device, workers in (
        (PLAN, 3, None, 2), (PLAN, 3, 'cuda:1', 1), (PLAN, many, None, 8),
        (PLAN, many, 'cuda:1', 4), (PLAN, many, 'cpu', cores), (on_cells, many, None, cores),
        (on_cells, 3, 'cuda:0', 1),
    ):
        assert ensembles.default_workers(plan, count, device) == workers
    for plan, device, workers, expected in (
        (PLAN, None, 2, [('cuda:0', 1), ('cuda:1', 1), ('cuda:0', 1)]),
        (PLAN, 'cuda:1', 2, [('cuda:1', 2)] * 3),
        (PLAN, 'cpu', 2, [('cpu', 2)] * 3),
        (on_cells, None, 2, [(None, 2)] * 3),
    ):
        shared.clear()
        list(run_in_processes(plan, MEMBERS[:3], workers=workers, device=device))
        assert shared == expected
    gpus.clear()
    assert ensembles.default_workers(PLAN, 3) == cores


class Device(str):
    """The name of a device."""

    __slots__ = ()

    @property
    def is_cuda(self) -> bool:
        return self.startswith('cuda')


def test_a_cluster_needs_a_scheduler(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ensembles, 'PATIENCE', 0.3)
    for address in ('tcp://127.0.0.1:9', 'nonsense'):
        with pytest.raises(LavaError, match='--scheduler'):
            list(run_on_cluster(PLAN, MEMBERS, scheduler=address))
