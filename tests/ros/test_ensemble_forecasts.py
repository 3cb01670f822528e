# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Bags of ensembles, and masks of observed lava."""

from array import array
from operator import attrgetter

import numpy as np
import pytest
from rclpy.serialization import deserialize_message

from disc_flow import disc_fields, disc_plan
from lava_ros.bag import BagReader
from lava_ros.bag.decoding import image_array
from lava_ros.errors import LavaError
from lava_ros.forecast.assimilation import outline_on
from lava_ros.forecast.probability import EnsembleAccumulator, footprint_of
from lava_ros.maps.forecast import occupancy
from lava_ros.ros import codec
from lava_ros.ros.codec import message_class
from lava_ros.ros.inputs import mask_from_grid
from lava_ros.ros.parameters import Settings
from lava_ros.ros.snapshot_bags import write_atlas_bag
from lava_ros.scene import Terrain

SETTINGS = Settings()


def seen(cells, resolution=10.0, origin=(100.0, 50.0)):
    ground = Terrain(np.zeros(np.shape(cells)), resolution, origin=origin)
    info = codec.map_metadata(ground, codec.time_message(5))
    return codec.occupancy_grid(np.array(cells, dtype=np.int8), info, codec.header('map', 5))


def test_bag_has_the_topics_of_the_node(tmp_path):
    plan, tally = disc_plan(), EnsembleAccumulator(disc_plan())
    for index, factor in enumerate((0.5, 1.0, 2.0)):
        tally.add(footprint_of(disc_fields(index, factor), plan))
    maps = tally.maps()
    write_atlas_bag(tmp_path / 'bag', maps, plan, stamp_ns=7, custom_data={'ensemble': '{}'})
    bag = BagReader(tmp_path / 'bag')
    assert set(bag.custom_data) == {'scene', 'namespace', 'version', 'ensemble'}
    assert {name.removeprefix('/lava/') for name in bag.topics} == {
        'terrain', 'terrain_info', 'relief', 'vents', 'vents_markers', 'inundation_probability',
        'probability_class', 'arrival_time_p10', 'arrival_time_p50', 'arrival_time_p90',
        'expected_peak_thickness',
    }
    messages = {
        item.topic.removeprefix('/lava/'): deserialize_message(
            item.data, message_class(bag.topics[item.topic].message_type)
        )
        for item in bag.messages()
    }
    grid = messages['inundation_probability']
    assert (grid.info.width, grid.info.height, grid.info.resolution) == (30, 24, 20.0)
    np.testing.assert_array_equal(np.array(grid.data).reshape(24, 30), occupancy(maps.probability))
    assert set(grid.data) == {0, 33, 67, 100}
    for name, values in (
        ('expected_peak_thickness', maps.thickness), ('arrival_time_p50', maps.arrival[0.5]),
    ):
        image = messages[name]
        np.testing.assert_array_equal(image_array(image, name), values)
        assert image.header.stamp.nanosec == 7


def test_mask_is_resampled_to_the_terrain():
    mask = mask_from_grid(seen([[100, 49, -1], [50, 0, 100]]), SETTINGS)
    assert mask.lava.tolist() == [[True, False, False], [True, False, True]]
    assert mask.known.tolist() == [[True, True, False], [True, True, True]]
    assert (mask.resolution, mask.origin) == (10.0, (100.0, 50.0))
    ground = np.zeros((6, 10))
    ground[2, 4] = np.nan
    # the mask starts in column 2, row 1
    outline = outline_on(Terrain(ground, 5.0, origin=(90.0, 45.0)), mask, 60.0)
    fine = np.kron(mask.lava, np.ones((2, 2))).astype(bool)
    known = np.kron(mask.known, np.ones((2, 2))).astype(bool)
    known[1, 2] = False
    np.testing.assert_array_equal(outline.known[1:5, 2:8], known)
    np.testing.assert_array_equal(outline.lava[1:5, 2:8], fine & known)
    assert outline.known.sum() == known.sum() and outline.lava.sum() == (fine & known).sum()
    with pytest.raises(LavaError, match='outline with lava'):
        outline_on(Terrain(ground, 5.0, origin=(900.0, 45.0)), mask, 60.0)


@pytest.mark.parametrize(
    ('path', 'value', 'field'),
    [
        ('header.frame_id', 'odom', 'header.frame_id'),
        ('data', array('b', [100, 0, 0]), 'data'),
        ('data', array('b', [101, 0, 0, 0]), 'data'),
        ('info.origin.orientation.z', 0.7, 'info.origin.orientation'),
        ('info.resolution', 0.0, 'info.resolution'),
        ('info.origin.position.x', 1e308, 'info.origin.position.x'),
    ],
)
def test_rejects_an_invalid_mask(path, value, field):
    message = seen([[100, 0], [0, 0]])
    owner, _, name = path.rpartition('.')
    setattr(attrgetter(owner)(message) if owner else message, name, value)
    with pytest.raises(LavaError) as caught:
        mask_from_grid(message, SETTINGS)
    assert caught.value.field == f'observed.{field}'
