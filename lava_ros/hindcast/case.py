# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Cases: mapped eruptions, each a folder of files, which docs/VALIDATION.md describes.

Coordinates are those of the elevation. Times are in seconds since time 0 of ``effusion_rate.csv``.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from datetime import timedelta
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from lava_ros import validation
from lava_ros.errors import LavaError, RefusalError, refusing
from lava_ros.files import similar_file
from lava_ros.files.yaml import read_yaml
from lava_ros.hindcast.outlines import Outline, read_outlines
from lava_ros.hindcast.tables import (
    check_discharge,
    check_elevation,
    check_places,
    Series,
    series_of,
)
from lava_ros.scene import check_plausible, ENVIRONMENT, Scene, Terrain, uncertainty_of, Vent
from lava_ros.scene.effusion_rates import (
    error_of_rates,
    Options,
    read_effusion_rates,
)
from lava_ros.scene.events import read_events
from lava_ros.scene.features import ENDINGS, TABLES
from lava_ros.scene.materials import lava_from_dict, Material, with_material_in_lava
from lava_ros.scene.on_terrain import read_cover_on, read_polygons_on, read_raster_on
from lava_ros.scene.onset import Onset
from lava_ros.scene.reshaping import low_pass
from lava_ros.scene.terrain_files import load_terrain
from lava_ros.scene.vent_files import read_vents, VentRow


def _vector_files(stem: str) -> tuple[str, ...]:
    return tuple(f'{stem}{ending}' for ending in ENDINGS if ending not in TABLES)


#: Possible names of the footprint; the first that exists is used, but none with ``outlines``.
FOOTPRINTS = ('footprint.asc', 'footprint.tif', *_vector_files('footprint'))

#: Possible names of each file; the first that exists is used.
FILES = (
    ('elevation.asc', 'elevation.tif'),
    FOOTPRINTS,
    ('vent.csv', *_vector_files('vent')),
    ('effusion_rate.csv',),
)

#: Default radius of a vent, in cells.
VENT_RADIUS = 1.5

#: Keys of ``case.yaml``.
KEYS = (
    *('title', 'source', 'lava', 'vent_temperature', 'vent_radius', *ENVIRONMENT),
    *('start', 'end', 'epsg', 'nodata', 'fill_holes', 'sea_level', 'low_pass', 'events'),
    'uncertainty', 'effusion_rate', 'outlines', 'insist',
)


@dataclass(frozen=True)
class Event:
    """A change of the terrain at a time [s], with a short description."""

    time: float
    terrain: Terrain
    text: str


@dataclass(frozen=True, eq=False)
class Case:
    """An eruption and its mapped flow field; ``name`` is the name of the folder.

    Attributes:
        source: Source of the data; may be empty.
        scene: Terrain, vents and lava. The map frame's origin is the grid's lower-left corner.
        material: Material of the lava, with the composition that the case gives.
        footprint: Mapped flow field at the end, bool, shape [rows, columns], row 0 in the south.
        start: Start of the simulation [s].
        end: End of the simulation [s].
        volume: Volume erupted during the simulation [m3].
        low_pass: Width of the filter applied to the terrain [m]; 0: none.
        outlines: Mapped flow fields at several times, the last one ``footprint``; empty if the
            case has one footprint only.
        stated: Names of the constants of the lava that the files of the case state, with
            ``vent_temperature`` if they state it.
    """

    name: str
    title: str
    source: str
    scene: Scene
    material: Material
    footprint: np.ndarray
    start: float
    end: float
    volume: float
    events: tuple[Event, ...] = ()
    low_pass: float = 0.0
    outlines: tuple[Outline, ...] = ()
    stated: frozenset[str] = frozenset()

    @property
    def onset(self) -> Onset | None:
        """Date of the start of the simulation; None if the case does not state it."""
        return Onset.of(self.scene)

    @property
    def duration(self) -> float:
        """Simulated duration [s]."""
        return self.end - self.start

    @property
    def area(self) -> float:
        """Area of the mapped flow field [m2]."""
        return float(self.footprint.sum()) * self.scene.terrain.resolution**2

    @property
    def vent_cells(self) -> list[tuple[int, int]]:
        """Rows and columns of the ends of the vents."""
        ends = [end for vent in self.scene.vents for end in (vent.position, vent.end) if end]
        cells = [self.scene.terrain.cell_at(*end) for end in ends]
        return [cell for cell in cells if cell is not None]

    def with_lava(
        self, lava: Mapping[str, Any], *, temperature: float | None = None, discharge: float = 1.0
    ) -> 'Case':
        """Return the case with other constants of the lava, by name.

        ``temperature`` is the eruption temperature [K], None for the current one; ``discharge`` is
        a factor on all discharges.

        Raises:
            LavaError: If a value is not valid.
        """
        vents = tuple(
            replace(
                vent,
                temperature=vent.temperature if temperature is None else temperature,
                discharge=tuple((time, flux * discharge) for time, flux in vent.series),
            )
            for vent in self.scene.vents
        )
        scene = replace(self.scene, lava=replace(self.scene.lava, **lava), vents=vents)
        return replace(self, scene=scene, volume=self.volume * discharge)


