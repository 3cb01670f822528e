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

"""Messages that come in -> Terrain and Vent, or a LavaError that says what is wrong with them."""

from dataclasses import dataclass
import math
from typing import Any

from geometry_msgs.msg import PointStamped, Pose
from nav_msgs.msg import MapMetaData
import numpy as np
from sensor_msgs.msg import Image, PointCloud2

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.layers import ZERO_CELSIUS
from lava_ros.ros import codec, grid_map
from lava_ros.scene import MAX_SIDE_CELLS, Terrain, Vent

#: Fields a cloud of vents has to have; ``z`` is there for viewers.
VENT_FIELDS = ('x', 'y', 'z', 'discharge', 'temperature', 'radius')


@dataclass(frozen=True)
class InputRules:
    """What is asked of messages.

    Attributes:
        frame_id: Frame every message has to be in.
        terrain_scale: Metres per unit of a terrain image.
        terrain_offset: Metres added after the scale.
        terrain_allow_holes: Whether cells without data (NaN) are taken.
        terrain_cloud_resolution: Side of the cells a terrain cloud is rasterised to [m].
        max_terrain_cells: Most cells of a terrain.
        max_vents: Most vents in a message.
        max_input_bytes: Most bytes of data in a message.
        epsg: EPSG code of the projected system the map frame is an offset of.
        offset: Easting and northing [m] of the map frame's origin in that system.
    """

    frame_id: str = 'map'
    terrain_scale: float = 1.0
    terrain_offset: float = 0.0
    terrain_allow_holes: bool = False
    terrain_cloud_resolution: float = 10.0
    max_terrain_cells: int = 25_000_000
    max_vents: int = 1000
    max_input_bytes: int = 512 * 1024 * 1024
    epsg: int | None = None
    offset: tuple[float, float] = (0.0, 0.0)


def check_image(image: Image, rules: InputRules) -> None:
    """Check all that can be said about a terrain image before its terrain_info is there.

    Raises:
        LavaError: Frame, size, encoding, steps or elevations are not usable.
    """
    _check_frame('terrain', image.header.frame_id, rules)
    _check_bytes('terrain', image.data, rules)
    _check_cells('terrain.size', image.width, image.height, rules)
    _check_elevation('terrain', codec.image_array(image, 'terrain'), rules)


def check_info(info: MapMetaData, rules: InputRules, *, name: str = 'terrain_info') -> None:
    """Check the description of a grid by itself.

    Raises:
        LavaError: Size, resolution or origin is not usable.
    """
    _check_cells(f'{name}.size', info.width, info.height, rules)
    validation.number(f'{name}.resolution', info.resolution, above=0.0, unit='m')
    _check_pose(f'{name}.origin', info.origin)


def terrain_from_image(image: Image, info: MapMetaData, rules: InputRules) -> Terrain:
    """Make a terrain from an image of elevations and the description of its cells.

    Raises:
        LavaError: One of them is not usable, or their sizes differ.
    """
    check_image(image, rules)
    check_info(info, rules)
    if (image.width, image.height) != (info.width, info.height):
        raise _size_mismatch(image, info)
    pixels = codec.image_array(image, 'terrain').astype(np.float64)
    return Terrain(
        elevation=pixels * rules.terrain_scale + rules.terrain_offset,
        # The shortest decimal number the float32 stands for: 0.1, not 0.10000000149.
        resolution=float(str(np.float32(info.resolution))),
        origin=(info.origin.position.x, info.origin.position.y),
        epsg=rules.epsg,
        offset=rules.offset,
    )


def terrain_from_cloud(cloud: PointCloud2, rules: InputRules) -> Terrain:
    """Make a terrain from points on the ground: each cell gets the mean of its points.

    The cells start half a cell before the outermost points, so that points on a regular grid of
    the same resolution are cell centres. Points with a NaN coordinate count as absent.

    Raises:
        LavaError: The cloud is not usable, or leaves cells without points.
    """
    name = 'terrain_cloud'
    _check_frame(name, cloud.header.frame_id, rules)
    _check_bytes(name, cloud.data, rules)
    columns = codec.cloud_columns(cloud, name, ('x', 'y', 'z'))
    points = np.stack([columns['x'], columns['y'], columns['z']], axis=-1)
    if np.isinf(points).any():
        raise LavaError(f'{name}.data', math.inf, 'finite metres, NaN for points without data')
    points = points[~np.isnan(points).any(axis=1)]
    if len(points) == 0:
        raise LavaError(f'{name}.size', f'{cloud.width} x {cloud.height}', 'at least one point')
    resolution = rules.terrain_cloud_resolution
    low = points[:, :2].min(axis=0) - 0.5 * resolution
    width, height = (
        int(cells) for cells in np.floor((points[:, :2].max(axis=0) - low) / resolution) + 1
    )
    _check_cells(f'{name}.size', width, height, rules)
    column, row = np.floor((points[:, :2] - low) / resolution).astype(np.int64).T
    cell = row * width + column
    count = np.bincount(cell, minlength=width * height)
    total = np.bincount(cell, weights=points[:, 2], minlength=width * height)
    mean = np.full(width * height, np.nan)
    np.divide(total, count, out=mean, where=count > 0)
    elevation = mean.reshape(height, width)
    _check_elevation(name, elevation, rules)
    return Terrain(
        elevation=elevation,
        resolution=resolution,
        origin=(float(low[0]), float(low[1])),
        epsg=rules.epsg,
        offset=rules.offset,
    )


