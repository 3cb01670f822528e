# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Emplaced flows as lava and as ground, and events that change the ground."""

from dataclasses import replace
import logging
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from geodata import feature, write_features, write_raster, write_scene
from lava_ros.errors import LavaError
from lava_ros.products.gis import Provenance, write_grid
from lava_ros.scene import Lava, Scene, scene_from_yaml, scene_to_dict, Terrain
from lava_ros.scene.emplaced import EmplacedFlow, read_flows
from lava_ros.simulation import Simulation

CORNER = (500_000.0, 4_180_000.0)

#: A slope of 30 x 24 cells of 20 m, from 300 m down to 242 m.
ROWS, COLUMNS, CELL = 30, 24, 20.0


def _ground() -> Terrain:
    y, x = np.mgrid[0:ROWS, 0:COLUMNS] * CELL
    return Terrain(300.0 - 0.1 * y + 0.02 * x, CELL, epsg=32633, offset=CORNER)


GROUND = _ground()


def _flow(cell: float = CELL) -> np.ndarray:
    """Return a lobe up to 6 m thick on cells of a size [m], row 0 in the south."""
    y, x = (np.mgrid[0 : 600 / cell, 0 : 480 / cell] + 0.5) * cell
    return np.maximum(6.0 - np.hypot(x - 240.0, y - 300.0) / 20.0, 0.0).astype(np.float32)


def _write(
    path: Path, values: np.ndarray, *, cell: float = CELL, corner: Any = CORNER, **known: Any
) -> Path:
    """Write a raster, row 0 in the south, with its lower left corner at a place."""
    north_west = (corner[0], corner[1] + values.shape[-2] * cell)
    return write_raster(path, values[..., ::-1, :], cell=cell, north_west=north_west, **known)


def _outline(path: Path, side: float = 100.0) -> Path:
    places = [(0, 0), (side, 0), (side, side), (0, side), (0, 0)]
    return write_features(path, feature('Polygon', [np.add(places, CORNER) + 200.0]))


def _read(folder: Path, **item: Any) -> tuple[Terrain, list[EmplacedFlow]]:
    return read_flows('flows', [item], folder, GROUND)


@pytest.mark.parametrize('cell', [20.0, 10.0, 30.0, 7.5])
def test_raster_of_any_cells_keeps_its_volume(tmp_path, cell, caplog):
    """Resampling to the ground and division into columns do not change the volume."""
    thickness = _flow(cell)
    _write(tmp_path / 'flow.tif', thickness, cell=cell)
    volume = float(thickness.sum(dtype=float)) * cell**2
    with caplog.at_level(logging.INFO):
        ground, (flow,) = _read(tmp_path, file='flow.tif')
    assert ground is GROUND
    assert flow.volume == pytest.approx(volume, rel=1e-9)
    assert f'{volume:,.0f} m3' in caplog.text
    centre = np.array([240.0, 300.0])
    for spacing in (3.0, 19.0, 20.0, 47.0):
        places, volumes = flow.columns(spacing)
        assert volumes.sum() == pytest.approx(volume, rel=1e-9)
        assert (volumes[:, None] * places).sum(axis=0) / volume == pytest.approx(centre, abs=2.0)
        assert GROUND.covered(places).all()
        # columns at most one spacing apart cover the flow
        assert len(places) * spacing**2 >= (flow.thickness > 0.0).sum() * flow.resolution**2
    # not coarser than the file, and not finer than necessary
    wanted = {20.0: 20.0, 10.0: 10.0, 30.0: 20.0, 7.5: 20.0 / 3.0}
    assert flow.resolution == pytest.approx(wanted[cell])


def test_columns_of_a_ring_are_on_lava():
    """The column of a block with a dry centre of mass is on a cell with lava."""
    thickness = np.ones((3, 3))
    thickness[1, 1] = 0.0
    places, volumes = EmplacedFlow(thickness, 10.0, (0.0, 0.0)).columns(30.0)
    assert volumes == pytest.approx([800.0])
    assert tuple(np.floor(places[0] / 10.0)) != (1.0, 1.0)


