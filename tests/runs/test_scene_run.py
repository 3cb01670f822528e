# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Folders of runs: contents, interruption and resumption."""

from dataclasses import replace
from datetime import datetime, timezone
import json
import logging
from pathlib import Path
import shutil

import fastjsonschema
import numpy as np
import pytest

from lava_ros.bag import BagReader
from lava_ros.errors import LavaError
from lava_ros.files.resources import share_path
from lava_ros.forecast.partner_runs import measure_run
from lava_ros.layers.recording import Recording
from lava_ros.products.run_warnings import warnings_of_moments
from lava_ros.runs import store
from lava_ros.runs.drive import Sink
from lava_ros.runs.provenance import identity_of
from lava_ros.runs.scene_run import Request, SceneRun
from lava_ros.runs.store import CHECKPOINT, known_record, write_record
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.scene.events import TerrainEvent
from lava_ros.scene.input_files import digests, files_in
from lava_ros.scene.onset import recorded_onset
from lava_ros.simulation import MODEL
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.output.checkpoint import from_bytes

SLOPE = Terrain(np.tile(np.linspace(40.0, 0.0, 30), (20, 1)), 10.0)
DAM = replace(SLOPE, elevation=SLOPE.elevation + np.where(np.arange(30) == 12, 5.0, 0.0))
ONSET = datetime(2031, 3, 1, 4, 30, tzinfo=timezone.utc)
SCENE = Scene(
    SLOPE, (Vent((50.0, 100.0), 5.0),), Lava.paper(), onset=ONSET,
    events=(TerrainEvent(130.0, 'a dam', DAM),),
)
TIMES = [60.0, 120.0, 180.0, 240.0, 300.0]


def request(output: Path | None, **changes) -> Request:
    settings = {'preset': 'draft', 'spacing_m': 8.0}
    usual = Request(
        SCENE, 'slope', 300.0, TIMES, settings, lambda: ('draft', Accuracy(spacing=8.0)),
        device='cpu', output=output,
    )
    return replace(usual, **changes)


class Stop(Sink):
    """Interrupts a run as Ctrl+C does."""

    def __init__(self, due):
        self.due = due

    def observe(self, simulation, time):
        raise KeyboardInterrupt


@pytest.fixture(scope='module')
def whole(tmp_path_factory):
    run = SceneRun(request(tmp_path_factory.mktemp('runs') / 'whole'))
    run.run()
    run.finish()
    return run


def interrupted(folder: Path, monkeypatch, time: float = 200.0) -> None:
    """Make a run that has stored its state at 180 s and is interrupted at a time [s]."""
    monkeypatch.setattr(store, 'KEEP_EVERY', np.inf)
    run = SceneRun(request(folder))

    class Keep(Stop):
        def observe(self, simulation, time):
            run.keep()
            self.due = np.inf
            return ()

    with pytest.raises(KeyboardInterrupt), run:
        run.run(Keep(180.0), Stop(time))


def test_folder_describes_the_run(whole):
    folder, snapshot = whole.folder.path, whole.snapshot
    record = json.loads((folder / 'run.json').read_text())
    schema = json.loads(share_path('schemas/run.schema.json').read_text())
    fastjsonschema.compile(schema)(record)
    assert {path.name for path in folder.iterdir()} == {'run.json', 'maps'}
    assert (record['status'], record['maps'], record['node']) == ('finished', 'maps', '/lava')
    assert record['topics']['height_raw'] == '/height_raw'
    assert record['inundated_area_m2'] == snapshot.area(snapshot.inundated)
    assert record['volume_emitted_m3'] == pytest.approx(1500.0)
    assert record['onset'] == '2031-03-01T04:30:00Z'
    assert record['effects'][0]['time'] == 0.0
    assert record['program']['model'] == MODEL


@pytest.mark.parametrize(('spacing', 'is_waiting'), [(8.0, False), (100.0, True), (1e6, True)])
def test_run_whose_lava_waits_in_the_vents_warns_and_has_no_error(spacing, is_waiting, tmp_path):
    run = SceneRun(request(
        tmp_path / 'run', accuracy=lambda: ('draft', Accuracy(spacing=spacing)),
    ))
    run.run()
    error = measure_run(run)
    assert (error is None) is is_waiting
    waiting = [text for text in run.warnings() if 'waits in the vents' in text]
    assert [text[:5] for text in waiting] == ['100 %'] * is_waiting
    run.finish()
    moments = Recording(run.folder.path).timeline.last_run
    assert any('waits in the vents' in text for text in warnings_of_moments(moments)) is is_waiting


