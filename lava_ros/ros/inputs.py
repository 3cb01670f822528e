# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Conversion of input messages to Terrain, Vent and Mask, with a LavaError for invalid ones."""

from collections.abc import Sequence
import math
from typing import Any

from geometry_msgs.msg import PointStamped, Pose
from nav_msgs.msg import MapMetaData, OccupancyGrid
import numpy as np
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import Header

from lava_ros import validation
from lava_ros.bag.decoding import cloud_columns, image_array
from lava_ros.errors import LavaError, Typed
from lava_ros.forecast.assimilation import Mask
from lava_ros.layers.layer import ZERO_CELSIUS
from lava_ros.layers.messages import vent_name
from lava_ros.ros import codec
from lava_ros.ros.parameters import Settings
from lava_ros.scene import (
    MAX_COORDINATE,
    MAX_ELEVATION,
    MAX_SIDE_CELLS,
    RESOLUTION_RANGE,
    Terrain,
    Vent,
    VENT_TEMPERATURE_RANGE,
)
from lava_ros.scene.missing_data import check_missing

#: Required and optional fields of a point cloud of vents; only viewers use ``z``.
VENT_FIELDS = ('x', 'y', 'z', 'discharge', 'temperature', 'radius')
OPTIONAL_FIELDS = ('id', 'x_end', 'y_end', 'velocity_x', 'velocity_y')

#: Wait for the partner of a new terrain image or description [s].
SETTLE = 0.5

#: Times after which two halves of different sizes, and a single half, are reported [s].
PATIENCE, ABSENCE = 2.0, 10.0

#: A cell of a mask is lava at or above this value; negative cells are unknown.
LAVA_THRESHOLD = 50

#: Advice to a publisher of terrain with a value that looks like missing data.
NAN_ADVICE = 'NaN in place of {0} if these cells have no data'

#: Maximum value of a cell of an occupancy grid.
MAX_CELL_VALUE = 100


def check_image(image: Image, settings: Settings) -> None:
    """Check a terrain image as far as possible without its terrain_info."""
    _check_message('terrain', image.header, settings, image.data)
    _check_cells('terrain.size', image.width, image.height, settings)
    _check_elevation('terrain', image_array(image, 'terrain'), settings)


def check_info(info: MapMetaData, settings: Settings, *, name: str = 'terrain_info') -> float:
    """Check the description of a grid and return the side of a cell [m].

    The side is the shortest decimal number of the float32 value: 0.1, not 0.10000000149.
    """
    _check_cells(f'{name}.size', info.width, info.height, settings)
    _check_pose(f'{name}.origin', info.origin)
    minimum, maximum = RESOLUTION_RANGE
    resolution = float(str(np.float32(info.resolution)))
    return validation.number(
        f'{name}.resolution', resolution, at_least=minimum, at_most=maximum, unit='m'
    )


def terrain_from_image(image: Image, info: MapMetaData, settings: Settings) -> Terrain:
    """Make a terrain from an image of elevations and the description of its cells."""
    check_image(image, settings)
    resolution = check_info(info, settings)
    if (image.width, image.height) != (info.width, info.height):
        raise _size_mismatch(image, info)
    pixels = image_array(image, 'terrain').astype(np.float64)
    check_missing(
        'terrain.data', pixels, resolution, unit=settings.terrain_scale, advice=NAN_ADVICE,
        sea=settings.sea_level,
    )
    elevation = pixels * settings.terrain_scale + settings.terrain_offset
    origin = info.origin.position
    return _terrain(elevation, resolution, (origin.x, origin.y), settings)