def test_reads_a_thickness_map_of_another_run(tmp_path):
    """Cells without lava have no data in such a map."""
    thickness = _flow()
    write_grid(tmp_path / 'thickness.tif', 'thickness', thickness, GROUND, Provenance('a'))
    _, (flow,) = _read(tmp_path, file='thickness.tif', temperature=1300.0)
    assert flow.thickness == pytest.approx(thickness, rel=1e-6)
    assert (flow.temperature, flow.source) == (1300.0, 'thickness.tif')


@pytest.mark.parametrize(('stored', 'written', 'factor'), [
    (_flow(), {'unit': 'ft'}, 0.3048),
    (np.rint(20.0 * _flow()).astype(np.uint8), {'scale': (0.05, 1.0), 'nodata': 0}, 1.0),
])
def test_converts_thickness_by_its_unit_scale_and_offset(tmp_path, stored, written, factor):
    _write(tmp_path / 'a.tif', stored, **written)
    _, (flow,) = _read(tmp_path, file='a.tif')
    expected = np.where(stored > 0, factor * _flow() + written.get('scale', (0, 0))[1], 0.0)
    assert flow.thickness == pytest.approx(expected, abs=0.03)


def test_reads_thickness_in_degrees(tmp_path):
    cell = 1.5e-4
    y, x = np.mgrid[0:40, 0:60]
    thickness = np.where(np.hypot(x - 15, y - 20) < 10, 4.0, 0.0).astype(np.float32)
    west, south = 15.0006, 37.7662
    _write(tmp_path / 'a.tif', thickness, cell=cell, corner=(west, south), crs='EPSG:4326')
    _, (flow,) = _read(tmp_path, file='a.tif')
    cells = 111_195.0**2 * cell**2 * np.cos(np.radians(37.767))
    assert flow.volume == pytest.approx(thickness.sum() * cells, rel=0.02)


def test_flow_is_ground_or_an_outline_with_one_thickness(tmp_path):
    _write(tmp_path / 'flow.tif', _flow())
    raised, flows = _read(tmp_path, file='flow.tif', **{'as': 'ground'})
    assert flows == []
    assert raised.elevation - GROUND.elevation == pytest.approx(_flow(), abs=1e-4)
    _outline(tmp_path / 'a.geojson')
    _, (flow,) = _read(tmp_path, file='a.geojson', thickness=3.5)
    assert flow.volume == pytest.approx(100.0 * 100.0 * 3.5)
    # or a volume, of which the lower part may be solid
    raised, (flow,) = _read(tmp_path, file='a.geojson', volume=9e4, solidified=0.3)
    assert flow.volume == pytest.approx(0.7 * 9e4)
    built = float((raised.elevation - GROUND.elevation).sum()) * GROUND.resolution**2
    assert built == pytest.approx(0.3 * 9e4, rel=1e-3)
    with pytest.raises(LavaError, match='exclude each other'):
        _read(tmp_path, file='a.geojson', volume=9e4, thickness=3.0)
    # a part off the terrain is a warning for ground and an error for lava
    _outline(tmp_path / 'wide.geojson', 400.0)
    raised, _ = _read(tmp_path, file='wide.geojson', thickness=2.0, **{'as': 'ground'})
    assert float((raised.elevation - GROUND.elevation).max()) == pytest.approx(2.0, abs=1e-4)
    with pytest.raises(LavaError, match=r'flows\[0\].file: .*off the terrain.*on the terrain'):
        _read(tmp_path, file='wide.geojson', thickness=2.0)


