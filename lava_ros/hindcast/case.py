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


"""A case: an eruption that has been mapped, as a folder of files.

docs/VALIDATION.md says what each file holds. Coordinates are those of the elevation; times are
seconds, 0 is that of ``effusion_rate.csv``.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.forecast.rasters import areas_on, raster_on
from lava_ros.hindcast.checks import check_discharge, check_elevation, check_rows, check_vent_rows
from lava_ros.hindcast.tables import (
    Interval,
    read_rates,
    read_vents,
    series_of,
    VentRow,
    volume_of,
)
from lava_ros.scene import ENVIRONMENT, Scene, Terrain, Vent, warn_of_celsius
from lava_ros.scene.lava import Lava
from lava_ros.scene.materials import DEFAULT, lava_from_dict, Material
from lava_ros.scene.projection import projected
from lava_ros.scene.reshaping import low_pass
from lava_ros.scene.terrain_files import load_terrain
from lava_ros.scene.uncertainty import uncertainty_from_dict

#: Names that the grids may have, the first that is there is taken.
ELEVATION = ('elevation.asc', 'elevation.tif')
FOOTPRINT = ('footprint.asc', 'footprint.tif', 'footprint.geojson')

#: Radius of a vent without its own, in cells.
VENT_RADIUS = 1.5

#: Keys of ``case.yaml``.
KEYS = (
    'title',
    'source',
    'material',
    'lava',
    'vent_temperature',
    'vent_radius',
    *ENVIRONMENT,
    'start',
    'end',
    'epsg',
    'fill_holes',
    'low_pass',
    'events',
    'uncertainty',
)


@dataclass(frozen=True)
class Event:
    """Ground that is another from a time [s] on, and what has happened, in a few words."""

    time: float
    terrain: Terrain
    text: str


@dataclass(frozen=True, eq=False)
class Case:
    """An eruption, and what it covered; its name is that of its folder.

    Attributes:
        source: Where the data are from; may be empty.
        scene: Ground, vents and lava. The map frame's origin is the grid's lower-left corner.
        material: The lava that the constants started from, None where the file names none.
        footprint: Where the ground was covered, bool, shape [rows, columns], row 0 in the south.
        start: When the simulation begins [s].
        end: When it ends [s].
        volume: Volume that comes out between [m3].
        low_pass: Width of the filter that the ground went through [m]; 0: none.
    """

    name: str
    title: str
    source: str
    scene: Scene
    material: Material | None
    footprint: np.ndarray
    start: float
    end: float
    volume: float
    events: tuple[Event, ...] = ()
    low_pass: float = 0.0

    @property
    def duration(self) -> float:
        """Time that is simulated [s]."""
        return self.end - self.start

    @property
    def area(self) -> float:
        """Area that was mapped [m2]."""
        return float(self.footprint.sum()) * self.scene.terrain.resolution**2

    def with_lava(
        self, lava: Mapping[str, Any], *, temperature: float | None = None, discharge: float = 1.0
    ) -> 'Case':
        """The same eruption with other constants of the lava, by name.

        ``temperature`` is the eruption temperature [K], None for the present one; ``discharge`` is
        a factor on all discharges.

        Raises:
            LavaError: A name or a value is not usable.
        """
        scene = self.scene
        vents = tuple(
            replace(
                vent,
                temperature=vent.temperature if temperature is None else temperature,
                discharge=tuple((time, flux * discharge) for time, flux in vent.series),
            )
            for vent in scene.vents
        )
        scene = replace(scene, lava=replace(scene.lava, **lava), vents=vents)
        return replace(self, scene=scene, volume=self.volume * discharge)


def load_case(
    directory: str | Path,
    *,
    material: str | None = None,
    low_pass_width: float | None = None,
    vents: Callable[[tuple[VentRow, ...], Terrain], tuple[VentRow, ...]] | None = None,
) -> Case:
    """Read a case.

    Args:
        directory: Its folder.
        material: Name of a lava in place of the case's.
        low_pass_width: Width of a filter of the ground in place of the case's [m].
        vents: Is given the case's vents and its ground, and returns those to take.

    Raises:
        LavaError: A file is missing or cannot be used, or the files do not go together; the
            message says which and why.
    """
    folder = Path(directory)
    if not folder.is_dir():
        raise LavaError('case', str(folder), 'a folder that exists')
    missing = [
        ' or '.join(names)
        for names in (ELEVATION, FOOTPRINT, ('vent.csv',), ('effusion_rate.csv',))
        if not any((folder / name).is_file() for name in names)
    ]
    if missing:
        raise LavaError('case', str(folder), f'a folder that also holds {", ".join(missing)}')
    options = _options(folder)
    if material is not None:
        options['material'] = material
    if low_pass_width is not None:
        options['low_pass'] = low_pass_width
    read = {'epsg': options.get('epsg'), 'fill_holes': options.get('fill_holes', False)}
    path = next(folder / name for name in ELEVATION if (folder / name).is_file())
    ground = load_terrain(path, **read)
    check_elevation(ground)
    footprint = _footprint(folder, ground)
    rates = read_rates(folder / 'effusion_rate.csv')
    rows = _placed(read_vents(folder / 'vent.csv'), ground)
    if vents is not None:
        rows = vents(rows, ground)
    check_vent_rows(rows, ground)
    check_rows(rows, ground, footprint)
    check_discharge(volume_of(series_of(rows, rates)), footprint, ground.resolution)
    lava, used = _lava(options)
    width = validation.number('case.low_pass', options.get('low_pass', 0.0), at_least=0.0)
    start, end = _span(options, rates)
    scene = Scene(
        low_pass(ground, width),
        _vents(options, rows, rates, ground, lava, used, start),
        lava,
        uncertainty=uncertainty_from_dict(options.get('uncertainty', {})),
        **{key: options[key] for key in ENVIRONMENT if key in options},
    )
    warn_of_celsius(scene)
    return Case(
        name=folder.resolve().name,
        title=str(options.get('title', folder.resolve().name)),
        source=str(options.get('source', '')),
        scene=scene,
        material=used,
        footprint=footprint,
        start=start,
        end=end,
        volume=sum(vent.volume_between(0.0, end - start) for vent in scene.vents),
        events=_events(folder, options, ground, width, read),
        low_pass=width,
    )


def _options(folder: Path) -> dict[str, Any]:
    """What ``case.yaml`` says, nothing where there is none."""
    from lava_ros.files.yaml import read_yaml

    path = folder / 'case.yaml'
    if not path.exists():
        return {}
    data = read_yaml('case', path)
    return validation.keys('case', {} if data is None else data, allowed=KEYS)


def _footprint(folder: Path, ground: Terrain) -> np.ndarray:
    """Where the ground was covered: a grid of 0 and 1, or areas, of any system, cells and part."""
    path = next(folder / name for name in FOOTPRINT if (folder / name).is_file())
    if path.suffix == '.geojson':
        values = areas_on(ground, path, field='the footprint').astype(float)
    else:
        values = np.nan_to_num(raster_on(ground, path, field='the footprint'))
    other = values[(values != 0.0) & (values != 1.0)]
    if other.size:
        right = '0 (not covered) and 1 (covered) only, and no data'
        raise LavaError('a cell of the footprint', float(other[0]), right)
    covered = values == 1.0
    if not covered.any():
        right = 'at least one cell of the elevation that was covered'
        raise LavaError('the footprint', f'{path.name} without one', right)
    return covered


def _placed(rows: tuple[VentRow, ...], ground: Terrain) -> tuple[VentRow, ...]:
    """Vents in the elevation's metres, those given as longitude and latitude too."""

    def place(point: tuple[float, float]) -> tuple[float, float]:
        is_degrees = abs(point[0]) <= 180.0 and abs(point[1]) <= 90.0
        if ground.epsg is None or not is_degrees or ground.covers(*ground.to_map(*point)):
            return point
        there = projected(ground, *point)
        return point if ground.cell_at(*ground.to_map(*there)) is None else there

    return tuple(
        replace(row, place=place(row.place), other_end=row.other_end and place(row.other_end))
        for row in rows
    )


