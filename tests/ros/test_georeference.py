# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The georeference of a terrain, from a feed or a file to the bag and the exported GeoTIFF."""

from contextlib import contextmanager, nullcontext
from dataclasses import replace
from itertools import permutations
from operator import attrgetter
import re
from types import SimpleNamespace

from geometry_msgs.msg import TransformStamped
import numpy as np
import pytest
import rasterio
from rasterio.crs import CRS
import rclpy
from rclpy.qos import DurabilityPolicy
from rclpy.signals import SignalHandlerOptions

from geodata import write_raster
from lava_ros.bag import BagReader, BagWriter, LATCHED
from lava_ros.bag.georeference import MESSAGE, read_georeference, TOPIC
from lava_ros.cli.main import main
from lava_ros.clients.feed import SceneFeed
from lava_ros.errors import LavaError
from lava_ros.layers.recording import Recording
from lava_ros.live.worker_status import WorkerState
from lava_ros.ros import codec
from lava_ros.ros.georeference import (
    georeference_message,
    StaticTransform,
    TerrainGeoreferences,
)
from lava_ros.ros.outputs import terrain_messages
from lava_ros.scene import Georeference, Scene, Terrain, Vent
from lava_ros.scene.terrain_files import load_terrain
from recording import record, SECOND, START, TERRAIN
from ros.graph_publisher import elevation, georeference, image, info, Publisher
from ros_domain import own_domain
from waiting import PATIENCE

#: A projection around a volcano, which has no EPSG code.
LOCAL = CRS.from_proj4('+proj=tmerc +lat_0=37.75 +lon_0=15 +k=1 +ellps=GRS80 +units=m').to_wkt()

#: Coordinate systems: a UTM zone of WGS 84, another projected system, one without a code, none.
SYSTEMS = {'utm': 'EPSG:32633', 'projected': 'EPSG:25833', 'local': LOCAL, 'none': None}

#: Upper left corner [m] and side [m] of the cells of a raster; the last digits are binary.
CORNER, CELL = (499_123.25, 4_181_234.5), 12.5

PLACE = Georeference(32633, (499000.0, 4180000.0))
OTHER = Georeference(25833, (499007.0, 4180008.0))


@pytest.mark.parametrize('given', [
    PLACE, OTHER, Georeference(None, (1e-3, -123.456789012), LOCAL),
    Georeference(None, (5.0, 6.0)), Georeference(),
])
def test_message_of_a_georeference_is_read_back(given):
    header = codec.header('map', 7)
    message = georeference_message(given, header)
    assert (message.child_frame_id, message.header.stamp) == ('map', header.stamp)
    assert read_georeference(message, 'map') == (given, 7)


@pytest.mark.parametrize(('field', 'value', 'words'), [
    ('child_frame_id', 'odom', "is 'odom', expected 'map'"),
    *(
        ('header.frame_id', system, rf'is .{re.escape(system[:20])}.*, expected a projected')
        for system in (
            'utm', '32633', 'EPSG:', 'EPSG:999999', 'PROJCS[nothing]', LOCAL + 100_000 * ' ',
        )
    ),
    ('header.frame_id', 'EPSG:12', 'is 12, expected an EPSG code'),
    # degrees, and US survey feet
    *(
        ('header.frame_id', f'EPSG:{code}', f"is 'EPSG:{code}', expected a projected .* in metres")
        for code in (4326, 2236)
    ),
    ('transform.translation.x', float('nan'), 'is nan'),
    ('transform.translation.y', -2e9, 'is -2000000000'),
    ('transform.translation.z', 0.5, 'is 0.5, expected 0: the elevations carry the height'),
    ('transform.rotation.z', 0.5, r'expected \(0, 0, 0, 1\)'),
])
def test_georeference_that_is_not_valid_is_named(field, value, words):
    message, (path, _, name) = georeference(), field.rpartition('.')
    setattr(attrgetter(path)(message) if path else message, name, value)
    with pytest.raises(LavaError, match=rf'terrain_georeference\.{path}.*{words}'):
        read_georeference(message, 'map')