def load_case(
    directory: str | Path,
    *,
    material: str | None = None,
    low_pass_width: float | None = None,
    vents: Callable[[tuple[VentRow, ...], Terrain], tuple[VentRow, ...]] | None = None,
) -> Case:
    """Read a case from its folder.

    Args:
        directory: The folder.
        material: Name of a material that replaces the case's lava, including its constants.
        low_pass_width: Width of the filter of the terrain [m] that replaces the case's.
        vents: Returns the vents to use, given the case's vents and its terrain.

    Raises:
        LavaError: If a file is missing or not valid, or the files are not consistent.
    """
    folder = Path(directory)
    if not folder.is_dir():
        raise LavaError('case', str(folder), f'a folder that exists{similar_file(folder)}')
    options = _options(folder)
    found = [next(filter(Path.is_file, map(folder.joinpath, names)), None) for names in FILES]
    missing = [
        ' or '.join(names[:3])
        for names, path in zip(FILES, found, strict=True)
        if not path and not (names is FOOTPRINTS and 'outlines' in options)
    ]
    if missing:
        raise LavaError('case', str(folder), f'a folder that also contains {", ".join(missing)}')
    elevation, outline, vent_table, rate_table = found
    assert elevation and vent_table and rate_table
    if low_pass_width is not None:
        options['low_pass'] = low_pass_width
    if material is not None:
        options['lava'] = {'material': material}
    read = partial(
        load_terrain,
        epsg=options.get('epsg'),
        nodata=options.get('nodata'),
        fill_holes=options.get('fill_holes', False),
        sea_level=options.get('sea_level'),
    )
    ground = read(elevation)
    check_elevation(ground)
    choices = validation.build(Options, 'case.effusion_rate', options.get('effusion_rate', {}))
    rates, origin = read_effusion_rates('case', rate_table, choices)
    rows = read_vents('case', vent_table, ground)
    if vents is not None:
        rows = vents(rows, ground)
    series = series_of(rows, rates)
    lava, used = lava_from_dict('case.lava', options.get('lava', {}))
    width = validation.number('case.low_pass', options.get('low_pass', 0.0), at_least=0.0)
    first, last = rates[0].start, rates[-1].end
    start = validation.number('case.start', options.get('start', first), at_most=last, unit='s')
    onset = None
    if origin is not None:
        expected = 'a time [s] at which the year is from 1 to 9999'
        with refusing('case.start', start, expected, OverflowError):
            onset = Onset(origin + timedelta(seconds=start))
    outlines: tuple[Outline, ...] = ()
    footprints = partial(_footprint, ground=ground)
    if 'outlines' in options:
        outlines = read_outlines(
            options['outlines'], folder, footprints, start=start, onset=onset
        )
        last = start + outlines[-1].time
    end = validation.number('case.end', options.get('end', last), above=start, unit='s')
    if outlines and outlines[-1].time > end - start:
        expected = f'a time before the end, {end:g} s'
        raise LavaError(f'case.outlines[{len(outlines) - 1}].time', outlines[-1].text, expected)
    if outlines:
        footprint = outlines[-1].footprint
    else:
        assert outline is not None
        footprint = footprints(outline)
    check_places(rows, ground, footprint)
    hot = lava.reference_temperature
    scene = Scene(
        low_pass(ground, width),
        tuple(
            Vent(
                position=ground.to_map(*row.place),
                discharge=_from(start, fluxes),
                temperature=row.temperature or options.get('vent_temperature', hot),
                radius=row.radius or options.get('vent_radius', VENT_RADIUS * ground.resolution),
                end=None if row.other_end is None else ground.to_map(*row.other_end),
                name=row.name,
            )
            for row, fluxes in zip(rows, series, strict=True)
        ),
        lava,
        uncertainty=uncertainty_of(
            options.get('uncertainty', {}), used, error_of_rates(rates, choices.measured)
        ),
        onset=None if onset is None else onset.start,
        **{key: options[key] for key in ENVIRONMENT if key in options},
    )
    insist = validation.flag('case.insist', options.get('insist', False))
    check_plausible(scene, insist=insist)
    volume = sum(vent.volume_between(0.0, end - start) for vent in scene.vents)
    check_discharge(volume, float(footprint.sum()) * ground.resolution**2)
    name = folder.resolve().name
    return Case(
        name=name,
        title=str(options.get('title', name)),
        source=str(options.get('source', '')),
        scene=scene,
        material=used,
        footprint=footprint,
        start=start,
        end=end,
        volume=volume,
        events=_events(folder, options.get('events', []), ground, width, read),
        low_pass=width,
        outlines=outlines,
        stated=_stated(options, rows),
    )


