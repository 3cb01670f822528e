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

"""What the user describes: terrain, vents, lava and the scene they make.

Everything here is plain data in SI units (metres, seconds, kelvin) and validates itself: a scene
that exists can be simulated. Only numpy is needed.
"""

from bisect import bisect
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from functools import cached_property
import math
from pathlib import Path
from typing import Any

import numpy as np

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.lava import Lava as Lava
from lava_ros.uncertainty import Uncertainty, uncertainty_from_dict, uncertainty_to_dict

#: Most cells along one side: nav_msgs/MapMetaData consumers index cells with 16-bit integers.
MAX_SIDE_CELLS = 32767

#: Sides a terrain's cells can have [m]: from a table in a laboratory to a planet.
RESOLUTION_RANGE = (1e-4, 1e5)

#: Largest height above or below zero that ground can have [m]: Mars has 22 km.
MAX_ELEVATION = 1e5

#: Largest distance of places from the origin of the map and of a projected system [m].
MAX_COORDINATE = 1e9

#: Largest flux of a vent [m3/s]: a hundred times that of the largest flood basalts.
MAX_DISCHARGE = 1e8

#: Largest radius of a vent [m].
MAX_RADIUS = 1e5

#: Largest velocity with which lava comes out of a vent [m/s].
MAX_VENT_VELOCITY = 1e3

#: Largest viscosity of lava that comes out of a vent [Pa s], crystals included.
MAX_VENT_VISCOSITY = 1e15

#: Accelerations of gravity there can be [m/s2]: from a small moon to a star.
GRAVITY_RANGE = (1e-3, 1e3)

#: Temperatures lava can have at a vent [K]: from the coldest carbonatite to the hottest komatiite.
VENT_TEMPERATURE_RANGE = (700.0, 2000.0)


@dataclass(frozen=True, eq=False)
class Terrain:
    """Ground elevation on a regular grid of square cells in the map frame (ENU).

    Attributes:
        elevation: Elevation of the cell centres [m], float32, shape [rows, columns]; row 0 has the
            smallest y. NaN marks cells without data: lava that reaches them leaves the domain.
        resolution: Side of a cell [m].
        origin: Map position (x, y) [m] of the lower-left corner of cell [0, 0].
        epsg: EPSG code of the projected coordinate system the map frame is an offset of.
        offset: Easting and northing [m] of the map frame's origin in that system.
    """

    elevation: np.ndarray
    resolution: float
    origin: tuple[float, float] = (0.0, 0.0)
    epsg: int | None = None
    offset: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        """Validate and normalise every field.

        Raises:
            LavaError: A field is not usable.
        """
        put = object.__setattr__
        try:
            if np.asarray(self.elevation).dtype.kind not in 'fiubO':
                raise TypeError
            with np.errstate(over='ignore', invalid='ignore'):
                elevation = np.array(self.elevation, dtype=np.float32, order='C')
        except (TypeError, ValueError, OverflowError):
            raise LavaError(
                'terrain.elevation', type(self.elevation).__name__, 'a 2-D array of numbers [m]'
            ) from None
        if elevation.ndim != 2 or min(elevation.shape) < 2:
            raise LavaError(
                'terrain.elevation',
                f'array of shape {elevation.shape}',
                'a 2-D array of at least 2 x 2 cells',
            )
        if max(elevation.shape) > MAX_SIDE_CELLS:
            raise LavaError(
                'terrain.elevation',
                f'array of shape {elevation.shape}',
                f'at most {MAX_SIDE_CELLS} cells a side',
            )
        if np.isinf(elevation).any():
            raise LavaError('terrain.elevation', math.inf, 'finite metres, NaN where unknown')
        # NaN compares as False.
        beyond = np.abs(elevation) > MAX_ELEVATION
        if beyond.any():
            raise LavaError(
                'terrain.elevation',
                float(elevation[beyond][0]),
                f'at most {MAX_ELEVATION:g} m above or below zero, NaN where unknown',
            )
        if np.isnan(elevation).all():
            raise LavaError('terrain.elevation', math.nan, 'at least one cell with data')
        elevation.setflags(write=False)
        put(self, 'elevation', elevation)
        put(
            self,
            'resolution',
            validation.number(
                'terrain.resolution',
                self.resolution,
                at_least=RESOLUTION_RANGE[0],
                at_most=RESOLUTION_RANGE[1],
                unit='m',
            ),
        )
        for name in ('origin', 'offset'):
            place = validation.pair(f'terrain.{name}', getattr(self, name), most=MAX_COORDINATE)
            put(self, name, place)
        if self.epsg is not None and (
            isinstance(self.epsg, bool)
            or not isinstance(self.epsg, int)
            or not 1024 <= self.epsg < 2**31
        ):
            raise LavaError('terrain.epsg', self.epsg, 'an EPSG code such as 32633, or None')

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the grid."""
        return self.elevation.shape

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Smallest x, smallest y, largest x, largest y of the cells' edges [m]."""
        rows, columns = self.shape
        x, y = self.origin
        return (x, y, x + columns * self.resolution, y + rows * self.resolution)

    @cached_property
    def has_data(self) -> np.ndarray:
        """True where the elevation is known, bool, shape [rows, columns]."""
        mask = np.isfinite(self.elevation)
        mask.setflags(write=False)
        return mask

    def cell_at(self, x: float, y: float) -> tuple[int, int] | None:
        """Row and column of the cell that holds a map position, None outside the grid."""
        column = math.floor((x - self.origin[0]) / self.resolution)
        row = math.floor((y - self.origin[1]) / self.resolution)
        rows, columns = self.shape
        return (row, column) if 0 <= row < rows and 0 <= column < columns else None

    def covers(self, x: float, y: float) -> bool:
        """Whether a map position lies on a cell with data."""
        cell = self.cell_at(x, y)
        return cell is not None and bool(self.has_data[cell])

    def covered(self, places: np.ndarray) -> np.ndarray:
        """Which of the map positions, shape [count, 2], lie on a cell with data: bool, [count]."""
        cells = np.floor((places - np.asarray(self.origin)) / self.resolution)
        rows, columns = self.shape
        on_grid = ((cells >= 0) & (cells < (columns, rows))).all(axis=1)
        column, row = np.where(on_grid[:, None], cells, 0).astype(np.int64).T
        return on_grid & self.has_data[row, column]

    def to_map(self, easting: float, northing: float) -> tuple[float, float]:
        """Turn projected coordinates [m] into map coordinates [m]."""
        return (easting - self.offset[0], northing - self.offset[1])


