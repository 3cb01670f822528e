# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Sentinel members review the effects; all members run with the effects they call for."""

from collections.abc import Generator, Sequence
from dataclasses import replace
from functools import partial
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from disc_flow import disc_members, disc_plan, same
from lava_ros.errors import LavaError
from lava_ros.forecast.ensemble import (
    Ensemble,
    run_ensemble,
    run_here,
    run_in_processes,
    run_on_cluster,
)
from lava_ros.forecast.members import make_plan, Plan, run_members
from lava_ros.forecast.probability import Footprint, footprint_of
from lava_ros.forecast.sampling import draw_members, Member
from lava_ros.forecast.sentinels import CalledEffect, is_sentinel, MAX_SENTINELS, REVIEWS
from lava_ros.forecast.store import Store
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
from slope_scenes import uncertain_scene

COUNT = 2


def pulse(**options: Any) -> Plan:
    """Return the plan of a vent that soon closes: yield strength matters where lava thins."""
    scene = uncertain_scene(((0.0, 10.0), (300.0, 0.0)), yield_strength=14.0)
    return make_plan(scene, horizon=900.0, accuracy=Accuracy(), samples=20, **options)


PULSE = pulse()
MEMBERS = draw_members(PULSE.scene, COUNT)


def run(folder: Path, plan: Plan = PULSE, runner: Any = None) -> tuple[Ensemble, Plan]:
    """Return the ensemble of a folder, and the plan of its members."""
    store, runner = Store(folder, plan), runner or partial(run_here, device='cpu')
    ensemble = run_ensemble(MEMBERS, store, runner=runner)
    assert store.plan.scene is plan.scene
    return ensemble, store.plan


@pytest.fixture(scope='module')
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Ensemble, Plan]:
    """Run the ensemble with one worker."""
    return run(tmp_path_factory.mktemp('whole'))


def test_a_sentinel_switches_an_effect_on_for_all_members(whole: tuple[Ensemble, Plan]) -> None:
    _, plan = whole
    assert not PULSE.effects.yielding and plan.effects == replace(PULSE.effects, yielding=True)
    (item,) = plan.switched_on
    assert (item.effect, item.member) == ('yielding', 0)
    assert item.number > item.threshold == 0.01 and 112.5 <= item.time_s < 160.0


@pytest.mark.nightly
def test_local_processes_run_all_members_again(
    whole: tuple[Ensemble, Plan], tmp_path: Path
) -> None:
    ensemble, plan = run(tmp_path, runner=partial(run_in_processes, workers=2, device='cpu'))
    assert same(ensemble.maps, whole[0].maps) and plan.switched_on == whole[1].switched_on


@pytest.mark.nightly
def test_a_cluster_runs_all_members_again(whole: tuple[Ensemble, Plan], tmp_path: Path) -> None:
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50
    ) as cluster:
        runner = partial(run_on_cluster, scheduler=cluster.scheduler_address, device='cpu')
        ensemble, plan = run(tmp_path, runner=runner)
    assert same(ensemble.maps, whole[0].maps) and plan.switched_on == whole[1].switched_on


def test_maps_equal_those_with_the_effect_forced_on(
    whole: tuple[Ensemble, Plan], tmp_path: Path
) -> None:
    forced, plan = run(tmp_path / 'on', pulse(effects={'yielding': True}))
    assert same(forced.maps, whole[0].maps) and not plan.switched_on
    without, plan = run(tmp_path / 'off', pulse(effects={'yielding': False}))
    assert not plan.effects.yielding and not plan.switched_on
    assert not same(without.maps, whole[0].maps)
    assert plan.explain_effects()['yielding'] == 'off: forced'


def test_members_without_a_folder_have_the_same_effects(whole: tuple[Ensemble, Plan]) -> None:
    found = run_members(PULSE, MEMBERS[::-1], device='cpu')
    expected = run_members(whole[1], MEMBERS[::-1], device='cpu')
    assert [item.index for item in found] == [1, 0]
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one.peak, other.peak)
        assert not one.called