def _options(folder: Path) -> dict[str, Any]:
    path = folder / 'case.yaml'
    data = read_yaml('case', path) if path.exists() else None
    known = [*KEYS, 'material']
    given = validation.keys('case', {} if data is None else data, allowed=known)
    return with_material_in_lava('case', given)


def _stated(options: Mapping[str, Any], vents: Iterable[VentRow]) -> frozenset[str]:
    """Return the names of the constants that the files of a case state."""
    names = {*options.get('lava', {})} - {'material'}
    if names & {'composition', 'vft_a', 'vft_b', 'vft_c'}:
        # the viscosity at the vent shifts the law that they give
        names |= {'viscosity'}
    if 'vent_temperature' in options or any(row.temperature is not None for row in vents):
        names |= {'vent_temperature'}
    return frozenset(names - {'composition'})


def _footprint(path: Path, *, ground: Terrain) -> np.ndarray:
    """Read the mapped flow field: areas, or a grid of 0 and 1 in any system, cells and extent."""
    if path.suffix.lower() in ENDINGS:
        covered = read_polygons_on(ground, path, field='the footprint')
        values = covered.astype(float)
    else:
        values = np.nan_to_num(read_raster_on(ground, path, field='the footprint'))
        covered = read_cover_on(ground, path, field='the footprint')
    other = values[(values != 0.0) & (values != 1.0)]
    if other.size:
        expected = '0 (not covered) and 1 (covered) only, and no data'
        raise LavaError('a cell of the footprint', float(other[0]), expected)
    if not covered.any():
        problem = f'The footprint {path.name} covers no cell of the elevation'
        raise RefusalError('the footprint', problem, 'Check its values and its coordinates')
    return covered


def _from(start: float, series: Series) -> list[tuple[float, float]]:
    """Return a discharge from a time ``start`` [s], which becomes time 0."""
    before = [flux for time, flux in series if time <= start]
    later = [(time - start, flux) for time, flux in series if time > start]
    return [(0.0, before[-1] if before else 0.0), *later]


def _events(
    folder: Path, items: Any, ground: Terrain, width: float, read: Callable[[Path], Terrain]
) -> tuple[Event, ...]:
    """Read the changes of the terrain; each applies to the terrain after the previous one."""
    events = []
    for item in read_events('case.events', items, folder, ground, read):
        ground = item.ground(ground)
        events.append(Event(item.time, low_pass(ground, width), item.text))
    return tuple(events)