@pytest.mark.parametrize(('stamp', 'is_used'), [(0, True), (5, True), (6, True), (4, False)])
def test_georeference_belongs_to_the_terrain_with_its_stamp(stamp, is_used):
    ground = Terrain(elevation(), 10.0)
    times = [codec.time_message(number) for number in (5, 6)]
    message = georeference(stamp_ns=stamp)
    for is_first in (True, False):
        found = TerrainGeoreferences()
        if is_first:
            assert not found.add_georeference(message, 'map')
        assert found.add_terrain(ground, 'terrain', *times) is (is_first and is_used)
        if not is_first:
            assert found.ground.georeference == Georeference()
            assert found.add_georeference(message, 'map') is is_used
        assert found.ground.georeference == (PLACE if is_used else Georeference())
        assert found.topic_of(found.ground) == 'terrain'
        assert ('its stamp' in found.warning(found.ground)) is not is_used


def test_terrains_and_georeferences_in_any_order_do_not_mix():
    grounds = {number: Terrain(elevation() + number, 10.0) for number in (1, 2)}
    places = {1: PLACE, 2: OTHER}
    pieces = [(kind, number) for kind in ('terrain', 'georeference') for number in (1, 2)]
    for order in permutations(pieces):
        found = TerrainGeoreferences()
        for kind, number in order:
            if kind == 'terrain':
                stamp = codec.time_message(number)
                found.add_terrain(grounds[number], 'terrain_cloud', stamp)
            else:
                message = georeference_message(places[number], codec.header('map', number))
                found.add_georeference(message, 'map')
            used = found.ground
            if used is not None:
                number = round(float(used.elevation[0, 0] - elevation()[0, 0]))
                assert used.georeference in (Georeference(), places[number]), order
        # each publisher sends both at once, so that the two newest are of one terrain
        if {number for _, number in order[2:]} == {2}:
            assert used.georeference == OTHER, order


@pytest.mark.parametrize(('own', 'stated', 'expected'), [
    (Georeference(), PLACE, PLACE),
    (PLACE, OTHER, OTHER),
    # without a coordinate system, the one of the parameters remains
    (PLACE, Georeference(None, (1.0, 2.0)), PLACE),
    (Georeference(), Georeference(None, (1.0, 2.0)), Georeference(None, (1.0, 2.0))),
])
def test_georeference_replaces_that_of_the_parameters(own, stated, expected):
    found = TerrainGeoreferences()
    found.add_georeference(georeference_message(stated, codec.header('map', 0)), 'map')
    ground = Terrain(elevation(), 10.0).with_georeference(own)
    assert found.add_terrain(ground, 'terrain', codec.time_message(3))
    assert found.ground.georeference == expected
    is_replaced = own.system is not None and expected != own
    assert ('replaces epsg' in found.warning(found.ground)) is is_replaced


def test_static_transform_is_withdrawn_and_compared():
    header, found = codec.header('map', 1), StaticTransform(SimpleNamespace)
    ground = Terrain(elevation(), 10.0)
    assert found.update(ground, header) is None
    (own,) = found.update(ground.with_georeference(PLACE), header).transforms
    assert (own.header.frame_id, own.child_frame_id) == ('utm', 'map')
    found.receive([own], 'map')
    assert found.warning() == ''
    other = TransformStamped(header=codec.header('utm', 1), child_frame_id='map')
    found.receive([other], 'odom')
    assert found.warning() == ''
    found.receive([other], 'map')
    assert 'from utm (0, 0, 0), not utm (499000, 4180000, 0)' in found.warning()
    # no transform to itself, and none to a map far from its terrain
    assert found.update(ground.with_georeference(PLACE), codec.header('utm', 2)).transforms == []
    assert found.warning() == '' and found.update(ground, header) is None
    far = replace(ground, epsg=31467, origin=(3.6e6, 5.4e6))
    assert found.update(far, header) is None
    assert found.warning().startswith('no transform to map: terrain.offset is (0.0, 0.0)')


def started(local, name='/lava', **options):
    """Return an active node of a full name."""
    node = local(**options)
    assert node.change('configure', name) and node.change('activate', name), node.log
    return node