def terrain_from_cloud(cloud: PointCloud2, settings: Settings) -> Terrain:
    """Make a terrain from points on the ground: each cell gets the mean of its points.

    The cells start half a cell before the outermost points, so that points on a regular grid of
    the same resolution are cell centres. Points with a NaN coordinate count as absent.
    """
    name = 'terrain_cloud'
    _check_message(name, cloud.header, settings, cloud.data)
    columns = cloud_columns(cloud, name, ('x', 'y', 'z'))
    for axis, maximum in (('x', MAX_COORDINATE), ('y', MAX_COORDINATE), ('z', MAX_ELEVATION)):
        # comparisons with NaN are False
        beyond = columns[axis][np.abs(columns[axis]) > maximum]
        if len(beyond):
            expected = f'at most {maximum:g} m above or below zero, NaN for points without data'
            raise LavaError(f'{name}.{axis}', float(beyond[0]), expected)
    points = np.stack([columns['x'], columns['y'], columns['z']], axis=-1)
    points = points[~np.isnan(points).any(axis=1)]
    if len(points) == 0:
        raise LavaError(f'{name}.size', f'{cloud.width} x {cloud.height}', 'at least one point')
    resolution = settings.terrain_cloud_resolution
    low = points[:, :2].min(axis=0) - 0.5 * resolution
    places = np.floor((points[:, :2] - low) / resolution)
    width, height = (int(cells) for cells in places.max(axis=0) + 1)
    _check_cells(f'{name}.size', width, height, settings)
    column, row = places.astype(np.int64).T
    cell = row * width + column
    count = np.bincount(cell, minlength=width * height)
    total = np.bincount(cell, weights=points[:, 2], minlength=width * height)
    mean = np.full(width * height, np.nan)
    np.divide(total, count, out=mean, where=count > 0)
    elevation = mean.reshape(height, width)
    _check_elevation(name, elevation, settings)
    check_missing(
        f'{name}.z', elevation, resolution, advice=NAN_ADVICE, sea=settings.sea_level
    )
    origin = (float(low[0]), float(low[1]))
    return _terrain(elevation, resolution, origin, settings)


def terrain_from_grid(message: Any, settings: Settings) -> Terrain:
    """Make a terrain from the layer ``elevation`` of a grid_map_msgs/GridMap."""
    name, info = 'terrain_grid', message.info
    _check_message(name, message.header, settings)
    _check_pose(f'{name}.info.pose', info.pose)
    for array in message.data:
        cells = len(array.data) - array.layout.data_offset
        if cells > settings.max_terrain_cells:
            expected = f'at most {settings.max_terrain_cells} (max_terrain_cells)'
            raise LavaError(f'{name}.data', f'{cells} cells', expected)
    elevation = codec.layer_values(message, codec.ELEVATION, name)
    _check_cells(f'{name}.size', elevation.shape[1], elevation.shape[0], settings)
    _check_elevation(name, elevation, settings)
    check_missing(
        f'{name}.data', elevation, info.resolution, advice=NAN_ADVICE, sea=settings.sea_level
    )
    centre = info.pose.position
    origin = (centre.x - 0.5 * info.length_x, centre.y - 0.5 * info.length_y)
    return _terrain(elevation, info.resolution, origin, settings)


def _terrain(
    elevation: np.ndarray, resolution: float, origin: tuple[float, float], settings: Settings
) -> Terrain:
    return Terrain(
        elevation, resolution, origin, settings.epsg, settings.offset,
        sea_level=settings.sea_level,
    )


def vents_from_cloud(cloud: PointCloud2, settings: Settings) -> tuple[Vent, ...]:
    """Make the vents of a message, which replace all vents: no points means no vents.

    With ``x_end`` and ``y_end`` that are not NaN, a vent is a fissure. With a field ``time``, the
    points of one id at one position are one vent. The discharge of each point applies from its
    simulated time [s] until the time of the next point.
    """
    _check_message('vents', cloud.header, settings, cloud.data)
    count = cloud.width * cloud.height
    if count > settings.max_vents:
        raise LavaError('vents.size', count, f'at most {settings.max_vents} vents (max_vents)')
    is_timed = any(item.name == 'time' for item in cloud.fields)
    required = (*VENT_FIELDS, 'id', 'time') if is_timed else VENT_FIELDS
    columns = cloud_columns(cloud, 'vents', required, optional=OPTIONAL_FIELDS)
    columns.setdefault('id', np.arange(count, dtype=np.float64))
    if not np.isfinite(columns['id']).all():
        expected = 'a finite number, or no field id: it distinguishes the vents'
        raise LavaError('vents.id', float(columns['id'][~np.isfinite(columns['id'])][0]), expected)
    points: dict[object, list[dict[str, float]]] = {}
    for index in range(count):
        point = {key: float(values[index]) for key, values in columns.items()}
        place = (point['id'], point['x'], point['y'], _end_of(point)) if is_timed else index
        points.setdefault(place, []).append(point)
    return tuple(_vent_of_points(item, is_timed=is_timed) for item in points.values())


def ignored_fields(cloud: PointCloud2) -> str:
    """Return a warning about fields of a point cloud of vents that have no meaning, or nothing."""
    names = [item.name for item in cloud.fields]
    others = [name for name in names if name not in (*VENT_FIELDS, *OPTIONAL_FIELDS, 'time')]
    if not others:
        return ''
    known = ', '.join((*VENT_FIELDS, *OPTIONAL_FIELDS, 'time'))
    return f'unknown fields are ignored: {", ".join(others)} (of a vent: {known})'


