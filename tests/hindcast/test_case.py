# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Reading of cases, and errors for invalid input."""

from functools import partial
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rasterio.warp import transform

from eruption import (
    CELL,
    CORNER,
    elevation,
    footprint,
    SHAPE,
    VENT,
    write_case,
    write_case_in_degrees,
    write_grid,
)
from geodata import feature
from lava_ros.errors import LavaError
from lava_ros.hindcast.case import load_case
from lava_ros.scene import Lava, scene_from_yaml
from lava_ros.scene.effusion_rates import Interval
from lava_ros.scene.materials import material_named
from lava_ros.scene.measurements import contour_errors
from lava_ros.scene.ranges import with_ranges
from lava_ros.scene.vent_files import series_of, VentRow


def test_reads_a_case_without_case_yaml(tmp_path):
    case = load_case(write_case(tmp_path / 'valley'))
    assert case.name == case.title == 'valley'
    np.testing.assert_allclose(case.scene.terrain.elevation, elevation(), atol=1e-3)
    assert case.scene.terrain.offset == CORNER
    np.testing.assert_array_equal(case.footprint, footprint() > 0.0)
    (vent,) = case.scene.vents
    assert vent.position == (410.0, 1010.0)
    assert vent.series == ((0.0, 20.0), (5400.0, 10.0), (10800.0, 0.0))
    assert case.duration == 10800.0
    assert case.volume == pytest.approx(162_000.0)
    etna = material_named('etna_basalt')
    assert case.scene.lava == etna.lava
    assert vent.temperature == etna.vent_temperature.value
    assert case.scene.events == ()


def test_case_yaml_replaces_the_defaults(tmp_path):
    text = (
        'title: A valley\nsource: made up\nlava: {material: reunion_basalt, emissivity: 0.5}\n'
        'vent_temperature: 1400\nvent_radius: 25\nambient_temperature: 280\nstart: 1800\n'
        'end: 9000\nlow_pass: 40\nepsg: 32633\n'
    )
    case = load_case(write_case(tmp_path / 'valley', yaml=text))
    assert (case.title, case.source) == ('A valley', 'made up')
    assert case.scene.lava.emissivity == 0.5
    assert case.scene.lava.vft_b == 5558.0
    (vent,) = case.scene.vents
    assert (vent.temperature, vent.radius) == (1400.0, 25.0)
    assert vent.series == ((0.0, 20.0), (3600.0, 10.0), (9000.0, 0.0))
    assert case.duration == 7200.0
    assert case.volume == pytest.approx(20.0 * 3600.0 + 10.0 * 3600.0)
    assert case.scene.ambient_temperature == 280.0
    assert case.scene.terrain.epsg == 32633
    assert case.low_pass == 40.0
    rough = load_case(tmp_path / 'valley', low_pass=0.0)
    assert not np.array_equal(rough.scene.terrain.elevation, case.scene.terrain.elevation)
    kilauea = load_case(tmp_path / 'valley', material='kilauea_tholeiite')
    assert kilauea.scene.lava == material_named('kilauea_tholeiite').lava


def test_ground_of_a_case_may_continue_below_the_sea(tmp_path):
    folder = write_case(tmp_path / 'valley')
    write_grid(folder / 'elevation.asc', elevation() - 2000.0)
    assert load_case(folder).scene.terrain.elevation.min() < -990.0


@pytest.mark.parametrize(('given', 'onset'), [
    ('', None),
    ('effusion_rate: {start: 2021-09-19T14:10:00Z}', '2021-09-19T14:10:00Z'),
    ('effusion_rate: {start: 2021-09-19T14:10:00}', '2021-09-19T14:10:00Z'),
    ('effusion_rate: {start: "2021-09-19T16:10:00+02:00"}', '2021-09-19T16:10:00+02:00'),
    ('effusion_rate: {start: 2021-09-19T14:10:00Z}\nstart: 1800', '2021-09-19T14:40:00Z'),
])
def test_the_onset_is_the_date_of_simulated_time_0(given, onset, tmp_path):
    case = load_case(write_case(tmp_path / 'valley', yaml=given))
    assert (case.onset and case.onset.text) == onset


