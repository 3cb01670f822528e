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

"""Arrays to message fields and back."""

import array

import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Image, PointCloud2, PointField

from lava_ros.bag.decoding import cloud_columns, image_array
from lava_ros.errors import LavaError
from lava_ros.ros import codec

VALUES = np.array([[1.5, -2.0, 3.0], [4.0, 5.0, np.nan]])


def _image(values, encoding, dtype, *, padding=0, is_bigendian=False):
    rows, columns = values.shape
    data = values.astype(np.dtype(dtype).newbyteorder('>' if is_bigendian else '<'))
    lines = [line.tobytes() + b'\xff' * padding for line in data]
    return Image(
        height=rows,
        width=columns,
        encoding=encoding,
        is_bigendian=int(is_bigendian),
        step=columns * data.itemsize + padding,
        data=array.array('B', b''.join(lines)),
    )


@pytest.mark.parametrize('is_bigendian', [False, True])
@pytest.mark.parametrize('padding', [0, 6])
@pytest.mark.parametrize(('encoding', 'dtype'), [('32FC1', 'f4'), ('16UC1', 'u2')])
def test_image_array(encoding, dtype, padding, is_bigendian):
    """Both encodings are read in both byte orders and with padded rows."""
    values = np.arange(6.0).reshape(2, 3) + 1000.0
    image = _image(values, encoding, dtype, padding=padding, is_bigendian=is_bigendian)
    np.testing.assert_array_equal(image_array(image, 'terrain'), values)


def test_float_image_round_trip():
    """A float image comes back bit by bit, through the wire format too."""
    image = codec.float_image(VALUES, codec.header('map', 1_500_000_002))
    assert (image.header.stamp.sec, image.header.stamp.nanosec) == (1, 500_000_002)
    again = deserialize_message(codec.serialise(image), Image)
    np.testing.assert_array_equal(image_array(again, 'x'), VALUES.astype(np.float32))


def _cloud(order, datatypes, *, rows, padding, is_bigendian):
    """Three points, or two rows of three, with fields in any order and holes between them."""
    names = {'x': 1.0, 'y': 2.0, 'z': 3.0}
    kinds = {PointField.FLOAT32: 'f4', PointField.FLOAT64: 'f8'}
    mark = '>' if is_bigendian else '<'
    formats = [mark + kinds[datatype] for datatype in datatypes]
    sizes = [np.dtype(item).itemsize + padding for item in formats]
    offsets = [padding + sum(sizes[:index]) for index in range(3)]
    step = padding + sum(sizes)
    dtype = np.dtype({'names': order, 'formats': formats, 'offsets': offsets, 'itemsize': step})
    points = np.zeros((rows, 3), dtype)
    for name in order:
        points[name] = names[name] + 10.0 * np.arange(rows * 3).reshape(rows, 3)
    data = b''.join(line.tobytes() + b'\xee' * padding for line in points)
    fields = [
        PointField(name=name, offset=offset, datatype=datatype, count=1)
        for name, offset, datatype in zip(order, offsets, datatypes, strict=True)
    ]
    return PointCloud2(
        height=rows,
        width=3,
        fields=fields,
        is_bigendian=is_bigendian,
        point_step=step,
        row_step=3 * step + padding,
        data=array.array('B', data),
    )


@pytest.mark.parametrize('order', [['x', 'y', 'z'], ['z', 'x', 'y']])
@pytest.mark.parametrize('rows', [1, 2])
@pytest.mark.parametrize('padding', [0, 3])
@pytest.mark.parametrize('is_bigendian', [False, True])
@pytest.mark.parametrize('datatypes', [(7, 7, 7), (8, 7, 8)])
def test_cloud_columns(order, rows, padding, is_bigendian, datatypes):
    """Any order, type, padding, organisation and byte order gives the same numbers."""
    cloud = _cloud(order, datatypes, rows=rows, padding=padding, is_bigendian=is_bigendian)
    columns = cloud_columns(cloud, 'cloud', ('x', 'y', 'z'), optional=('id',))
    steps = 10.0 * np.arange(rows * 3)
    for name, first in (('x', 1.0), ('y', 2.0), ('z', 3.0)):
        np.testing.assert_array_equal(columns[name], first + steps)
    assert set(columns) == {'x', 'y', 'z'}


@pytest.mark.parametrize(
    ('changes', 'field'),
    [
        ({'row_step': 35}, 'cloud.row_step'),
        ({'row_step': 40}, 'cloud.data'),
        ({'height': 2}, 'cloud.data'),
        ({'width': 0}, 'cloud.data'),
        ({'fields': []}, 'cloud.fields'),
        ({'point_step': 11}, 'cloud.fields.z.offset'),
        (
            {'fields': [PointField(name=name, datatype=9, count=1) for name in 'xyz']},
            'cloud.fields.x',
        ),
        (
            {'fields': [PointField(name=name, datatype=7, count=2) for name in 'xyz']},
            'cloud.fields.x',
        ),
    ],
)
def test_a_malformed_cloud_is_refused(changes, field):
    """Fields, steps, size and data have to agree."""
    cloud = _cloud(['x', 'y', 'z'], (7, 7, 7), rows=1, padding=0, is_bigendian=False)
    for name, value in changes.items():
        setattr(cloud, name, value)
    with pytest.raises(LavaError) as caught:
        cloud_columns(cloud, 'cloud', ('x', 'y', 'z'))
    assert caught.value.field == field


def test_point_cloud_round_trip():
    """A cloud that was made can be read."""
    cloud = codec.point_cloud({'x': [1.0, 2.0], 'id': [3.0, 4.0]}, codec.header('map', 0))
    columns = cloud_columns(cloud, 'cloud', ('x',), optional=('id',))
    assert columns['x'].tolist() == [1.0, 2.0]
    assert columns['id'].tolist() == [3.0, 4.0]
    empty = codec.point_cloud({'x': [], 'id': []}, codec.header('map', 0))
    assert cloud_columns(empty, 'cloud', ('x',))['x'].size == 0
