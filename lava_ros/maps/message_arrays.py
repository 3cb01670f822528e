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

"""Messages from anywhere -> arrays, where what they say of their sizes is true. Needs no ROS."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from lava_ros.errors import LavaError

#: numpy type of each sensor_msgs/PointField datatype: INT8 is 1, FLOAT64 is 8.
POINT_TYPES = dict(enumerate(('i1', 'u1', 'i2', 'u2', 'i4', 'u4', 'f4', 'f8'), start=1))

#: numpy type of each image encoding a terrain may have.
IMAGE_TYPES = {'32FC1': 'f4', '16UC1': 'u2'}


def image_array(image: Any, name: str) -> np.ndarray:
    """A view of an image's pixels, shape [height, width], in the type of its encoding.

    Errors name the message by ``name``.

    Raises:
        LavaError: The encoding is not one of ``IMAGE_TYPES``, or size, step and data disagree.
    """
    if image.encoding not in IMAGE_TYPES:
        raise LavaError(f'{name}.encoding', image.encoding, f'one of {", ".join(IMAGE_TYPES)}')
    dtype = np.dtype(('>' if image.is_bigendian else '<') + IMAGE_TYPES[image.encoding])
    rows, columns = image.height, image.width
    if rows == 0 or columns == 0:
        raise LavaError(f'{name}.size', f'{columns} x {rows}', 'at least one pixel')
    least = columns * dtype.itemsize
    right = f'at least {least} bytes for {columns} pixels of {image.encoding}'
    _check_rows(image, name, 'step', least, right)
    strides = (image.step, dtype.itemsize)
    pixels: np.ndarray = np.ndarray((rows, columns), dtype, image.data, strides=strides)
    return pixels


def cloud_columns(
    cloud: Any, name: str, required: Sequence[str], optional: Sequence[str] = ()
) -> dict[str, np.ndarray]:
    """Read fields of a point cloud, organised or not, in any order, type and padding.

    Errors name the message by ``name``.

    Returns:
        Values by field name, float64, shape [height x width], of the required fields and of the
        optional ones present. A cloud without points has empty arrays of the required fields.

    Raises:
        LavaError: A field is missing or malformed, or size, steps and data disagree.
    """
    rows, columns = cloud.height, cloud.width
    if rows == 0 or columns == 0:
        if size := len(cloud.data):
            right = f'none for {columns} x {rows} points'
            raise LavaError(f'{name}.data', f'{size} bytes', right)
        return {key: np.empty(0) for key in required}
    by_name = {item.name: item for item in cloud.fields}
    if missing := [key for key in required if key not in by_name]:
        right = f'{", ".join(required)}; missing: {", ".join(missing)}'
        raise LavaError(f'{name}.fields', list(by_name), right)
    least = columns * cloud.point_step
    _check_rows(cloud, name, 'row_step', least, f'at least width x point_step = {least} bytes')
    result = {}
    for key in [*required, *(key for key in optional if key in by_name)]:
        item, where = by_name[key], f'{name}.fields.{key}'
        if item.datatype not in POINT_TYPES or item.count != 1:
            found = f'datatype {item.datatype}, count {item.count}'
            raise LavaError(where, found, 'a datatype from 1 (INT8) to 8 (FLOAT64), count 1')
        dtype = np.dtype(('>' if cloud.is_bigendian else '<') + POINT_TYPES[item.datatype])
        if item.offset + dtype.itemsize > cloud.point_step:
            right = f'inside a point of {cloud.point_step} bytes (point_step)'
            raise LavaError(f'{where}.offset', item.offset, right)
        steps = (cloud.row_step, cloud.point_step)
        view = np.ndarray((rows, columns), dtype, cloud.data, item.offset, steps)
        # Any bit pattern may come, signalling NaN too.
        with np.errstate(invalid='ignore'):
            result[key] = view.astype(np.float64).ravel()
    return result


def _check_rows(message: Any, name: str, field: str, least: int, right: str) -> None:
    """Check that rows have at least some bytes, and that the data are as many rows."""
    step = getattr(message, field)
    if step < least:
        raise LavaError(f'{name}.{field}', step, right)
    if len(message.data) != step * message.height:
        expected = f'{field} x height = {step * message.height} bytes'
        raise LavaError(f'{name}.data', f'{len(message.data)} bytes', expected)