@pytest.mark.parametrize('kind', ['case', 'scene'])
def test_warns_of_a_material_outside_lava(kind, tmp_path, caplog):
    """A material belongs into the section lava of case and scene files; both places raise."""
    folder = write_case(tmp_path / 'valley')

    def lava_of(text: str) -> Lava:
        path = folder / f'{kind}.yaml'
        path.write_text(text if kind == 'case' else f'terrain: {{file: elevation.asc}}\n{text}')
        scene = load_case(folder).scene if kind == 'case' else scene_from_yaml(path)
        return scene.lava

    expected = lava_of('lava: {material: reunion_basalt, emissivity: 0.5}')
    assert (expected.vft_b, expected.emissivity) == (5558.0, 0.5)
    assert 'material' not in caplog.text
    assert lava_of('material: reunion_basalt\nlava: {emissivity: 0.5}') == expected
    assert f'{kind}.material: its place is lava: {{material: reunion_basalt}}' in caplog.text
    both = 'material: etna_basalt\nlava: {material: reunion_basalt}'
    for text, sentence in (
        (both, '.material and .*lava.material exclude each other'),
        ('material: etna_basalt\nlava: 5', 'a mapping of constants'),
        ('material: obsidian', 'obsidian.*one of'),
    ):
        with pytest.raises(LavaError, match=sentence):
            lava_of(text)


def test_open_vents_divide_the_discharge(tmp_path):
    folder = write_case(tmp_path / 'valley')
    x, y = VENT
    (folder / 'vent.csv').write_text(
        'name,x,y,x_end,y_end,start_s,end_s,share\n'
        f'fissure,{x - 20},{y},{x + 20},{y},,7200,3\n'
        f'lower,{x},{y - 100},,,3600,,1\n'
    )
    case = load_case(folder)
    fissure, lower = case.scene.vents
    assert fissure.end == (430.0, 1010.0)
    assert lower.end is None
    assert fissure.series == ((0.0, 20.0), (3600.0, 15.0), (5400.0, 7.5), (7200.0, 0.0))
    assert lower.series == (
        (0.0, 0.0), (3600.0, 5.0), (5400.0, 2.5), (7200.0, 10.0), (10800.0, 0.0),
    )
    assert case.volume == pytest.approx(162_000.0)


def test_reads_events(tmp_path):
    x, y = VENT
    text = (
        'events:\n'
        f'- {{time: 3600, barrier: {{line: [[{x - 60}, {y - 300}], [{x + 60}, {y - 300}]], '
        'height: 10, width: 20}}\n'
        '- {time: 7200, terrain: later.asc}\n'
    )
    folder = write_case(tmp_path / 'valley', yaml=text)
    write_grid(folder / 'later.asc', elevation() + 1.0)
    barrier, later = load_case(folder).scene.events
    assert (barrier.time, later.time) == (3600.0, 7200.0)
    added = barrier.terrain.elevation - elevation()
    assert added.max() == pytest.approx(10.0, abs=1e-3)
    np.testing.assert_allclose(later.terrain.elevation, elevation() + 1.0, atol=1e-3)


def _as_areas(path: Path) -> None:
    """Replace a grid of the footprint by its area in degrees."""
    corners = np.array([(340, 400), (480, 400), (480, 1020), (340, 1020), (340, 400)]) + CORNER
    ring = np.transpose(transform('EPSG:32633', 'EPSG:4326', *corners.T)).tolist()
    data = {'type': 'FeatureCollection', 'features': [feature('Polygon', [ring])]}
    path.unlink()
    path.with_suffix('.geojson').write_text(json.dumps(data))


def test_reads_a_footprint_of_finer_cells_or_areas(tmp_path):
    """Finer cells on a part of the terrain, and areas in degrees, cover the same cells."""
    expected = footprint() > 0.0
    fine = np.kron(footprint(), np.ones((4, 4)))[40:216, 20:120]
    folder = write_case(tmp_path / 'fine')
    corner = (CORNER[0] + 100.0, CORNER[1] + 200.0)
    write_grid(folder / 'footprint.asc', fine, corner=corner, cell=5.0)
    np.testing.assert_array_equal(load_case(folder).footprint, expected)
    folder = write_case(tmp_path / 'areas', yaml='epsg: 32633\n')
    _as_areas(folder / 'footprint.asc')
    np.testing.assert_array_equal(load_case(folder).footprint, expected)