Discharge = float | Sequence[tuple[float, float]]


@dataclass(frozen=True)
class Vent:
    """A place where lava comes out: a disc, or a fissure when ``end`` is given.

    Attributes:
        position: Centre of the disc, or one end of the fissure, (x, y) [m] in the map frame.
        discharge: Volume flux [m3/s]: a constant, or a series of (time [s], flux [m3/s]) pairs of
            increasing time. Each flux holds from its time until the next; before the first, 0.
        temperature: Temperature of the erupting lava [K].
        radius: Radius of the disc, or half the width of the fissure [m].
        end: The other end of the fissure, (x, y) [m], None for a disc.
        name: Free text that identifies the vent in logs and messages.
        velocity: Horizontal velocity (vx, vy) with which lava comes out [m/s]; without inertia
            (``Effects.inertia``) lava takes the velocity its weight drives at once.
    """

    position: tuple[float, float]
    discharge: Discharge
    temperature: float = 1423.0
    radius: float = 10.0
    end: tuple[float, float] | None = None
    name: str = ''
    velocity: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        """Validate and normalise every field.

        Raises:
            LavaError: A field is not usable.
        """
        put = object.__setattr__
        if not isinstance(self.name, str):
            raise LavaError('vent.name', self.name, 'text')
        label = f'vent {self.name!r}.' if self.name else 'vent.'
        for name in ('position', 'end'):
            if name == 'position' or self.end is not None:
                place = validation.pair(label + name, getattr(self, name), most=MAX_COORDINATE)
                put(self, name, place)
        velocity = validation.pair(
            label + 'velocity', self.velocity, unit='m/s', most=MAX_VENT_VELOCITY
        )
        put(self, 'velocity', velocity)
        radius = validation.number(
            label + 'radius', self.radius, above=0.0, at_most=MAX_RADIUS, unit='m'
        )
        put(self, 'radius', radius)
        put(
            self,
            'temperature',
            validation.number(
                label + 'temperature',
                self.temperature,
                at_least=VENT_TEMPERATURE_RANGE[0],
                at_most=VENT_TEMPERATURE_RANGE[1],
                unit='K',
            ),
        )
        put(self, 'discharge', _discharge(label + 'discharge', self.discharge))

    @property
    def series(self) -> tuple[tuple[float, float], ...]:
        """The discharge as (time [s], flux [m3/s]) pairs; a constant starts at minus infinity."""
        if isinstance(self.discharge, float):
            return ((-math.inf, self.discharge),)
        return tuple(self.discharge)

    @property
    def peak(self) -> float:
        """The largest discharge of the series [m3/s]."""
        return max(flux for _, flux in self.series)

    def discharge_at(self, time: float) -> float:
        """Volume flux at a time [s] of the simulation [m3/s]."""
        series = self.series
        index = bisect(series, (time, math.inf)) - 1
        return series[index][1] if index >= 0 else 0.0

    def volume_between(self, start: float, end: float) -> float:
        """Volume [m3] the vent emits from ``start`` to ``end`` [s]: the exact integral."""
        return self.volumes_at([end], since=start)[0]

    def volumes_at(self, times: Sequence[float], *, since: float) -> list[float]:
        """Volumes [m3] the vent emits from ``since`` to each of some times [s], which increase."""
        series = self.series
        volumes, before, index = [], 0.0, 0
        for end in times:
            while index + 1 < len(series) and series[index + 1][0] <= end:
                (time, flux), until = series[index], series[index + 1][0]
                before += flux * max(0.0, until - max(since, time))
                index += 1
            time, flux = series[index]
            volumes.append(before + flux * max(0.0, end - max(since, time)))
        return volumes