def terrain_from_grid(message: Any, rules: InputRules) -> Terrain:
    """Make a terrain from the layer ``elevation`` of a grid_map_msgs/GridMap.

    Raises:
        LavaError: The map is not usable, or lacks the layer.
    """
    name = 'terrain_grid'
    _check_frame(name, message.header.frame_id, rules)
    _check_pose(f'{name}.info.pose', message.info.pose)
    for array in message.data:
        cells = len(array.data) - array.layout.data_offset
        if cells > rules.max_terrain_cells:
            right = f'at most {rules.max_terrain_cells} (max_terrain_cells)'
            raise LavaError(f'{name}.data', f'{cells} cells', right)
    elevation = grid_map.layer_values(message, grid_map.ELEVATION, name)
    _check_cells(f'{name}.size', elevation.shape[1], elevation.shape[0], rules)
    _check_elevation(name, elevation, rules)
    info, centre = message.info, message.info.pose.position
    return Terrain(
        elevation=elevation,
        resolution=info.resolution,
        origin=(centre.x - 0.5 * info.length_x, centre.y - 0.5 * info.length_y),
        epsg=rules.epsg,
        offset=rules.offset,
    )


def vents_from_cloud(cloud: PointCloud2, rules: InputRules) -> tuple[Vent, ...]:
    """Make the vents of a message, which stand for all there are: no points, no vents.

    Raises:
        LavaError: The cloud is not usable, or a vent in it is not.
    """
    _check_frame('vents', cloud.header.frame_id, rules)
    _check_bytes('vents', cloud.data, rules)
    count = cloud.width * cloud.height
    if count > rules.max_vents:
        raise LavaError('vents.size', count, f'at most {rules.max_vents} vents (max_vents)')
    columns = codec.cloud_columns(cloud, 'vents', VENT_FIELDS, optional=('id',))
    ids = columns.get('id', np.arange(count, dtype=np.float64))
    vents = []
    for index in range(count):
        x, y, discharge, temperature, radius = (
            float(columns[key][index]) for key in ('x', 'y', 'discharge', 'temperature', 'radius')
        )
        vents.append(_vent(f'vent {ids[index]:g}', x, y, discharge, temperature, radius))
    return tuple(vents)


def vent_from_point(
    point: PointStamped,
    rules: InputRules,
    *,
    discharge: float,
    temperature: float,
    radius: float,
    name: str,
) -> Vent:
    """Make the vent that a click in a viewer opens; the stamp is the viewer's and plays no part.

    Args:
        point: The click.
        rules: What is asked of messages.
        discharge: Its discharge [m3/s].
        temperature: Its temperature [Celsius].
        radius: Its radius [m].
        name: Its name.

    Raises:
        LavaError: The frame or the position is not usable.
    """
    _check_frame('clicked_point', point.header.frame_id, rules)
    return _vent(name, point.point.x, point.point.y, discharge, temperature, radius)