@pytest.mark.parametrize(('values', 'written', 'message'), [
    (_flow() - np.float32(1.0), {}, r"thickness in a.tif is '-1 in .* at least 0 m"),
    (np.where(_flow() > 0, _flow(), np.float32(-9999)), {}, '-9999 in .*-a_nodata -9999'),
    (np.where(_flow() > 5, np.float32(np.nan), _flow()), {}, "'nan in .*finite numbers"),
    (np.where(_flow() > 5, np.float32(np.inf), _flow()), {}, "'inf in .*finite numbers"),
    (_flow(), {'unit': 's'}, "unit of the thickness of a.tif is 's', expected one unit"),
    (_flow() * np.float32(100.0), {}, r'is 529\..*at most 500 m'),
    (_ground().elevation, {}, 'a thickness, not an elevation: it differs by only'),
    (_ground().elevation + np.float32(4.0), {}, 'a thickness, not an elevation: it differs'),
    (_flow(), {'corner': (600_000.0, 4_180_000.0)}, '100 % of a.tif is off the terrain'),
    (_flow(), {'corner': (500_200.0, 4_180_000.0)}, '% of a.tif is off the terrain'),
    (0.0 * _flow(), {}, 'a flow with a cell on the terrain'),
    (_flow().astype(np.uint8), {}, 'thickness: uint8 is the type of a picture'),
    (np.stack([_flow()] * 2), {}, 'one band of thickness'),
    (_flow(), {'description': 'peak_thickness'}, 'thickness at one time'),
])
def test_rejects_invalid_thickness(tmp_path, values, written, message):
    _write(tmp_path / 'a.tif', values, **written)
    with pytest.raises(LavaError, match=message):
        _read(tmp_path, file='a.tif')


def _scene_file(folder: Path, **more: Any) -> Path:
    vents = [{'position': [240.0, 100.0], 'discharge': 10.0, 'radius': 30.0}]
    place = {'epsg': 32633, 'offset': CORNER}
    return write_scene(folder, GROUND.elevation, CELL, {'vents': vents, **more}, **place)


def test_scene_file_has_flows_and_events(tmp_path):
    _write(tmp_path / 'flow.tif', _flow())
    write_grid(
        tmp_path / 'new.tif', 'elevation', GROUND.elevation + 2.0, GROUND, Provenance('a')
    )
    x, y = CORNER
    line = [[x + 100.0, y + 300.0], [x + 300.0, y + 300.0]]
    dam = feature('LineString', line, height=7.0, width=30.0)
    write_features(tmp_path / 'dams.geojson', dam)
    scene = scene_from_yaml(_scene_file(
        tmp_path,
        emplaced_flows=[{'file': 'flow.tif'}],
        events=[
            {'time': 60.0, 'terrain': 'new.tif'},
            {'time': 120.0, 'barrier': {'line': line, 'height': 5.0, 'width': 30.0}},
            {'time': 180.0, 'barriers': 'dams.geojson'},
        ],
    ))
    assert scene.emplaced_flows[0].temperature == scene.vents[0].temperature
    ground, raised = scene.terrain, []
    for event in scene.events:
        ground = event.ground(ground)
        raised.append(float((ground.elevation - scene.terrain.elevation).max()))
    assert raised == pytest.approx([2.0, 7.0, 14.0], abs=1e-3)
    stored = scene_to_dict(scene)
    assert [item['time'] for item in stored['events']] == [60.0, 120.0, 180.0]
    assert stored['emplaced_flows'][0]['volume'] == scene.emplaced_flows[0].volume
    yaml.safe_dump(stored)


def test_new_ground_without_a_system_is_in_that_of_the_scene(tmp_path):
    np.savez(
        tmp_path / 'new.npz', elevation=GROUND.elevation + 1.0, resolution=CELL, offset=CORNER
    )
    events = [{'time': 9.0, 'terrain': 'new.npz'}]
    (event,) = scene_from_yaml(_scene_file(tmp_path, events=events)).events
    assert event.terrain is not None and event.terrain.epsg == 32633


@pytest.mark.parametrize('hot', [1100.0, 1400.0])
def test_emplaced_lava_without_a_temperature_has_that_of_erupting_lava(hot):
    flow = EmplacedFlow(_flow().astype(float), CELL, (0.0, 0.0))
    scene = Scene(GROUND, emplaced_flows=(flow,), lava=Lava.paper(reference_temperature=hot))
    assert scene.emplaced_flows[0].temperature == hot
    temperature = Simulation(scene, device='cpu').sample().temperature
    assert temperature == pytest.approx(hot)


def test_rejects_emplaced_lava_below_the_solidus():
    scene = Scene(GROUND)
    flow = EmplacedFlow(_flow().astype(float), CELL, (0.0, 0.0), 500.0)
    cold = replace(scene.lava, solidus=900.0)
    with pytest.raises(LavaError, match=r'emplaced_flows\[0\].temperature .*above lava.solidus'):
        replace(scene, lava=cold, emplaced_flows=(flow,))