def test_reads_a_case_in_degrees(tmp_path):
    folder, (x, y) = write_case_in_degrees(tmp_path / 'degrees')
    case = load_case(folder)
    assert case.scene.terrain.epsg == 32633
    assert case.area == pytest.approx(footprint().sum() * CELL**2, rel=0.05)
    east, north = np.add(case.scene.vents[0].position, case.scene.terrain.offset)
    assert (east, north) == pytest.approx(VENT, abs=0.01)
    (folder / 'vent.csv').write_text(f'x,y\n{y},{x}\n')
    with pytest.raises(LavaError, match=rf'{y}.*longitude first'):
        load_case(folder)


@pytest.mark.parametrize('source', ['100 m contours (ground)', 'Outlines by EMS'])
def test_contours_in_the_source_of_a_case_state_the_errors_of_its_ground(tmp_path, source):
    folder = write_case(tmp_path / 'case', yaml=f'epsg: 32633\nsource: {source}\n')
    found = with_ranges(load_case(folder).scene).uncertainty.terrain
    assert found is not None
    assert (found.deviation == contour_errors(100.0).deviation) == ('contours' in source)


def test_fills_holes_if_case_yaml_sets_fill_holes(tmp_path):
    folder = write_case(tmp_path / 'valley', yaml='fill_holes: true\n')
    write_grid(folder / 'elevation.asc', _holed())
    assert load_case(folder).scene.terrain.has_data.all()


def _holed() -> np.ndarray:
    heights = elevation()
    heights[50, 20] = np.nan
    return heights


def test_vents_close_between_intervals():
    rates = Interval(0.0, 1.0, 2.0), Interval(3.0, 4.0, 2.0)
    (series,) = series_of((VentRow('', (0.0, 0.0)),), rates)
    assert series == ((0.0, 2.0), (1.0, 0.0), (3.0, 2.0), (4.0, 0.0))


X, Y = VENT

ELEVATION, FOOTPRINT, RATES = 'elevation.asc', 'footprint.asc', 'effusion_rate.csv'

HEADER = 'start_s,end_s,discharge_m3_per_s'

UPSIDE_DOWN = 'm from the nearest vent ... rows seem to be upside down'

#: Footprint of another eruption: as long as the valley is wide, and far from the vent.
ELSEWHERE = np.eye(*SHAPE, k=-19)[:, ::-1] * (np.indices(SHAPE)[0] < 22)

#: A footprint at another place.
moved = partial(write_grid, values=footprint(), corner=(CORNER[0] + 10_000.0, CORNER[1]))