@pytest.mark.parametrize(('method', 'viscosity', 'velocity', 'words'), [
    ('particles', 1e5, (3.0, 0.0), ['the velocity of jet has no effect: inertia is off']),
    ('particles', 1e5, (0.0, 0.0), []),
    ('particles', 1.0, (3.0, 0.0), []),
    ('cells', 1e5, (3.0, 0.0), ['the velocity of jet has no effect: inertia is off']),
    ('cells', 1.0, (3.0, 0.0), ['needs inertia', 'the velocity of jet has no effect']),
])
def test_bag_of_a_run_warns_of_effects_that_it_lacks(
    method, viscosity, velocity, words, tmp_path
):
    vent = Vent((50.0, 100.0), 5.0, name='jet', velocity=velocity)
    run = SceneRun(request(
        tmp_path / 'run', scene=Scene(SLOPE, (vent,), Lava.paper(viscosity=viscosity)),
        accuracy=lambda: ('draft', Accuracy(method=method, spacing=10.0)), times=[20.0],
        until=20.0, remarks=('the terrain is upside down',),
    ))
    run.run()
    run.finish()
    words = [*words, 'the terrain is upside down']
    in_bag = ' '.join(warnings_of_moments(Recording(run.folder.path).timeline.last_run)).lower()
    in_record = ' '.join(run.folder.record['warnings'])
    for text in (in_bag, in_record):
        assert [word in text for word in words] == [True] * len(words)
        assert ('velocity' in text) is (len(words) > 1)


@pytest.mark.parametrize(('vents', 'has_none'), [
    ((), True), ((Vent((50.0, 100.0), 0.0),), True),
    ((Vent((50.0, 100.0), ((0.0, 0.0), (900.0, 5.0))),), True),
    ((Vent((50.0, 100.0), ((0.0, 0.0), (30.0, 5.0))),), False),
])
def test_run_without_lava_warns(vents, has_none, tmp_path):
    scene = replace(SCENE, vents=vents, events=())
    run = SceneRun(request(tmp_path / 'run', scene=scene))
    run.run()
    found = [text for text in run.warnings() if text.startswith('there is no lava')]
    assert len(found) == has_none


def test_bag_of_the_run_has_its_maps(whole):
    recording = Recording(whole.folder.path)
    frames = list(recording.frames())
    assert [frame.time >= time for frame, time in zip(frames, TIMES, strict=True)] == [True] * 5
    last, snapshot = frames[-1], whole.snapshot
    assert last.time == 300.0
    thickness = last.layers['thickness'].values
    wet = snapshot.thickness >= 0.1
    np.testing.assert_array_equal(thickness[wet], snapshot.thickness[wet])
    np.testing.assert_array_equal(last.arrived, snapshot.arrived)
    # before and after the dam
    assert [float(frame.elevation[0, 12] - SLOPE.elevation[0, 12]) for frame in frames] == [
        0.0, 0.0, 5.0, 5.0, 5.0
    ]
    onset = recorded_onset(recording.bag.custom_data)
    assert onset is not None and onset.start == ONSET
    assert not recording.bag.damage and not recording.bag.recovered


def test_interrupted_run_continues_with_the_same_result(whole, tmp_path, monkeypatch):
    folder = tmp_path / 'run'
    interrupted(folder, monkeypatch)
    assert not BagReader(folder).recovered
    assert known_record(folder)['status'] == 'running'
    write_record(folder, {**known_record(folder), 'begun': '2021-09-19T14:10:00Z'})
    again = SceneRun(request(folder))
    assert again.is_resumed
    assert again.simulation.time < 200.0
    snapshot = again.run()
    record = again.finish()
    np.testing.assert_array_equal(snapshot.thickness, whole.snapshot.thickness)
    np.testing.assert_array_equal(snapshot.arrived, whole.snapshot.arrived)
    frames, expected = (
        [frame.time for frame in Recording(item).frames()] for item in (folder, whole.folder.path)
    )
    assert frames == expected
    assert {path.name for path in folder.iterdir()} == {'run.json', 'maps_2'}
    known = known_record(whole.folder.path)
    # the date is that of the first command; pages take it from the bag
    assert BagReader(folder).custom_data['begun'] == record['begun'] == '2021-09-19T14:10:00Z'
    same = record.keys() - {'maps', 'wall_time_s', 'begun', 'effects'}
    assert {name: record[name] for name in same} == {name: known[name] for name in same}