class TerrainPairing:
    """Finds the image and the description that belong together on two topics.

    Either may come first. Two that are both new make a terrain at once when their sizes agree. A
    single new one of the old size gives its partner ``settle`` seconds to come and then pairs with
    the old partner, so that a publisher that sends both never shows the new elevations at the old
    place. Halves of different sizes are an error after ``patience`` seconds, one without any
    partner after ``absence`` seconds: a machine with too much to do may hear of one publisher
    seconds after the other, which is no mistake of theirs. Each is reported once.
    """

    def __init__(
        self, *, settle: float = 0.5, patience: float = 2.0, absence: float = 10.0
    ) -> None:
        """Start with nothing.

        Args:
            settle: Time the partner of a single new half has to come [s].
            patience: Time after which a half of another size than its partner is reported [s].
            absence: Time after which a half without any partner is reported [s].
        """
        self._settle = settle
        self._patience = patience
        self._absence = absence
        self._image: Image | None = None
        self._info: MapMetaData | None = None
        self._image_is_new = False
        self._info_is_new = False
        self._changed = 0.0
        self._reported = True

    def add_image(self, image: Image, now: float) -> None:
        """Take a checked image at a monotonic time [s]."""
        self._image, self._image_is_new = image, True
        self._changed, self._reported = now, False

    def add_info(self, info: MapMetaData, now: float) -> None:
        """Take a checked description at a monotonic time [s]."""
        self._info, self._info_is_new = info, True
        self._changed, self._reported = now, False

    @property
    def is_waiting(self) -> bool:
        """Whether ``poll`` may still have something to say."""
        return (self._image_is_new or self._info_is_new) and not self._reported

    def poll(self, now: float) -> tuple[Image, MapMetaData] | None:
        """Return a pair that has become complete.

        Raises:
            LavaError: The halves have not found each other in time; said once.
        """
        if not self.is_waiting:
            return None
        image, info = self._image, self._info
        if image is not None and info is not None:
            fits = (image.width, image.height) == (info.width, info.height)
            both_new = self._image_is_new and self._info_is_new
            if fits and (both_new or now - self._changed >= self._settle):
                self._image_is_new = self._info_is_new = False
                return image, info
        is_alone = image is None or info is None
        if now - self._changed < (self._absence if is_alone else self._patience):
            return None
        self._reported = True
        if image is None:
            raise LavaError('terrain', None, 'an Image beside the MapMetaData on terrain_info')
        if info is None:
            raise LavaError('terrain_info', None, 'a MapMetaData beside the Image on terrain')
        raise _size_mismatch(image, info)


def _size_mismatch(image: Image, info: MapMetaData) -> LavaError:
    return LavaError(
        'terrain_info.size',
        f'{info.width} x {info.height}',
        f'the size of the image on terrain, {image.width} x {image.height}',
    )


def _vent(
    name: str, x: float, y: float, discharge: float, temperature: float, radius: float
) -> Vent:
    validation.number(f"vent '{name}'.temperature", temperature, unit='Celsius')
    return Vent(
        position=(x, y),
        discharge=discharge,
        temperature=temperature + ZERO_CELSIUS,
        radius=radius,
        name=name,
    )


def _check_frame(name: str, frame_id: str, rules: InputRules) -> None:
    if frame_id != rules.frame_id:
        raise LavaError(
            f'{name}.header.frame_id', frame_id, f'{rules.frame_id!r}: nothing is transformed here'
        )


def _check_pose(name: str, pose: Pose) -> None:
    place, turn = pose.position, pose.orientation
    for axis in ('x', 'y'):
        validation.number(f'{name}.position.{axis}', getattr(place, axis), unit='m')
    if place.z != 0.0:
        raise LavaError(f'{name}.position.z', place.z, '0: the elevations carry the height')
    # The negation also catches NaN.
    if not (max(abs(turn.x), abs(turn.y), abs(turn.z)) < 1e-6 and abs(abs(turn.w) - 1.0) < 1e-6):
        raise LavaError(
            f'{name}.orientation',
            (turn.x, turn.y, turn.z, turn.w),
            '(0, 0, 0, 1): rotated grids are not supported',
        )


def _check_bytes(name: str, data: object, rules: InputRules) -> None:
    size = memoryview(data).nbytes  # type: ignore[arg-type]
    if size > rules.max_input_bytes:
        raise LavaError(
            f'{name}.data', f'{size} bytes', f'at most {rules.max_input_bytes} (max_input_bytes)'
        )


def _check_cells(field: str, width: int, height: int, rules: InputRules) -> None:
    if min(width, height) < 2 or max(width, height) > MAX_SIDE_CELLS:
        raise LavaError(field, f'{width} x {height}', f'2 to {MAX_SIDE_CELLS} cells a side')
    if width * height > rules.max_terrain_cells:
        raise LavaError(
            field,
            f'{width} x {height}',
            f'at most {rules.max_terrain_cells} cells (max_terrain_cells)',
        )


def _check_elevation(name: str, elevation: np.ndarray, rules: InputRules) -> None:
    if np.isinf(elevation).any():
        raise LavaError(f'{name}.data', math.inf, 'finite metres, NaN where unknown')
    holes = int(np.isnan(elevation).sum())
    if holes == elevation.size:
        raise LavaError(f'{name}.data', math.nan, 'at least one cell with data')
    if holes and not rules.terrain_allow_holes:
        raise LavaError(
            f'{name}.data',
            f'{holes} of {elevation.size} cells without data (NaN)',
            'data in every cell, or the parameter terrain_allow_holes set to true',
        )