def reference_of(node):
    """Return the georeference that the diagnostics report."""
    status = node.status_now('simulation')
    if 'coordinate_system' not in status:
        return None
    offset = tuple(float(status[f'offset_{way}']) for way in ('easting', 'northing'))
    return status['coordinate_system'], offset


@pytest.mark.parametrize('durability', list(DurabilityPolicy)[1:3], ids=lambda item: item.name)
@pytest.mark.parametrize('moment', ['before', 'during', 'after'])
def test_georeference_is_taken_whenever_it_is_published(local, durability, moment):
    made = Publisher(own_domain('local'), durability=durability)
    sender = made.publishers[TOPIC]
    is_latched = durability is DurabilityPolicy.TRANSIENT_LOCAL
    try:
        if moment == 'before':
            sender.publish(georeference())
        node = started(local)
        node.wait_until(lambda: sender.get_subscription_count() == 1 + is_latched)
        if moment == 'during':
            sender.publish(georeference())
        if moment != 'after':
            node.wait_until(lambda: is_latched <= int(node.status_now('inputs')['accepted']))
        node.publish('vents', 'terrain_info', 'terrain')
        node.wait_until(lambda: node.worker.status.state is WorkerState.RUNNING)
        node.run(2.0)
        node.newest('height', condition=lambda newest: newest['height']['wet'] > 0)
        starts, time = node.worker.view.starts, node.worker.view.time
        if moment == 'after':
            assert reference_of(node) is None
            sender.publish(georeference())
        # a volatile publisher has to send again to a node that starts
        expected = None if moment == 'before' and not is_latched else ('EPSG:32633', PLACE.offset)
        node.wait_for_log(f'terrain: 40 x 30 cells of 10 m{", EPSG:32633" * bool(expected)}')
        node.run(5.0)
        node.wait_until(lambda: reference_of(node) == expected)
        # the flow continues
        assert node.worker.view.starts == starts and node.worker.view.time > time > 0.0
        assert node.status_now('inputs')['message'] == 'all taken'
    finally:
        made.close()


@pytest.mark.parametrize('order', [(TOPIC, 'terrain'), ('terrain', TOPIC)])
def test_terrain_waits_for_the_georeference_of_its_publisher(local, order):
    made = Publisher(own_domain('local'))
    try:
        node = started(local)
        node.wait_until(lambda: node.node.runtime.inputs.graph.other_publishers(TOPIC))
        header = codec.header('map', 5)
        messages = {'terrain': image(), TOPIC: georeference(stamp_ns=5)}
        messages['terrain'].header = header
        node.deliver('/terrain_info', info(map_load_time=header.stamp))
        for topic in order:
            node.deliver(f'/{topic}', messages[topic])
        node.wait_for_log('terrain: 40 x 30 cells of 10 m, EPSG:32633')
        # another terrain without a georeference does not get this one
        node.publish('higher_info', 'higher')
        node.wait_for_log('terrain: 48 x 30 cells of 10 m')
        assert node.log.count('terrain: 48 x 30 cells of 10 m') == 1
        assert node.log.count('10 m, EPSG:32633') == node.log.count('terrain: 40') == 1
    finally:
        made.close()


def test_bad_georeference_is_refused_and_the_former_one_holds(local):
    node = started(local)
    node.deliver(f'/{TOPIC}', georeference())
    node.publish('vents', 'terrain_info', 'terrain')
    node.newest('height')
    node.wait_until(lambda: reference_of(node) == ('EPSG:32633', PLACE.offset))
    node.deliver(f'/{TOPIC}', georeference('EPSG:4326'))
    status = node.status_now('inputs', lambda item: item['level'] == 2)
    assert f"{TOPIC}: {TOPIC}.header.frame_id is 'EPSG:4326'" in status['last_error']
    assert reference_of(node) == ('EPSG:32633', PLACE.offset)
    # another terrain keeps the last valid one, whose stamp is 0
    node.publish('higher_info', 'higher')
    node.wait_for_log('terrain: 48 x 30 cells of 10 m, EPSG:32633')