#: Changes of the files of a valid case, and words of the resulting error. A change is another
#: text, a grid, an old and a new part of the text, a function of the path, or None without file.
WRONG: dict[str, tuple[dict[str, Any], str]] = {
    'no elevation': ({ELEVATION: None}, 'also contains ... elevation.asc'),
    'no footprint': ({FOOTPRINT: None}, 'also contains ... footprint.asc'),
    'elevation upside down': ({ELEVATION: elevation()[::-1]}, 'above all vents ... upside down'),
    'both grids upside down': (
        {ELEVATION: elevation()[::-1], FOOTPRINT: footprint()[::-1]}, UPSIDE_DOWN,
    ),
    'discharge in litres': (
        {RATES: f'{HEADER}\n0,5400,20000\n5400,10800,10000\n'},
        'mean thickness ... too much ... m3/s',
    ),
    'times in hours': (
        {RATES: f'{HEADER}\n0,1.5,20\n1.5,3,10\n'}, 'mean thickness ... too little ... start_s',
    ),
    'vent outside': (
        {'vent.csv': f'x,y\n{X},{Y + 400}\n'},
        "'vent 0' of vent.csv ... on the terrain, which covers easting ... 4180000 to 4181200",
    ),
    'vent in degrees': ({'vent.csv': 'x,y\n15.0,37.7\n'}, 'vent.csv ... these are degrees'),
    'vent of another zone': (
        {'vent.csv': f'x,y\n{X + 500_000},{Y}\n'}, 'vent.csv ... coordinates of another system',
    ),
    'vent on a cell without data': (
        {ELEVATION: _holed()}, "'vent 0' of vent.csv ... this cell has none",
    ),
    'vent of another eruption': (
        {FOOTPRINT: ELSEWHERE},
        'The footprint ... m from the nearest vent ... of the same eruption',
    ),
    'footprint somewhere else': ({FOOTPRINT: moved}, 'the footprint ... data on the terrain'),
    'areas in degrees without a coordinate system of the terrain': (
        {FOOTPRINT: _as_areas},
        'footprint.geojson ... the terrain, which has no coordinate system',
    ),
    'areas in metres without a coordinate system': (
        {FOOTPRINT: _as_areas, 'case.yaml': 'epsg: 32633\n',
         'footprint.geojson': ('[15', '[500315')},
        'footprint.geojson ... places of EPSG:4326 ... of a coordinate system',
    ),
    'footprint of thicknesses': (
        {FOOTPRINT: 3.5 * footprint()},
        'a cell of the footprint ... 3.5 ... 0 (not covered) and 1 (covered)',
    ),
    'empty footprint': ({FOOTPRINT: np.zeros(SHAPE)}, 'The footprint ... covers no cell'),
    'no-data value that the header does not declare': (
        {ELEVATION: lambda path: _change(_change(path, _holed()), ('value -9999', 'value -1'))},
        'elevation of elevation.asc ... -9999 in ... --nodata -9999',
    ),
    # a low hill, because the elevations of a mountain would be out of range
    'heights in centimetres': (
        {ELEVATION: 20.0 * (elevation() - 1000.0)},
        'median slope ... heights and cells both in metres',
    ),
    'other columns': (
        {RATES: (HEADER, 'day,to,q')}, 'first line ... day,to,q ... start, end and effusion_rate',
    ),
    'no vent open': (
        {'vent.csv': f'x,y,start_s\n{X},{Y},3600\n'},
        'vents open at 0 s ... at least one vent with start',
    ),
    'unknown constant': ({'case.yaml': 'lava: {colour: 3}'}, 'case.lava.colour: unknown key'),
    'end before start': ({'case.yaml': 'end: -5'}, 'case.end ... -5 ... above 0 s'),
    **{
        f'no value of {name}': (
            {'case.yaml': f'{name}:'}, f'case.{name} is missing ... expected a',
        ) for name in ('from_outline', 'sea_level', 'title', 'epsg')
    },
    'another system': (
        {'case.yaml': 'epsg: 4326'},
        'terrain latitude ... 4180600 ... degrees north or south, or metres',
    ),
}


def _change(path: Path, change: Any) -> Path:
    if change is None:
        path.unlink()
    elif callable(change):
        change(path)
    elif isinstance(change, np.ndarray):
        write_grid(path, change)
    elif isinstance(change, tuple):
        text = path.read_text(encoding='utf-8')
        assert change[0] in text
        path.write_text(text.replace(*change), encoding='utf-8')
    else:
        path.write_text(change)
    return path


@pytest.mark.parametrize('name', WRONG)
def test_raises_for_invalid_input(name, tmp_path):
    with pytest.raises(LavaError, match='a folder that exists'):
        load_case(tmp_path / 'valley')
    folder = write_case(tmp_path / 'valley')
    changes, words = WRONG[name]
    for file, change in changes.items():
        _change(folder / file, change)
    with pytest.raises(LavaError) as caught:
        load_case(folder)
    message = str(caught.value)
    assert all(word in message for word in words.split(' ... ')), message


def test_raises_for_a_footprint_with_a_wrong_utm_zone(tmp_path):
    import rasterio

    folder = write_case(tmp_path / 'valley')
    for name, epsg in (('elevation', 32633), ('footprint', 32632)):
        with rasterio.open(folder / f'{name}.asc') as source:
            profile = {**source.profile, 'driver': 'GTiff', 'crs': f'EPSG:{epsg}'}
            values = source.read(1)
        with rasterio.open(folder / f'{name}.tif', 'w', **profile) as target:
            target.write(values, 1)
        (folder / f'{name}.asc').unlink()
    with pytest.raises(LavaError, match=r'the footprint.*data on the terrain'):
        load_case(folder)
