# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The sea: lava that enters it leaves the map and is counted, and vents under it are refused."""

from dataclasses import replace

import numpy as np
import pytest

from command_line import done
from lava_ros.errors import LavaError
from lava_ros.scene import Scene, scene_from_dict, scene_from_yaml, scene_to_dict, Terrain, Vent
from lava_ros.scene.events import TerrainEvent
from lava_ros.scene.lava import Lava
from lava_ros.scene.materials import default_lava
from lava_ros.scene.reshaping import Barrier, finer, low_pass, with_barriers
from lava_ros.scene.terrain_files import load_terrain
from lava_ros.simulation import Simulation
from lava_ros.simulation.output.checkpoint import from_bytes

#: Slope of 1:5 to the east, from 60 m down to -60 m, with the coast at x = 300 m.
HEIGHT = np.tile(60.0 - 0.2 * (np.arange(60) + 0.5) * 10.0, (30, 1))
COAST = Terrain(HEIGHT, 10.0, sea_level=0.0)
VENT = Vent((150.0, 150.0), 20.0, radius=20.0)
END = 1800.0


def fluid(terrain=COAST, **more):
    lava = Lava.paper(viscosity=1e4, arrhenius=0.0, emissivity=0.0, convection=0.0)
    return Scene(terrain, (VENT,), lava, **more)


def run(scene, until=END):
    simulation = Simulation(scene, device='cpu')
    simulation.advance(until)
    return simulation


def test_lava_that_enters_the_sea_leaves_the_map_and_is_counted():
    simulation = run(fluid())
    budget, snapshot = simulation.budget(), simulation.snapshot()
    assert budget.lost_in_sea > 0.3 * budget.emitted
    assert budget.lost_in_no_data == budget.lost_over_border == 0.0
    assert budget.warnings() == []
    assert ('lost in the sea', f'{budget.lost_in_sea:,.1f} m3') in budget.rows()
    # maps have no values in the sea
    assert np.isnan(snapshot.thickness[:, 30:]).all()
    assert np.isfinite(snapshot.thickness[:, :30]).all()
    assert snapshot.thickness[:, 29].max() > 0.0


def test_without_a_sea_the_same_lava_flows_on():
    budget = run(fluid(replace(COAST, sea_level=None))).budget()
    assert budget.lost_in_sea == budget.lost == 0.0
    assert 'in the sea' not in dict(budget.rows())


def test_sea_and_cells_without_data_are_counted_apart():
    height = np.where(np.arange(30)[:, None] < 15, HEIGHT, np.where(HEIGHT > 0.0, HEIGHT, np.nan))
    budget = run(fluid(Terrain(height, 10.0, sea_level=0.0))).budget()
    assert budget.lost_in_sea > 0.1 * budget.emitted < 10.0 * budget.lost_in_no_data
    assert budget.lost == pytest.approx(budget.lost_in_sea + budget.lost_in_no_data)


def test_resumed_simulation_keeps_sea_and_volume():
    simulation = run(fluid(), 0.5 * END)
    stored = from_bytes(simulation.checkpoint().to_bytes())
    assert stored.scene.terrain.sea_level == 0.0
    again = Simulation.resume(stored, device='cpu')
    assert again.budget().lost_in_sea == simulation.budget().lost_in_sea > 0.0
    for item in (simulation, again):
        item.advance(END)
    assert again.budget() == simulation.budget()


def test_rising_sea_takes_the_lava_it_covers():
    simulation = run(fluid(replace(COAST, sea_level=None)), 0.5 * END)
    assert simulation.budget().lost == 0.0
    simulation.set_terrain(COAST)
    simulation.advance(END)
    budget = simulation.budget()
    assert budget.lost_in_sea > 0.0
    assert np.isnan(simulation.snapshot().thickness[:, 30:]).all()


def test_solidified_lava_in_the_sea_is_counted_there():
    lava = replace(default_lava(), solidus=1355.0, viscosity=1e3)
    scene = Scene(replace(COAST, sea_level=None), (VENT,), lava)
    effects = {'solidification': True, 'cover': True}
    simulation = Simulation(scene, device='cpu', effects=effects)
    simulation.advance(END)
    before = simulation.budget()
    assert before.solidified > 0.0
    # the coast is now at the vent
    simulation.set_terrain(replace(COAST, sea_level=28.0))
    after = simulation.budget()
    gone = before.solidified - after.solidified
    assert gone > 0.0
    gone += before.flowing - after.flowing + before.waiting - after.waiting
    gone += before.lost_over_border - after.lost_over_border
    assert after.lost_in_sea == pytest.approx(gone)


def test_events_have_the_sea_of_the_scene():
    event = TerrainEvent(600.0, 'new ground', Terrain(HEIGHT + 1.0, 10.0))
    scene = fluid(events=(event,))
    assert scene.events[0].terrain.sea_level == 0.0
    assert run(scene).budget().lost_in_sea > 0.0