def test_georeference_does_not_replace_that_of_a_file(local, tmp_path):
    np.savez(
        tmp_path / 'ground.npz', elevation=elevation(), resolution=10.0, epsg=PLACE.epsg,
        offset=PLACE.offset,
    )
    node = started(local, terrain_file=str(tmp_path / 'ground.npz'))
    node.newest('height')
    node.deliver(f'/{TOPIC}', georeference('EPSG:25833'))
    status = node.status_now('inputs', lambda item: 'is not used' in item['message'])
    assert status['level'] == 1 and 'the terrain is of a file (EPSG:32633' in status['message']
    assert reference_of(node) == ('EPSG:32633', PLACE.offset)
    node.deliver(f'/{TOPIC}', georeference())
    node.status_now('inputs', lambda item: 'is not used' not in item['message'])
    # a terrain of a topic has the georeference of the topic
    node.deliver(f'/{TOPIC}', georeference('EPSG:25833'))
    node.publish('higher_info', 'higher')
    node.wait_for_log('terrain: 48 x 30 cells of 10 m, EPSG:25833')


def raster(path, system):
    """Write a slope with a valley as a GeoTIFF."""
    place = {'crs': system, 'cell': CELL, 'north_west': CORNER}
    return write_raster(path, elevation()[::-1], **place)


def scene_on(path):
    terrain = load_terrain(path)
    x, y = terrain.centre
    return Scene(terrain, (Vent((x - 100.0, y), 60.0, 1400.0, radius=20.0),))


@contextmanager
def feeding(path, *rules):
    """Publish a scene on a terrain, as ``lava ros feed`` does."""
    words = ['--ros-args', *(word for rule in rules for word in ('-r', rule))]
    rclpy.init(
        args=words, domain_id=own_domain('local'), signal_handler_options=SignalHandlerOptions.NO
    )
    feed = SceneFeed(scene_on(path))
    try:
        # the timer of the vents
        for timer in feed.timers:
            timer.callback()
        yield
    finally:
        feed.destroy_node()
        rclpy.shutdown()


def check_export(bag, path, output):
    """Export a bag, and compare its GeoTIFF with a raster to the cell."""
    assert main(['export', str(bag), '-o', str(output)]) == 0
    with rasterio.open(path) as expected, rasterio.open(output / 'thickness.tif') as found:
        assert found.crs == expected.crs
        assert found.transform == expected.transform
        assert found.shape == expected.shape
        assert (found.read(1) > 0.0).any()


def recorded(node, name='/lava'):
    """Let lava flow in an active node, finish its bag and return it."""
    node.wait_until(lambda: node.worker.status.state is WorkerState.RUNNING)
    node.wait_until(lambda: node.worker.view.scene.vents)
    node.run(6.0)
    height = f'{name[1:-5]}/height'.lstrip('/')
    node.newest(height, condition=lambda newest: newest[height]['wet'] > 0)
    assert node.change('deactivate', name) and node.change('cleanup', name), node.log
    return node.directory / 'bag'


def copied(bag, path, more=None, *, is_described=True):
    """Copy a bag with further georeferences at its start, by topic; return the copy.

    Without a description it is as another recorder would have written it.
    """
    source = BagReader(bag)
    with BagWriter(path, custom_data=source.custom_data if is_described else {}) as writer:
        for topic, message in (more or {}).items():
            writer.write(topic, MESSAGE, codec.serialise(message), source.start_ns, qos=LATCHED)
        for item in source.messages():
            topic = source.topics[item.topic]
            writer.write(
                item.topic, topic.message_type, item.data, item.stamp_ns, qos=topic.qos
            )
    return path


#: Rules for the names of node and feed.
RULES = {
    'plain': (),
    'remapped': (
        '__ns:=/etna', 'terrain:=/dem', 'terrain_info:=/dem_info',
        'terrain_georeference:=/dem_georeference', 'vents:=/a/vents',
    ),
}