def _lava(options: Mapping[str, Any]) -> tuple[Lava, Material | None]:
    """The lava of a case: of its material, or the usual one, with what the case replaces."""
    overrides = options.get('lava', {})
    if not isinstance(overrides, Mapping):
        raise LavaError('case.lava', overrides, 'a mapping of constants')
    if 'material' in overrides:
        raise LavaError('case.lava.material', overrides['material'], 'absent: case.material is it')
    name = options.get('material', DEFAULT)
    return lava_from_dict('case.lava', {**overrides, 'material': name})


def _span(options: Mapping[str, Any], rates: tuple[Interval, ...]) -> tuple[float, float]:
    """When the simulation begins and ends [s]."""
    first, last = rates[0].start, rates[-1].end
    start = validation.number('case.start', options.get('start', first), at_most=last, unit='s')
    end = validation.number('case.end', options.get('end', last), above=start, unit='s')
    return start, end


def _vents(
    options: Mapping[str, Any],
    rows: Any,
    rates: tuple[Interval, ...],
    ground: Terrain,
    lava: Lava,
    material: Material | None,
    start: float,
) -> tuple[Vent, ...]:
    usual = lava.reference_temperature
    if material is not None:
        usual = float(material.vent_temperature.value)
    vents = []
    for row, series in zip(rows, series_of(rows, rates), strict=True):
        before = [flux for time, flux in series if time <= start]
        later = [(time - start, flux) for time, flux in series if time > start]
        vents.append(
            Vent(
                position=ground.to_map(*row.place),
                discharge=[(0.0, before[-1] if before else 0.0), *later],
                temperature=options.get('vent_temperature', usual),
                radius=options.get('vent_radius', VENT_RADIUS * ground.resolution),
                end=None if row.other_end is None else ground.to_map(*row.other_end),
                name=row.name,
            )
        )
    return tuple(vents)