def test_killed_run_continues(whole, tmp_path, monkeypatch):
    """A killed process leaves an unfinished bag, with maps after its last state."""
    monkeypatch.setattr(store, 'KEEP_EVERY', np.inf)
    folder, killed = tmp_path / 'run', tmp_path / 'killed'

    class Kill(Stop):
        def observe(self, simulation, time):
            if time < 250.0:
                run.keep()
                self.due = 290.0
                return ()
            shutil.copytree(folder, killed)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), SceneRun(request(folder)) as run:
        run.run(Kill(180.0))
    with pytest.raises(LavaError, match='--output'):
        SceneRun(request(killed, settings={}))
    assert BagReader(killed).recovered
    assert [frame.time > 240.0 for frame in Recording(killed).frames()] == [False] * 3 + [True]
    with SceneRun(request(killed)) as again:
        assert 180.0 <= again.simulation.time < 240.0
        np.testing.assert_array_equal(again.run().thickness, whole.snapshot.thickness)
        again.finish()
    frames, expected = (
        [frame.time for frame in Recording(item).frames()] for item in (killed, whole.folder.path)
    )
    assert frames == expected


def test_run_of_another_model_continues_with_a_warning(tmp_path, monkeypatch, caplog):
    folder = tmp_path / 'run'
    interrupted(folder, monkeypatch)
    path = folder / CHECKPOINT
    path.write_bytes(replace(from_bytes(path.read_bytes()), model=MODEL - 1).to_bytes())
    with caplog.at_level(logging.WARNING):
        SceneRun(request(folder)).folder.close()
    assert f'began with model {MODEL - 1} of' in caplog.text


@pytest.mark.parametrize('kind', ['finished', 'other scene', 'other settings', 'foreign'])
def test_folder_of_another_run_is_kept(kind, whole, tmp_path, monkeypatch):
    folder, changes = tmp_path / 'run', {}
    if kind == 'finished':
        folder = whole.folder.path
    elif kind == 'foreign':
        folder.mkdir()
        (folder / 'notes.txt').write_text('mine')
    else:
        interrupted(folder, monkeypatch)
        changes = {'settings': {}}
        if kind == 'other scene':
            changes = {'scene': replace(SCENE, terrain=replace(SLOPE, elevation=DAM.elevation))}
    before = {path: path.read_bytes() for path in folder.rglob('*') if path.is_file()}
    with pytest.raises(LavaError, match='--output'):
        SceneRun(request(folder, **changes))
    after = {path: path.read_bytes() for path in folder.rglob('*') if path.is_file()}
    assert before == after


def test_run_without_a_folder_gets_an_unused_one(tmp_path, monkeypatch):
    monkeypatch.setattr(store, 'RUNS', tmp_path)
    interrupted(tmp_path / 'slope', monkeypatch)
    for name, changes in (('slope_2', {'settings': {}}), ('slope', {})):
        run = SceneRun(request(None, **changes))
        run.folder.close()
        assert run.folder.path == tmp_path / name
    (tmp_path / 'slope' / CHECKPOINT).unlink()
    again = SceneRun(request(None))
    # without a stored state it starts again
    assert (again.is_resumed, again.simulation.time) == (False, 0.0)
    again.folder.close()


def test_name_of_the_bag_cannot_leave_the_folder(whole, tmp_path):
    for name in ('..', '../x', '/tmp', 'a/b', 3, None):
        record = {**known_record(whole.folder.path), 'maps': name}
        (tmp_path / 'run.json').write_text(json.dumps(record))
        with pytest.raises(LavaError, match='maps of .*run.json'):
            BagReader(tmp_path)


def test_files_of_a_scene_are_found_and_digested(tmp_path):
    for name in ('ground.npz', 'rates.csv', 'later.npz'):
        (tmp_path / name).write_text(name)
    data = {
        'terrain': {'file': 'ground.npz'}, 'vents': [{'effusion_rate': {'file': 'rates.csv'}}],
        'events': [{'time': 3.0, 'terrain': 'later.npz'}, {'terrain': 'missing.npz'}],
    }
    found = digests([*files_in(data, tmp_path), ('given', tmp_path / 'rates.csv')])
    assert [item['path'] for item in found] == ['ground.npz', 'rates.csv', 'later.npz']
    assert found[1]['bytes'] == 9
    assert found[1]['sha256'] == (
        '0b04941484eb88d4508a0c07c4824e0d43034b9bb998ab361a65c27898a718cb'
    )


def test_identity_differs_for_other_grids_and_settings():
    later = replace(SCENE, events=(TerrainEvent(130.0, 'a dam', SLOPE),))
    ids = [identity_of(scene, {'a': a}) for scene in (SCENE, later) for a in (1, 2)]
    assert len(set(ids)) == 4
    assert identity_of(replace(SCENE), {'a': 1}) == ids[0]


def test_folder_in_use_is_refused(tmp_path, monkeypatch):
    folder = tmp_path / 'run'
    interrupted(folder, monkeypatch)
    first = SceneRun(request(folder))
    with pytest.raises(LavaError, match='no other run is writing to'):
        SceneRun(request(folder))
    first.folder.close()
    SceneRun(request(folder)).folder.close()