@pytest.mark.parametrize(('source', 'system', 'rules'), [
    *(('feed', system, 'plain') for system in ('projected', 'local', 'none')),
    ('feed', 'utm', 'remapped'),
    ('file', 'projected', 'remapped'),
    *(
        pytest.param('file', system, 'plain', marks=pytest.mark.nightly)
        for system in ('local', 'none')
    ),
])
def test_exported_map_lies_where_the_terrain_lies(local, tmp_path, source, system, rules):
    path = raster(tmp_path / 'x.tif', SYSTEMS[system])
    name = '/lava' if rules == 'plain' else '/etna/lava'
    file = {'terrain_file': str(path)} if source == 'file' else {}
    node = started(local, name, record=True, bag_directory='bag', remap=RULES[rules], **file)
    if file:
        node.worker.set_vents(scene_on(path).vents).result(PATIENCE)
    with nullcontext() if file else feeding(path, *RULES[rules]):
        bag = recorded(node, name)
    check_export(bag, path, tmp_path / 'out')
    topics = BagReader(bag).topics
    expected = '/dem_georeference' if rules == 'remapped' else f'{name[:-5]}/{TOPIC}'
    assert topics[expected].message_type == MESSAGE and topics[expected].qos == LATCHED
    if rules != 'remapped':
        other = copied(bag, tmp_path / 'other', is_described=False)
        check_export(other, path, tmp_path / 'again')


@pytest.mark.parametrize(('stamp', 'is_used'), [(0, True), (START, True), (START + 5, False)])
def test_georeference_in_a_bag_belongs_to_the_terrain_with_its_stamp(tmp_path, stamp, is_used):
    source = record(tmp_path / 'source', (200.0, 400.0), prefix='/lava')
    message = georeference('EPSG:25833', 7.0, 8.0, stamp)
    recording = Recording(copied(source, tmp_path / 'bag', {f'/lava/{TOPIC}': message}))
    for frame in recording.frames():
        expected = (25833, (7.0, 8.0)) if is_used else (TERRAIN.epsg, TERRAIN.offset)
        assert frame.terrain.georeference[:2] == expected
    assert not recording.bag.damage


def test_terrains_of_a_bag_have_their_own_georeferences(tmp_path):
    later = START + 2 * SECOND
    messages = {
        stamp: {
            TOPIC: georeference_message(place, codec.header('map', stamp)),
            **terrain_messages(TERRAIN, codec.header('map', stamp)),
        }
        for stamp, place in ((START, PLACE), (later, OTHER))
    }
    source = BagReader(record(tmp_path / 'source', (200.0, 400.0)))
    with BagWriter(tmp_path / 'bag', custom_data={}) as writer:
        for item in source.messages():
            kind = source.topics[item.topic]
            for name, message in messages.pop(item.stamp_ns, {}).items():
                data, type_name = codec.serialise(message), codec.type_name(type(message))
                writer.write(f'/{name}', type_name, data, item.stamp_ns, qos=LATCHED)
            if 'terrain' not in item.topic:
                writer.write(
                    item.topic, kind.message_type, item.data, item.stamp_ns, qos=kind.qos
                )
    assert not messages
    frames = list(Recording(tmp_path / 'bag').frames())
    assert [frame.terrain.georeference for frame in frames] == [PLACE, OTHER]
    words = ['export', str(tmp_path / 'bag'), '-o', str(tmp_path / 'out'), '--every']
    assert main([*words, '--maps', 'thickness']) == 0
    for path, place in zip(sorted((tmp_path / 'out').glob('*.tif')), (PLACE, OTHER), strict=True):
        with rasterio.open(path) as file:
            assert file.crs.to_epsg() == place.epsg
            left, bottom = np.add(TERRAIN.origin, place.offset)
            assert (file.bounds.left, file.bounds.bottom) == (left, bottom)


def test_invalid_georeference_in_a_bag_is_damage(tmp_path):
    bag = record(tmp_path / 'source', (200.0,))
    message = georeference('EPSG:4326')
    recording = Recording(copied(bag, tmp_path / 'bag', {f'/{TOPIC}': message}))
    (frame,) = recording.frames()
    assert frame.terrain.epsg == TERRAIN.epsg
    (text,) = recording.bag.damage
    assert f'/{TOPIC} is left out' in text and 'EPSG:4326' in text