def test_only_sentinels_measure(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    count, measure = 0, Simulation.measure_scales

    def counted(simulation: Simulation) -> Any:
        nonlocal count
        count += 1
        return measure(simulation)

    monkeypatch.setattr(Simulation, 'measure_scales', counted)
    run(tmp_path)
    # member 0 at its first review, and again with yield strength
    assert count == 1 + len(REVIEWS) == 4
    sentinels = list(filter(is_sentinel, range(10_000)))
    assert sentinels == list(range(0, 32 * MAX_SENTINELS, 32)) and MAX_SENTINELS == 8


#: Effect that each sentinel calls for, and an effect that must be on before.
CALLS = {0: ('inertia', 'yielding'), 32: ('yielding', ''), 64: ('conduction', '')}


class Calling:
    """Runs members without a solver; some sentinels call for effects that are off."""

    def __init__(self, dies_after: int = 1000) -> None:
        self.dies_after = dies_after
        self.rounds: list[list[int]] = []

    def __call__(self, plan: Plan, members: Sequence[Member]) -> Generator[Footprint, None, None]:
        self.rounds.append([])
        # sentinels with the highest indices end first
        first = sum(is_sentinel(member.index) for member in members)
        for member in (*members[:first][::-1], *members[first:]):
            if sum(map(len, self.rounds)) == self.dies_after:
                raise KeyboardInterrupt
            self.rounds[-1].append(member.index)
            (fields,) = disc_members(plan, [member])
            effect, other = CALLS.get(member.index, ('', ''))
            called = ()
            if effect and effect not in plan.effects and (not other or other in plan.effects):
                called = (CalledEffect(effect, 2.0, 1.0, member.index, 60.0),)
            yield replace(footprint_of(fields, plan), called=called)


DISCS = disc_plan()
DISC_MEMBERS = draw_members(DISCS.scene, 70)
ITEM = {'effect': 'inertia', 'number': 2.0, 'threshold': 1.0, 'member': 0, 'time_s': 60.0}


def run_discs(folder: Path, runner: Calling, count: int = 70) -> Plan:
    """Run discs in a folder, and return their final plan."""
    store = Store(folder, DISCS)
    ensemble = run_ensemble(DISC_MEMBERS[:count], store, runner=runner)
    assert ensemble.maps.members == count
    return store.plan


def test_the_sentinel_with_the_lowest_index_decides(tmp_path: Path) -> None:
    runner = Calling()
    plan = run_discs(tmp_path / 'whole', runner)
    found = [(item.effect, item.member) for item in plan.switched_on]
    assert found == [('yielding', 32), ('inertia', 0), ('conduction', 64)]
    # sentinels run first, and each waits for lower indices
    assert runner.rounds[:3] == [[64, 32, 0]] * 3
    assert sorted(runner.rounds[3]) == list(range(70))
    for count in (1, 40):
        run_discs(tmp_path / f'{count}', Calling(), count)
        assert run_discs(tmp_path / f'{count}', Calling()).switched_on == plan.switched_on
    for dies_after in (0, 1, 4, 7, 13):
        folder = tmp_path / f'stop{dies_after}'
        with pytest.raises(KeyboardInterrupt):
            run_discs(folder, Calling(dies_after))
        assert run_discs(folder, Calling()).switched_on == plan.switched_on


def test_folder_keeps_switched_on_effects_and_reasons(tmp_path: Path) -> None:
    plan = run_discs(tmp_path, Calling())
    known = json.loads((tmp_path / 'run.json').read_text())['plan']
    assert known['effects']['inertia'] is True and known['forced'] == {}
    assert known['switched_on'][1] == ITEM
    again = Store(tmp_path, DISCS).plan
    assert (again.effects, again.switched_on) == (plan.effects, plan.switched_on)
    assert again.explain_effects()['inertia'].endswith(' = 2 > 1 in member 0 at 60 s')
    with pytest.raises(LavaError, match=r'plan\.forced\.inertia'):
        Store(tmp_path, replace(DISCS, forced={'inertia': False}))


@pytest.mark.parametrize('found', [
    'nothing', None, [3], [{'effect': 'inertia'}], [{**ITEM, 'effect': 'magic'}],
    [{**ITEM, 'number': 'many'}],
])
def test_a_damaged_list_of_effects_is_refused(found: object, tmp_path: Path) -> None:
    Store(tmp_path, DISCS)
    (tmp_path / 'members/0000000.npz').touch()
    path = tmp_path / 'run.json'
    known = json.loads(path.read_text())
    known['plan']['switched_on'] = found
    path.write_text(json.dumps(known))
    with pytest.raises(LavaError, match=r'plan\.switched_on'):
        Store(tmp_path, DISCS)