def _events(
    folder: Path, options: Mapping[str, Any], ground: Terrain, width: float, read: Any
) -> tuple[Event, ...]:
    """Read the changes of the ground; each builds on the one before."""
    from lava_ros.scene.reshaping import Barrier, with_barrier

    items = options.get('events', [])
    if not isinstance(items, list):
        raise LavaError('case.events', items, 'a list of changes of the ground')
    events: list[Event] = []
    for index, item in enumerate(items):
        where = f'case.events[{index}]'
        allowed = ['time', 'terrain', 'barrier']
        data = validation.keys(where, item, allowed=allowed, required=['time'])
        time = validation.number(f'{where}.time', data['time'], unit='s')
        if events and time <= events[-1].time:
            right = f'a time after the event before, {events[-1].time:g} s'
            raise LavaError(f'{where}.time', time, right)
        if ('terrain' in data) == ('barrier' in data):
            raise LavaError(where, sorted(data), 'either terrain, a file, or barrier')
        if 'terrain' in data:
            changed = load_terrain(folder / str(data['terrain']), **read)
            if changed.shape != ground.shape or changed.offset != ground.offset:
                right = f'the grid of the elevation, {ground.shape[0]} x {ground.shape[1]} cells'
                shape = f'{changed.shape[0]} x {changed.shape[1]} cells'
                raise LavaError(f'{where}.terrain', f'another grid of {shape}', right)
            text = f'new ground from {data["terrain"]}'
        else:
            barrier = Barrier.from_dict(f'{where}.barrier', data['barrier'])
            changed = with_barrier(ground, barrier)
            text = f'a barrier {barrier.height:g} m high'
        ground = changed
        events.append(Event(time, low_pass(ground, width), text))
    return tuple(events)
