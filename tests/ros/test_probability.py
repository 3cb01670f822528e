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

"""Maps of an ensemble to messages, and outlines that were seen from them."""

import numpy as np
import pytest
from rclpy.serialization import deserialize_message

from disc_flow import disc_fields, disc_plan
from lava_ros.bag import BagReader
from lava_ros.errors import LavaError
from lava_ros.forecast.assimilation import outline_on
from lava_ros.forecast.probability import footprint_of, Tally
from lava_ros.maps.forecast import occupancy
from lava_ros.maps.message_arrays import image_array
from lava_ros.ros import codec
from lava_ros.ros.inputs import mask_from_grid
from lava_ros.ros.offline_bags import write_atlas_bag
from lava_ros.ros.parameters import Settings
from lava_ros.ros.player import message_class
from lava_ros.scene import Terrain

RULES = Settings()


def seen(cells, resolution=10.0, origin=(100.0, 50.0)):
    """A mask as a message."""
    ground = Terrain(np.zeros(np.shape(cells)), resolution, origin=origin)
    info = codec.map_metadata(ground, 5)
    return codec.occupancy_grid(np.array(cells, dtype=np.int8), info, codec.header('map', 5))


def test_a_bag_has_the_maps(tmp_path):
    """Names, types and values of what a node publishes too, on the terrain's cells."""
    plan, tally = disc_plan(), Tally(disc_plan())
    for index, factor in enumerate((0.5, 1.0, 2.0)):
        tally.add(footprint_of(disc_fields(index, factor), plan))
    maps = tally.maps()
    write_atlas_bag(tmp_path / 'bag', maps, plan, stamp_ns=7, custom_data={'ensemble': '{}'})
    bag = BagReader(tmp_path / 'bag')
    assert set(bag.custom_data) == {'scene', 'version', 'ensemble'}
    assert {name.removeprefix('/lava/') for name in bag.topics} == {
        'terrain', 'terrain_info', 'vents', 'inundation_probability', 'probability_class',
        'arrival_time_p10', 'arrival_time_p50', 'arrival_time_p90', 'expected_thickness',
    }
    messages = {
        item.topic.removeprefix('/lava/'): deserialize_message(
            item.data, message_class(bag.topics[item.topic].message_type)
        )
        for item in bag.messages()
    }
    grid = messages['inundation_probability']
    assert (grid.info.width, grid.info.height, grid.info.resolution) == (30, 24, 20.0)
    np.testing.assert_array_equal(
        np.array(grid.data).reshape(24, 30), occupancy(maps.probability)
    )
    assert set(grid.data) == {0, 33, 67, 100}
    for name, values in (
        ('expected_thickness', maps.thickness), ('arrival_time_p50', maps.arrival[0.5]),
    ):
        image = messages[name]
        np.testing.assert_array_equal(image_array(image, name), values)
        assert image.header.stamp.nanosec == 7


def test_a_mask_is_read_and_laid_on_the_terrain():
    """Lava from 50 on, unknown below 0 and beyond the mask; cells find the one they lie in."""
    mask = mask_from_grid(seen([[100, 49, -1], [50, 0, 100]]), RULES)
    assert mask.lava.tolist() == [[True, False, False], [True, False, True]]
    assert mask.known.tolist() == [[True, True, False], [True, True, True]]
    assert (mask.resolution, mask.origin) == (10.0, (100.0, 50.0))
    ground = np.zeros((6, 10))
    ground[2, 4] = np.nan
    # cells of 5 m from (90, 45) on: the mask begins in column 2, row 1
    outline = outline_on(Terrain(ground, 5.0, origin=(90.0, 45.0)), mask, 60.0)
    fine = np.kron(mask.lava, np.ones((2, 2))).astype(bool)
    known = np.kron(mask.known, np.ones((2, 2))).astype(bool)
    known[1, 2] = False
    np.testing.assert_array_equal(outline.known[1:5, 2:8], known)
    np.testing.assert_array_equal(outline.lava[1:5, 2:8], fine & known)
    assert outline.known.sum() == known.sum() and outline.lava.sum() == (fine & known).sum()
    with pytest.raises(LavaError, match='outline with lava'):
        outline_on(Terrain(ground, 5.0, origin=(900.0, 45.0)), mask, 60.0)


def test_masks_that_cannot_be_used_are_refused():
    """Another frame, another number of cells, turned, of no size."""
    other = seen([[100, 0], [0, 0]])
    other.header.frame_id = 'odom'
    short = seen([[100, 0], [0, 0]])
    short.data = short.data[:3]
    turned = seen([[100, 0], [0, 0]])
    turned.info.origin.orientation.z = 0.7
    flat = seen([[100, 0], [0, 0]])
    flat.info.resolution = 0.0
    far = seen([[100, 0], [0, 0]])
    far.info.origin.position.x = 1e308
    beyond = seen([[101, 0], [0, 0]])
    for message, field in (
        (other, 'observed.header.frame_id'), (short, 'observed.data'),
        (turned, 'observed.info.origin.orientation'), (flat, 'observed.info.resolution'),
        (beyond, 'observed.data'), (far, 'observed.info.origin.position.x'),
    ):
        with pytest.raises(LavaError) as caught:
            mask_from_grid(message, RULES)
        assert caught.value.field == field