def _end_of(point: dict[str, float]) -> tuple[float, float] | None:
    end = point.get('x_end', math.nan), point.get('y_end', math.nan)
    return None if all(map(math.isnan, end)) else end


def _vent_of_points(points: Sequence[dict[str, float]], *, is_timed: bool) -> Vent:
    first = points[0]
    name = vent_name(first['id'])
    for key in ('temperature', 'radius', *(first.keys() & {'velocity_x', 'velocity_y'})):
        for point in points[1:]:
            # NaN differs from every value, and is refused below
            if point[key] != first[key]:
                expected = f'{first[key]:g} as at its first time'
                raise LavaError(f"vent '{name}'.{key}", point[key], expected)
    series = [(point['time'], point['discharge']) for point in points] if is_timed else None
    place = first['x'], first['y']
    velocity = first.get('velocity_x', 0.0), first.get('velocity_y', 0.0)
    return _vent(
        name, place, series or first['discharge'], first['temperature'], first['radius'],
        end=_end_of(first), velocity=velocity,
    )


def vent_from_point(point: PointStamped, settings: Settings, *, name: str) -> Vent:
    """Make a vent at a point that was clicked in a viewer; the stamp of the viewer is ignored."""
    _check_message('clicked_point', point.header, settings)
    return _vent(
        name,
        (point.point.x, point.point.y),
        settings.default_discharge,
        settings.default_temperature,
        settings.default_radius,
    )


def mask_from_grid(grid: OccupancyGrid, settings: Settings, *, name: str = 'observed') -> Mask:
    """Convert a grid of observed lava: 50 to 100 lava, 0 to 49 none, negative not observed."""
    _check_message(name, grid.header, settings)
    info = grid.info
    resolution = check_info(info, settings, name=f'{name}.info')
    if len(grid.data) != info.width * info.height:
        expected = f'width x height = {info.width * info.height} cells'
        raise LavaError(f'{name}.data', f'{len(grid.data)} cells', expected)
    cells = np.asarray(grid.data, dtype=np.int8).reshape(info.height, info.width)
    if cells.max() > MAX_CELL_VALUE:
        raise LavaError(f'{name}.data', int(cells.max()), f'cells from -1 to {MAX_CELL_VALUE}')
    origin = (info.origin.position.x, info.origin.position.y)
    return Mask(cells >= LAVA_THRESHOLD, cells >= 0, resolution, origin)


class TerrainPairing:
    """Pairs images and descriptions of terrain that arrive on two topics.

    Either may arrive first. Two new halves of the same size are a pair immediately, unless their
    stamps differ. Halves with different stamps, and a single new half of the old size, wait
    ``SETTLE`` seconds for a partner and then pair with the newest one. New elevations therefore do
    not appear at the old position if a publisher sends both halves. Halves of different sizes are
    an error after ``PATIENCE`` seconds, a half without a partner after ``ABSENCE`` seconds: on a
    busy machine, discovery of the second publisher may take seconds longer. Each error is reported
    once. The partner of a refused half waits for another one, instead of pairing with an older
    one: it has the same stamp or, if one of them has none, arrives within ``SETTLE``. These times
    are measured from the first new half, because a source may publish one of the two at a high
    rate.
    """

    def __init__(self) -> None:
        """Initialize without halves."""
        self._halves: dict[type, Any] = {}
        self._new: set[type] = set()
        self._begun, self._is_waiting = 0.0, False
        # type, stamp [ns] and time [s] of the newest half that has been refused
        self._refused: tuple[type, int, float] | None = None

    def refuse(self, half: Image | MapMetaData, now: float) -> None:
        """Note that a half has been refused at monotonic time ``now`` [s]."""
        self._refused = type(half), _stamp_of(half), now
        self._new = {kind for kind in self._new if not self._is_alone(self._halves[kind], now)}
        self._is_waiting = bool(self._new)

    def _is_alone(self, half: Image | MapMetaData, now: float) -> bool:
        """Return True if the partner of a half has been refused."""
        if self._refused is None or self._refused[0] is type(half):
            return False
        (_, stamp, refused), own = self._refused, _stamp_of(half)
        return own == stamp if own and stamp else now - refused < SETTLE

    def add(self, half: Image | MapMetaData, now: float) -> None:
        """Add a checked image or description at monotonic time ``now`` [s]."""
        self._halves[type(half)] = half
        if self._refused is not None and self._refused[0] is type(half):
            self._refused = None
        if self._is_alone(half, now):
            return
        self._new.add(type(half))
        if not self._is_waiting:
            self._begun, self._is_waiting = now, True

    def poll(self, now: float) -> tuple[Image, MapMetaData] | None:
        """Return a newly complete pair, otherwise None.

        Raises:
            LavaError: If a partner is overdue; once for each.
        """
        if not self._is_waiting:
            return None
        image, info = self._halves.get(Image), self._halves.get(MapMetaData)
        if image is not None and info is not None:
            fits = (image.width, image.height) == (info.width, info.height)
            stamps = {_stamp_of(image), _stamp_of(info)}
            # some publishers leave one of the stamps at 0
            is_pair = len(self._new) == 2 and len(stamps - {0}) < 2
            if fits and (is_pair or now - self._begun >= SETTLE):
                self._new.clear()
                self._is_waiting = False
                return image, info
        is_alone = image is None or info is None
        if now - self._begun < (ABSENCE if is_alone else PATIENCE):
            return None
        self._is_waiting = False
        if image is None:
            raise LavaError('terrain', None, 'an Image for the MapMetaData on terrain_info')
        if info is None:
            raise LavaError('terrain_info', None, 'a MapMetaData for the Image on terrain')
        raise _size_mismatch(image, info)


