# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Ensembles in the node: requests, cancellation, maps, and observed outlines."""

from array import array
from dataclasses import replace
from operator import attrgetter
from types import SimpleNamespace

import numpy as np
import pytest
from rclpy.serialization import deserialize_message

from disc_flow import disc_fields, disc_plan
from lava_ros.bag import BagReader
from lava_ros.bag.decoding import image_array
from lava_ros.errors import LavaError
from lava_ros.forecast.assimilation import Mask, outline_on
from lava_ros.forecast.probability import EnsembleAccumulator, footprint_of
from lava_ros.maps.forecast import HazardMaps, occupancy, QUANTILES
from lava_ros.ros import codec
from lava_ros.ros.codec import message_class
from lava_ros.ros.ensemble_forecasts import EnsembleForecasts, ForecastRules
from lava_ros.ros.inputs import mask_from_grid
from lava_ros.ros.offline_bags import write_atlas_bag
from lava_ros.ros.parameters import Settings
from lava_ros.ros.session import Fork
from lava_ros.scene import Lava, Scene, Terrain

SCENE = Scene(Terrain(np.zeros((4, 5)), 10.0), lava=Lava())

RULES = ForecastRules(horizon=60.0, threshold=0.01, max_age=30.0, share=1.0, max_particles=1000)

MASK = Mask(np.eye(4, 5) > 0.0, np.ones((4, 5), dtype=bool), 10.0, (0.0, 0.0))


def fork(clock, time, changes=1):
    """Return a copy of the state at a time of the clock [s]."""
    return Fork(SimpleNamespace(scene=SCENE, time=time), changes, clock, 0.01)


def order(ensembles, number, made, members=8):
    return ensembles.order(made, number, replace(RULES, members=members))


def sent(ensembles, changes=1):
    """Return the outlines that are sent to the process."""
    orders = []
    ensembles.send(
        lambda name, **values: orders.append((name, values)), changes=changes, time_scale=2.0
    )
    return orders


def test_stamp_of_an_outline_becomes_simulated_time():
    ensembles = EnsembleForecasts()
    for number, (clock, time) in enumerate(((100.0, 20.0), (110.0, 30.0), (120.0, 30.0)), 1):
        order(ensembles, number, fork(clock, time))
    for clock, time in ((105.0, 25.0), (115.0, 30.0), (123.0, 36.0)):
        done = ensembles.observe(MASK, clock)
        ((name, order_of_it),) = sent(ensembles)
        outline = order_of_it['outline']
        assert name == 'outline' and outline.time == pytest.approx(time)
        np.testing.assert_array_equal(outline.lava, MASK.lava)
        assert outline.known.all() and not done.done()
        ensembles.hear(
            'weighed', number=order_of_it['number'], agreement=[1.0], outlines=1, jaccard_mean=0.4
        )
        assert done.result(0.0) is None
    early = ensembles.observe(MASK, 99.0)
    assert sent(ensembles) == []
    with pytest.raises(LavaError, match='1.0 s before the first forecast of this scene'):
        early.result(0.0)
    assert (ensembles.status.outlines, ensembles.status.jaccard_mean) == (1, 0.4)


def test_one_ensemble_is_requested_per_state():
    ensembles = EnsembleForecasts()
    assert order(ensembles, 1, fork(1.0, 0.0), members=0) is None
    first = order(ensembles, 2, fork(2.0, 5.0))
    assert (first['members'], first['agreement'], first['deadline']) == (8, None, None)
    assert order(ensembles, 3, fork(3.0, 6.0)) is None
    known = np.zeros(SCENE.terrain.shape)
    maps = HazardMaps(known, dict.fromkeys(QUANTILES, known), known, 8, 8.0, 0.5)
    answer = {
        'number': 2, 'stamp_ns': first['stamp_ns'], 'time': 5.0, 'horizon': 60.0,
        'threshold': 0.01, 'maps': maps, 'asked': 8, 'is_done': True, 'outlines': 0,
        'duration': 3.0,
    }
    assert not ensembles.hear('ensemble', changes=0, **answer)
    assert ensembles.hear('ensemble', changes=1, **answer)
    latest = ensembles.latest
    assert (latest.shown.time, latest.stamp_ns, latest.changes) == (5.0, 2_000_000_000, 1)
    assert ensembles.status.count == 1
    assert ensembles.is_wanted(1, 6.0) and not ensembles.is_wanted(1, 5.0)
    order(ensembles, 4, fork(4.0, 7.0))
    ensembles.hear('ensemble_refused', reason='nothing is uncertain')
    assert ensembles.status.error == 'nothing is uncertain'
    assert not ensembles.is_wanted(1, 9.0) and ensembles.is_wanted(2, 9.0)
    assert order(ensembles, 5, fork(5.0, 9.0, changes=2))['members'] == 8
    assert ensembles.status.error == ''


def test_pending_outlines_fail_when_the_process_ends():
    ensembles = EnsembleForecasts()
    order(ensembles, 1, fork(1.0, 0.0))
    gone = ensembles.observe(MASK, 2.0)
    assert len(sent(ensembles)) == 1
    kept = ensembles.observe(MASK, 3.0)
    assert sent(ensembles, changes=2) == []
    ensembles.drop('the process has ended')
    for future in (gone, kept):
        with pytest.raises(LavaError, match='the process has ended'):
            future.result(0.0)


SETTINGS = Settings()


def seen(cells, resolution=10.0, origin=(100.0, 50.0)):
    ground = Terrain(np.zeros(np.shape(cells)), resolution, origin=origin)
    info = codec.map_metadata(ground, 5)
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