def _discharge(label: str, value: object) -> float | tuple[tuple[float, float], ...]:
    if not isinstance(value, (list, tuple, np.ndarray)):
        return validation.number(
            label, value, at_least=0.0, at_most=MAX_DISCHARGE, unit='m3/s'
        )
    pairs: list[tuple[float, float]] = []
    for index, item in enumerate(value):
        time, flux = validation.pair(f'{label}[{index}]', item, unit='(s, m3/s)')
        validation.number(
            f'{label}[{index}][1]', flux, at_least=0.0, at_most=MAX_DISCHARGE, unit='m3/s'
        )
        if pairs and time <= pairs[-1][0]:
            raise LavaError(f'{label}[{index}][0]', time, f'a time after {pairs[-1][0]:g} s')
        pairs.append((time, flux))
    if not pairs:
        raise LavaError(label, value, 'a flux [m3/s] or at least one (s, m3/s) pair')
    return tuple(pairs)


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything a simulation needs to know about the world.

    Attributes:
        terrain: The ground.
        vents: Where lava comes out; may be empty.
        lava: The material.
        ambient_temperature: Temperature of the air [K].
        gravity: Acceleration of gravity [m/s2].
        uncertainty: What differs from member to member of an ensemble.
    """

    terrain: Terrain
    vents: tuple[Vent, ...] = ()
    lava: Lava = field(default_factory=Lava)
    ambient_temperature: float = 300.0
    gravity: float = 9.81
    uncertainty: Uncertainty = field(default_factory=Uncertainty)

    def __post_init__(self) -> None:
        """Validate the parts together.

        Raises:
            LavaError: A part is of the wrong kind, a vent is not on the terrain, or its lava is
                solid.
        """
        put = object.__setattr__
        kinds = (('terrain', Terrain), ('lava', Lava), ('uncertainty', Uncertainty))
        for name, kind in kinds:
            if not isinstance(getattr(self, name), kind):
                raise LavaError(f'scene.{name}', getattr(self, name), f'a {kind.__name__}')
        put(self, 'vents', check_vents(self.vents, self.terrain))
        if self.uncertainty.yield_strength is not None and not self.lava.yield_strength:
            right = 'absent: lava.yield_strength is 0'
            raise LavaError('uncertainty.yield_strength', self.uncertainty.yield_strength, right)
        for index, vent in enumerate(self.vents):
            if vent.temperature <= self.lava.solidus:
                right = f'above lava.solidus, {self.lava.solidus:g} K: colder lava is solid'
                raise LavaError(f'vents[{index}].temperature', vent.temperature, right)
            viscosity = self.lava.viscosity_at(vent.temperature)
            if viscosity > MAX_VENT_VISCOSITY:
                right = f'hotter lava: at this temperature its viscosity is {viscosity:.3g} Pa s, '
                right += f'above {MAX_VENT_VISCOSITY:g} Pa s nothing comes out'
                raise LavaError(f'vents[{index}].temperature', vent.temperature, right)
        put(
            self,
            'ambient_temperature',
            validation.number(
                'scene.ambient_temperature',
                self.ambient_temperature,
                at_least=100.0,
                at_most=600.0,
                unit='K',
            ),
        )
        put(
            self,
            'gravity',
            validation.number(
                'scene.gravity',
                self.gravity,
                at_least=GRAVITY_RANGE[0],
                at_most=GRAVITY_RANGE[1],
                unit='m/s2',
            ),
        )


def check_vents(vents: Iterable[Vent], terrain: Terrain) -> tuple[Vent, ...]:
    """Return the vents as a tuple when each lies on the terrain.

    Raises:
        LavaError: A vent's position or end is outside the terrain or on a cell without data.
    """
    if not isinstance(vents, Iterable):
        raise LavaError('vents', vents, 'vents, or an empty list')
    result = tuple(vents)
    x0, y0, x1, y1 = terrain.extent
    for index, vent in enumerate(result):
        if not isinstance(vent, Vent):
            raise LavaError(f'vents[{index}]', vent, 'a Vent')
        for name in ('position', 'end'):
            point = getattr(vent, name)
            if point is not None and not terrain.covers(*point):
                raise LavaError(
                    f'vents[{index}].{name}',
                    point,
                    f'a place on the terrain, which covers x {x0:g} to {x1:g} m and '
                    f'y {y0:g} to {y1:g} m (cells without data excluded)',
                )
    return result


def vents_from_list(
    items: object, terrain: Terrain, *, temperature: object = None
) -> tuple[Vent, ...]:
    """Build vents from the plain data of a YAML file.

    Each item is a mapping with the fields of ``Vent``; ``projected: [easting, northing]`` may
    stand in place of ``position`` (and ``projected_end`` of ``end``).

    Args:
        items: The data.
        terrain: The ground.
        temperature: Temperature of vents that have none of their own [K], None for the usual one.

    Raises:
        LavaError: The data is not such a list.
    """
    if not isinstance(items, list):
        raise LavaError('vents', items, 'a list of vents')
    names = [item.name for item in fields(Vent)]
    vents = []
    for index, item in enumerate(items):
        where = f'vents[{index}]'
        allowed = [*names, 'projected', 'projected_end']
        data = validation.keys(where, item, allowed=allowed, required=['discharge'])
        for source, target in (('projected', 'position'), ('projected_end', 'end')):
            if source in data:
                if target in data:
                    raise LavaError(f'{where}.{source}', data[source], f'absent beside {target}')
                place = validation.pair(f'{where}.{source}', data.pop(source))
                data[target] = terrain.to_map(*place)
        if 'position' not in data:
            raise LavaError(f'{where}.position', None, 'a value: this key is required')
        data.setdefault('name', f'vent {index}')
        if temperature is not None:
            data.setdefault('temperature', temperature)
        vents.append(Vent(**data))  # type: ignore[arg-type]
    return check_vents(vents, terrain)


def scene_from_yaml(path: str | Path, *, terrain: Terrain | None = None) -> Scene:
    """Read a scene file.

    The file has the keys ``terrain`` (a mapping: ``file``, relative to the scene file, and the
    options of ``terrain_files.load_terrain``), ``vents``, ``lava`` (fields of ``Lava``, and maybe
    ``material``, a name of ``lava materials`` whose constants they replace),
    ``ambient_temperature``, ``gravity`` and ``uncertainty``; all but the terrain may be left out.

    Args:
        path: The YAML file.
        terrain: Ground to use in place of the file's own.

    Raises:
        LavaError: The file cannot be read, or one of its fields is not usable.
    """
    from lava_ros.materials import lava_from_dict
    from lava_ros.terrain_files import load_terrain
    from lava_ros.yaml_files import read_yaml

    path = Path(path)
    names = ['terrain', 'vents', 'lava', 'ambient_temperature', 'gravity', 'uncertainty']
    data = validation.keys('scene', read_yaml('scene', path), allowed=names)
    if terrain is None:
        options = validation.keys(
            'scene.terrain',
            data.get('terrain'),
            allowed=['file', 'epsg', 'resolution', 'offset', 'window'],
            required=['file'],
        )
        name = options.pop('file')
        if not isinstance(name, str):
            raise LavaError('scene.terrain.file', name, 'the name of a file, text')
        terrain = load_terrain(path.parent / name, **options)  # type: ignore[arg-type]
    lava, material = lava_from_dict('scene.lava', data.get('lava', {}))
    usual = None if material is None else material.vent_temperature.value
    rest: Mapping[str, Any] = {
        name: data[name] for name in ('ambient_temperature', 'gravity') if name in data
    }
    return Scene(
        terrain=terrain,
        vents=vents_from_list(data.get('vents', []), terrain, temperature=usual),
        lava=lava,
        uncertainty=uncertainty_from_dict(data.get('uncertainty', {})),
        **rest,
    )


def scene_to_dict(scene: Scene) -> dict[str, Any]:
    """Plain data that describes a scene, the elevation itself left out: for logs and bags."""
    terrain = scene.terrain
    return {
        'terrain': {
            'shape': list(terrain.shape),
            'resolution': terrain.resolution,
            'origin': list(terrain.origin),
            'epsg': terrain.epsg,
            'offset': list(terrain.offset),
        },
        'vents': [
            {name: value for name, value in asdict(vent).items() if value not in (None, '')}
            for vent in scene.vents
        ],
        'lava': asdict(scene.lava),
        'ambient_temperature': scene.ambient_temperature,
        'gravity': scene.gravity,
        'uncertainty': uncertainty_to_dict(scene.uncertainty),
    }