def test_barrier_out_of_the_sea_is_ground():
    wall = Barrier(((350.0, 50.0), (350.0, 250.0)), height=40.0, width=20.0)
    raised = with_barriers(COAST, [wall])
    assert raised.sea_level == 0.0
    assert raised.has_data[15, 34] and not COAST.has_data[15, 34]
    assert COAST.is_sea.sum() > raised.is_sea.sum()


@pytest.mark.parametrize('change', [
    lambda terrain: finer(terrain, 2), lambda terrain: low_pass(terrain, 20.0),
])
def test_changed_terrain_keeps_coast_and_sea(change):
    changed = change(COAST)
    assert changed.sea_level == 0.0
    part = changed.is_sea.mean()
    assert part == pytest.approx(0.5, abs=0.02) and np.isfinite(changed.elevation).all()


def test_geotiff_of_lava_barrier_keeps_the_sea(tmp_path):
    place = {'resolution': 10.0, 'epsg': 32633, 'sea_level': -12.3}
    np.savez(tmp_path / 'coast.npz', elevation=HEIGHT, **place)
    words = ['--line', '100,20', '100,280', '--height', '5']
    done('barrier', tmp_path / 'coast.npz', '-o', tmp_path / 'dam.tif', *words)
    before, after = (load_terrain(tmp_path / name) for name in ('coast.npz', 'dam.tif'))
    assert after.sea_level == before.sea_level == -12.3
    np.testing.assert_array_equal(after.is_sea, before.is_sea)
    assert load_terrain(tmp_path / 'dam.tif', sea_level=-20.0).sea_level == -20.0


def test_description_of_a_scene_has_the_sea():
    known = scene_to_dict(fluid())['terrain']
    assert known['sea_level'] == 0.0
    again = Terrain(HEIGHT, **{key: value for key, value in known.items() if key != 'shape'})
    assert again.sea_level == 0.0
    assert 'sea_level' not in scene_to_dict(fluid(replace(COAST, sea_level=None)))['terrain']


@pytest.mark.parametrize(
    ('place', 'is_refused'), [((295.0, 150.0), False), ((305.0, 150.0), True)]
)
def test_vent_under_the_sea_is_refused(place, is_refused):
    if not is_refused:
        assert Scene(COAST, (replace(VENT, position=place),)).vents
        return
    with pytest.raises(LavaError, match=r'vents\[0\]\.position is .* the sea up to 0 m'):
        Scene(COAST, (replace(VENT, position=place),))


def write(folder, **options):
    np.savez(folder / 'ground.npz', elevation=HEIGHT, resolution=10.0)
    lines = [f'{name}: {value}' for name, value in {'file': 'ground.npz', **options}.items()]
    vents = 'vents: [{position: [150, 150], discharge: 20}]'
    (folder / 'scene.yaml').write_text(f'terrain: {{{", ".join(lines)}}}\n{vents}\n')
    return folder / 'scene.yaml'


def test_scene_file_has_a_sea_level(tmp_path, caplog):
    caplog.set_level('INFO')
    path = write(tmp_path, sea_level=0)
    assert scene_from_yaml(path).terrain.sea_level == 0.0
    assert '900 in the sea up to 0 m' in caplog.text
    # also on another terrain
    other = scene_from_yaml(path, terrain=load_terrain(tmp_path / 'ground.npz'))
    assert other.terrain.sea_level == 0.0
    assert scene_from_yaml(write(tmp_path)).terrain.sea_level is None


@pytest.mark.parametrize(('level', 'expected'), [
    ('high', 'terrain.sea_level'), (1e6, 'terrain.sea_level'), (60.0, 'the highest ground'),
])
def test_unusable_sea_levels_are_refused(level, expected, tmp_path):
    with pytest.raises(LavaError, match=expected):
        scene_from_yaml(write(tmp_path, sea_level=level))


def test_cells_at_zero_need_no_nodata_with_a_sea(tmp_path, caplog):
    # a cliff of 20 m at the coast would be missing data without a sea level
    height = np.where(HEIGHT > 0.0, HEIGHT + 20.0, 0.0)
    np.savez(tmp_path / 'cliff.npz', elevation=height, resolution=10.0)
    with pytest.raises(LavaError, match='elevations like those around them'):
        load_terrain(tmp_path / 'cliff.npz')
    terrain = load_terrain(tmp_path / 'cliff.npz', sea_level=0.0)
    assert terrain.is_sea.mean() == 0.5 and 'ends the flow at the coast' not in caplog.text


def test_scene_from_plain_data_stays_out_of_the_sea():
    data = {'vents': [{'position': [400.0, 150.0], 'discharge': 5.0}]}
    with pytest.raises(LavaError, match='the sea up to 0 m'):
        scene_from_dict(data, COAST)