def _stamp_of(half: Image | MapMetaData) -> int:
    """Return the stamp of a terrain image or description [ns]."""
    return codec.nanoseconds(
        half.header.stamp if isinstance(half, Image) else half.map_load_time
    )


def _size_mismatch(image: Image, info: MapMetaData) -> LavaError:
    return LavaError(
        'terrain_info.size',
        f'{info.width} x {info.height}',
        f'the size of the image on terrain, {image.width} x {image.height}',
    )


def _vent(
    name: str,
    place: tuple[float, float],
    discharge: float | Sequence[tuple[float, float]],
    celsius: float,
    radius: float,
    **options: Any,
) -> Vent:
    minimum, maximum = (limit - ZERO_CELSIUS for limit in VENT_TEMPERATURE_RANGE)
    validation.number(
        f"vent '{name}'.temperature", celsius, at_least=minimum, at_most=maximum, unit='Celsius'
    )
    kelvin = Typed(celsius + ZERO_CELSIUS, f'{celsius} Celsius')
    return Vent(place, discharge, kelvin, radius=radius, name=name, **options)


def _check_message(name: str, header: Header, settings: Settings, data: Any = b'') -> None:
    if header.frame_id != settings.frame_id:
        expected = f'{settings.frame_id!r}: messages are not transformed'
        raise LavaError(f'{name}.header.frame_id', header.frame_id, expected)
    size = memoryview(data).nbytes
    if size > settings.max_input_bytes:
        expected = f'at most {settings.max_input_bytes} (max_input_bytes)'
        raise LavaError(f'{name}.data', f'{size} bytes', expected)


def _check_pose(name: str, pose: Pose) -> None:
    place, turn = pose.position, pose.orientation
    maximum = MAX_COORDINATE
    for axis, value in (('x', place.x), ('y', place.y)):
        validation.number(
            f'{name}.position.{axis}', value, at_least=-maximum, at_most=maximum, unit='m'
        )
    if place.z != 0.0:
        raise LavaError(f'{name}.position.z', place.z, '0: the elevations carry the height')
    # The negation also catches NaN.
    if not (max(abs(turn.x), abs(turn.y), abs(turn.z)) < 1e-6 and abs(abs(turn.w) - 1.0) < 1e-6):
        expected = '(0, 0, 0, 1): rotated grids are not supported'
        raise LavaError(f'{name}.orientation', (turn.x, turn.y, turn.z, turn.w), expected)


def _check_cells(field: str, width: int, height: int, settings: Settings) -> None:
    if min(width, height) < 2 or max(width, height) > MAX_SIDE_CELLS:
        raise LavaError(field, f'{width} x {height}', f'2 to {MAX_SIDE_CELLS} cells per side')
    if width * height > settings.max_terrain_cells:
        expected = f'at most {settings.max_terrain_cells} cells (max_terrain_cells)'
        raise LavaError(field, f'{width} x {height}', expected)


def _check_elevation(name: str, elevation: np.ndarray, settings: Settings) -> None:
    if np.isinf(elevation).any():
        raise LavaError(f'{name}.data', math.inf, 'finite metres, NaN where unknown')
    holes = int(np.isnan(elevation).sum())
    if holes == elevation.size:
        raise LavaError(f'{name}.data', math.nan, 'at least one cell with data')
    if holes and not settings.terrain_allow_holes:
        raise LavaError(
            f'{name}.data',
            f'{holes} of {elevation.size} cells without data (NaN)',
            'data in every cell, or the parameter terrain_allow_holes set to true',
        )
