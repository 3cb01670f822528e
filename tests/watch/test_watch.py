# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The live view without a browser: server, pages and frames."""

from contextlib import ExitStack, suppress
from dataclasses import replace
from http.client import HTTPConnection
from io import BytesIO
from itertools import count
import socket
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
from PIL import Image
import pytest
import rasterio
from rasterio.transform import from_bounds
from rasterio.warp import transform_bounds

pytest.importorskip('viser')
import trimesh
from websockets.exceptions import ConnectionClosed, InvalidStatus

from lava_ros.errors import LavaError
from lava_ros.layers.layer import ARRIVED, PROBABILITY
from lava_ros.layers.recording import Recording
from lava_ros.products.sheet import Panel
from lava_ros.scene.on_terrain import read_placed_picture
from lava_ros.watch import server as server_module
from lava_ros.watch import surface
from lava_ros.watch.frames import BagFrames, ensemble_frames, Level, Status, watched_layers
from lava_ros.watch.page import _coordinates, ground_picture, SHOWN
from lava_ros.watch.surface import Ground, SIDE
from recording import growing, record, TERRAIN
from small_checkpoint import small_checkpoint
from watch_page import Growing, served, TIMES, Visitor

PROBABLE = SHOWN[PROBABILITY][0]


@pytest.fixture
def frames(tmp_path):
    """Four of six frames."""
    return Growing(tmp_path, 4)


@pytest.fixture
def visit():
    """A function that serves frames, and returns a visitor with a page of its own."""
    with ExitStack() as stack:
        yield lambda *args, **options: Visitor(stack.enter_context(served(*args, **options)))


@pytest.fixture
def visitor(visit, frames):
    """A browser that shows the newest frame."""
    result = visit(frames, control=True)
    result.wait(lambda: result.page.title.content)
    return result


@pytest.fixture
def page(visitor):
    """The page of the visitor."""
    return visitor.page


def drawn(page, room=''):
    """Return what the page shows below a name."""
    nodes = page._client.scene._handle_from_node_name
    return {name: item for name, item in nodes.items() if name.startswith(room)}


@pytest.fixture(scope='module')
def server(tmp_path_factory):
    """A server whose frames stay the same, without control."""
    with served(Growing(tmp_path_factory.mktemp('served'), 4)) as result:
        yield result


#: Paths, and the status of the server's answer to its own page.
PAGES = {'/': 200, '/none': 404, '/../../_viser.py': 404, '/%2e%2e/%2e%2e/x': 404, '/ws': 101}

UPGRADE = {
    'Upgrade': 'websocket', 'Connection': 'Upgrade', 'Sec-WebSocket-Version': '13',
    'Sec-WebSocket-Key': 'bGF2YSBpcyBob3QgISEhIQ==',
}

#: ``Host`` and ``Origin`` of requests, and whether the server answers; {} stands for the port.
ASKED = [
    ('127.0.0.1:{}', None, True), ('LocalHost:{}', None, True),
    # through a tunnel, and from the page
    ('localhost:8080', None, True), ('127.0.0.1:{}', 'http://127.0.0.1:{}', True),
    ('evil.example:{}', None, False), ('evil.example:{}', 'http://evil.example:{}', False),
    ('localhost.evil.example:{}', None, False), ('evil@127.0.0.1:{}', None, False),
    ('203.0.113.1:{}', None, False), ('localhost:here', None, False),
    ('127.0.0.1:{}', 'http://evil.example', False), ('127.0.0.1:{}', 'http://127.0.0.1:1', False),
    ('127.0.0.1:{}', 'null', False),
]


@pytest.mark.parametrize(('host', 'origin', 'is_own'), ASKED)
def test_serves_only_its_own_pages(server, host, origin, is_own):
    headers = {'Host': host.format(server.port)}
    headers |= {} if origin is None else {'Origin': origin.format(server.port)}
    for path, own in PAGES.items():
        more = UPGRADE if path == '/ws' else {}
        asking = HTTPConnection('127.0.0.1', server.port, timeout=60.0)
        asking.request('GET', path, headers=headers | more)
        answer = asking.getresponse()
        assert answer.status == (own if is_own else 403), path
        if path != '/ws':
            policy = answer.headers['Content-Security-Policy']
            assert "frame-ancestors 'none'" in policy and "default-src 'self'" in policy
        asking.close()


def _exchange(port: int, sent: bytes) -> bytes:
    received = b''
    address = ('127.0.0.1', port)
    with socket.create_connection(address, timeout=60.0) as plain, suppress(ConnectionError):
        plain.sendall(sent)
        while more := plain.recv(65536):
            received += more
    return received


@pytest.mark.parametrize('sent', [
    b'GET /' + b'a' * 100_000 + b' HTTP/1.1\r\nHost: localhost\r\n\r\n',
    b'GET / HTTP/1.1\r\n' + b'A: b\r\n' * 1000 + b'\r\n',
    b'POST / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 9\r\n\r\n' + b'x' * 9,
    b'GET / HTTP/1.1\r\nHost: localhost\r\nHost: evil.example\r\n\r\n',
    b'GET / HTTP/1.1\r\n\r\n', b'\0\xff\r\n\r\n',
])
def test_refuses_malformed_requests(server, sent):
    answer = _exchange(server.port, sent)
    assert not answer or answer.split()[1] in (b'400', b'403', b'405', b'414', b'431', b'500')


def test_closes_slow_requests_and_huge_messages(server, frames, monkeypatch):
    visitor = Visitor(server)
    visitor.socket.send(b'x' * (server_module.LIMITS['max_size'] + 1))
    with pytest.raises(ConnectionClosed):
        while True:
            visitor.socket.recv(timeout=60.0)
    visitor.wait(lambda: not visitor.pages)
    monkeypatch.setitem(server_module.LIMITS, 'open_timeout', 0.2)
    with served(frames) as other:
        assert _exchange(other.port, b'GET / HTT') == b''


def test_limits_the_number_of_pages(visitor, monkeypatch):
    monkeypatch.setattr(server_module, 'MAX_PAGES', 1)
    with pytest.raises(InvalidStatus, match='503'):
        Visitor(visitor.server)


def test_a_port_that_is_taken_is_named(frames, server):
    with pytest.raises(LavaError, match=f'--port is {server.port}'):
        server_module.Server(frames, server.port)


def test_reports_when_the_source_fails_and_is_back(frames, capsys):
    levels = iter([Level.WARN, Level.ERROR, Level.ERROR, Level.OK])

    def has_ended(time):
        frames._status = Status(next(levels, None), 'words')
        return frames._status.level is None

    server_module.Server(frames, 0).run(SimpleNamespace(wait=has_ended))
    assert capsys.readouterr().err == 'lava watch: words\n' * 2


@pytest.mark.parametrize('error', [OSError('odd'), RuntimeError('odd')])
def test_updates_continue_after_an_exception(frames, monkeypatch, caplog, error):
    updates, server = [], server_module.Server(frames, 0)
    monkeypatch.setattr(server, 'update', Mock(side_effect=[error, None, None]))
    server.run(SimpleNamespace(wait=lambda _: updates.append(1) or len(updates) > 3))
    assert server.update.call_count == 3
    (record,) = caplog.records
    assert record.message == f'live view: {type(error).__name__}: odd' and record.exc_info


def test_a_long_update_does_not_delay_the_next_one(frames, monkeypatch):
    waits, duration = [], 0.75 * server_module.TICK
    clock = SimpleNamespace(monotonic=count(0.0, duration).__next__)
    monkeypatch.setattr(server_module, 'time', clock)
    ended = SimpleNamespace(wait=lambda time: waits.append(time) or len(waits) > 3)
    server_module.Server(frames, 0).run(ended)
    assert waits[1:] == pytest.approx([server_module.TICK - duration] * 3)


def test_follows_new_frames_only_at_the_end(visitor, page, frames):
    # times, in minutes
    assert page.slider.label == 'Time [min]'
    assert (page.slider.value, page.slider.max) == (800.0 / 60.0, 800.0 / 60.0)
    for number in (5, 1, 5):
        frames.grow(number)
        visitor.wait(lambda last=number - 1: page._drawn[1] == last)
        assert page.slider.value == TIMES[number - 1] / 60.0
    # the newest map at or before the chosen time
    visitor.press(page.slider, 12.0)
    visitor.wait(lambda: '10 min of 17 min' in page.title.content)
    frames.grow(6)
    visitor.wait(lambda: page.slider.max == 20.0)
    assert page._drawn[1] == 2
    del frames.times[1], frames._frames[1]
    frames.version += 1
    visitor.wait(lambda: page._drawn[:2] == (frames.version, 1))
    assert '10 min' in page.title.content
    visitor.press(page.play)
    visitor.wait(lambda: page.slider.value == 20.0 and page._drawn[1] == 4)


def test_offers_the_maps_that_there_are(visitor, page, frames):
    names = ('Lava thickness', 'Hazard index', 'Temperature', 'Arrival')
    assert page.choice.options == names
    frames.grow(6)
    visitor.wait(lambda: page.choice.options == (*names, PROBABLE))
    visitor.press(page.choice, PROBABLE)
    visitor.wait(lambda: '[%]' in page.legend.content)
    frames.frame(5).layers[PROBABILITY].values[:] = np.nan
    frames.version += 1
    visitor.wait(lambda: 'this map is empty at this time' in page.title.content)
    visitor.press(page.slider, 0)
    visitor.wait(lambda: page.choice.options == names)
    visitor.press(page.choice, 'Hazard index')
    visitor.wait(lambda: 'lava has drained away' in page.legend.content)
    visitor.press(page.choice, 'Arrival')
    visitor.wait(lambda: 'Arrival [min]' in page.legend.content)
    visitor.press(page.choice, '<none>')
    visitor.wait(lambda: not drawn(page, '/lava/'))


@pytest.mark.parametrize('control', [True, False])
def test_a_click_shows_values_and_opens_a_vent_with_control(visit, frames, control):
    visitor = visit(frames, control=control)
    page = visitor.page
    visitor.wait(lambda: page.title.content)

    def click(x):
        visitor.say(
            'ScenePointerMessage', event_type='click', ray_origin=(x, 0.0, 5.0),
            ray_direction=(0.0, 0.0, -1.0), screen_pos=((0.5, 0.5),), modifier=None,
        )

    click(-4.9)
    visitor.wait(lambda: '<td>Lava thickness</td><td>3.26 m</td>' in page.values.content)
    assert frames.commands == [(pytest.approx(50.0 - 4.9 * 200.0 / SIDE), 95.0)][:control]
    assert (page.opens is not None) == control
    if control:
        visitor.press(page.opens, False)
    click(4.0)
    visitor.wait(lambda: '<td>Lava thickness</td><td>none</td>' in page.values.content)
    click(400.0)
    visitor.wait(lambda: not page._asked)
    assert len(frames.commands) == control


def test_untrusted_texts_are_escaped(page):
    assert 'no node answers &lt;here&gt;' in page.status.content
    assert '<td>&lt;i&gt;effects&lt;/i&gt;</td><td>frame &lt;3&gt;</td>' in page.facts.content
    # a label is drawn as text; one off the map is left out
    shown = drawn(page, '/labels/').values()
    labels = [item.text for item in shown if hasattr(item, 'text')]
    assert labels == ['▲ open', '<b>hut</b>', '20 m', 'N']


@pytest.mark.filterwarnings('error')
def test_shows_particles_in_place_of_the_lava(visitor, page, frames, monkeypatch):
    lava = drawn(page, '/lava/').keys()
    with monkeypatch.context() as patch:
        patch.setattr(frames, 'particles', Mock(side_effect=LavaError('bag', 'x', 'a bag')))
        visitor.press(page.particles)
        visitor.wait(lambda: 'a bag' in page.status.content)
        assert drawn(page, '/lava/').keys() == lava
    frames.version += 1
    visitor.wait(lambda: '/lava/particles' in drawn(page))
    assert drawn(page)['/lava/particles'].points.shape == (3, 3)
    assert 'Particles at 2 min' in page.legend.content
    visitor.press(page.slider, 10.0)
    visitor.wait(lambda: page._drawn[1] == 2)
    assert list(drawn(page, '/lava/')) == ['/lava/particles']
    visitor.press(page.slider, 0)
    visitor.wait(lambda: 'No particles' in page.legend.content)
    assert not drawn(page, '/lava/')
    assert page.particles.label == 'Particles'
    frames.method = 'cells'
    frames.version += 1
    visitor.wait(lambda: 'No cells with lava' in page.legend.content)
    assert page.particles.label == 'Cells with lava'


def test_the_camera_rises_with_the_ground(visitor, page):
    before = page._client.camera.position.copy()
    visitor.press(page.stretch, 3.0)
    visitor.wait(lambda: drawn(page)['/ground'].scale == (1.0, 1.0, 3.0))
    rise = page._ground.middle * (0.0, 0.0, 2.0)
    assert rise[2] > 0.1
    np.testing.assert_allclose(page._client.camera.position, before + rise)


def test_pages_show_the_same_and_share_the_ground_until_it_changes(visitor, page, frames):
    for number in (6, 2):
        frames.grow(number)
        visitor.wait(lambda last=number - 1: page._drawn[1] == last)
    other = Visitor(visitor.server).page
    visitor.wait(lambda: other.title.content)
    # whatever maps a page has shown before
    lava, same = (drawn(item, '/lava/') for item in (page, other))
    assert lava.keys() == same.keys() and len(lava) > 1
    for name, mesh in lava.items():
        np.testing.assert_array_equal(mesh.vertices, same[name].vertices)
        np.testing.assert_array_equal(mesh.faces, same[name].faces)
    before = page._ground
    assert {item._ground for item in visitor.pages} == {before}
    frames._frames[1] = replace(frames.frame(1), elevation=2.0 * frames.frame(1).elevation)
    frames.version += 1
    visitor.wait(lambda: all(item._ground is not before for item in visitor.pages))
    shown = {drawn(item)['/ground'].glb_data for item in visitor.pages}
    assert shown == {page._ground.mesh} != {before.mesh}


def test_lava_lies_on_the_ground_where_its_cells_are(frames):
    frame = frames.frame(3)
    ground, thickness = Ground(frame, ground_picture(frame)), frame.layers['thickness'].values
    ground.fit(frame, frame.lava)
    mesh, blocks = ground.mesh, ground.blocks(thickness[ground.part])
    ground.fit(frame, frame.lava)
    assert ground.mesh is mesh
    colours = np.where(np.isfinite(blocks)[..., None], [1, 2, 3, 255], 0).astype(np.uint8)
    (colour, points, faces), = ground.lava(colours, blocks)
    assert colour == (1, 2, 3, 255)
    assert len(faces) == 2 * np.isfinite(thickness).sum()
    corner = ground.placed(np.array([[-50.0, 70.0]]))[0]
    np.testing.assert_allclose(points[:, :2].min(axis=0), corner[:2], atol=1e-5)
    inner = points[np.argmin(np.hypot(*(points[:, :2] - corner[:2] - 2.0 * ground.cell).T))]
    # below the corner between four cells: their mean, and the mean of their lava
    rows, columns = np.s_[11:13], np.s_[1:3]
    z = TERRAIN.elevation[rows, columns].mean() + growing(800.0)[rows, columns].mean()
    assert inner[2] * TERRAIN.resolution / ground.cell == pytest.approx(z - 3.0, abs=1e-3)


def test_a_large_ground_is_sent_coarse_away_from_the_lava(frames, monkeypatch):
    rough = np.random.default_rng(1).uniform(0.0, 50.0, TERRAIN.shape).astype(np.float32)
    frame = replace(frames.frame(3), elevation=rough)
    monkeypatch.setattr(surface, 'MIN_MARGIN', 1)
    north_is_white = np.where(np.arange(30) < 15, 0, 255).astype(np.uint8)
    sizes = []
    for most, coarse in ((10**6, 10**6), (10**6, 10), (60, 10)):
        monkeypatch.setattr(surface, 'MAX_CORNERS', most)
        monkeypatch.setattr(surface, 'COARSE', coarse)
        ground = Ground(frame, np.tile(north_is_white[:, None, None], (1, 40, 3)))
        ground.fit(frame, frame.lava)
        mesh = trimesh.load(BytesIO(ground.mesh), 'glb', force='mesh', process=False)
        np.testing.assert_allclose(mesh.extents[:2], [SIDE, 0.75 * SIDE], rtol=1e-6)
        # neither gaps nor overlaps
        flat = mesh.vertices * (1.0, 1.0, 0.0)
        np.testing.assert_allclose(trimesh.Trimesh(flat, mesh.faces).area, 0.75 * SIDE**2)
        sizes.append(len(mesh.vertices))
        columns, z = ground._small[1], ground._small_z[-1]
        corners = np.isin(columns, [*range(0, 40, max(40 // coarse, 1)), 40])
        np.testing.assert_allclose(z, np.interp(columns, columns[corners], z[corners]))
        # a texture begins at the top, its coordinates in trimesh at the bottom
        image, is_north = mesh.visual.material.baseColorTexture, mesh.vertices[:, 1] > 0.1
        assert image.getpixel((20, 0)) > (250,) * 3 and image.getpixel((20, 29)) < (5,) * 3
        assert (mesh.visual.uv[is_north, 1] > 0.5).all()
    assert sizes[0] >= 31 * 41 > sizes[1] > sizes[2]


@pytest.mark.parametrize('kind', ['whole terrain', 'world file', 'other system'])
def test_drapes_a_picture_with_north_at_the_top(frames, tmp_path, kind):
    """A georeferenced picture covers the west; the rest keeps its relief."""
    frame, (west, south) = frames.frame(3), TERRAIN.corner
    red, blue, path = (200, 40, 10), (0, 0, 255), tmp_path / 'picture.png'
    picture = np.repeat(np.array([[red]] * 15 + [[blue]] * 15, np.uint8), 20, axis=1)
    Image.fromarray(picture).quantize(2).save(path)
    if kind == 'world file':
        path.with_suffix('.pgw').write_text(f'5\n0\n0\n-5\n{west + 2.5}\n{south + 147.5}\n')
    if kind == 'other system':
        path = tmp_path / 'picture.tif'
        bounds = west, south, west + 100.0, south + 150.0
        place = from_bounds(*transform_bounds('EPSG:32633', 'EPSG:4326', *bounds), 20, 30)
        options = {'width': 20, 'height': 30, 'count': 3, 'dtype': 'uint8', 'transform': place}
        with rasterio.open(path, 'w', crs='EPSG:4326', **options) as file:
            file.write(np.moveaxis(picture, -1, 0))
    colours = ground_picture(frame, read_placed_picture(str(path), field='--drape'))
    # the pixels are smaller than the cells
    assert colours.shape == (1200, 1600, 3)
    assert (colours[680:1120, 80:720] == red).all() and (colours[80:520, 80:720] == blue).all()
    if kind == 'whole terrain':
        assert (colours[680:1120, 880:1520] == red).all()
    else:
        relief = ground_picture(frame)[:, 22:]
        np.testing.assert_allclose(colours[20::40, 900::40], relief, atol=8)


def test_a_picture_that_cannot_be_read_is_named(tmp_path):
    Image.new('I;16', (20, 30)).save(tmp_path / 'deep.png')
    for name in ('none.png', 'deep.png'):
        with pytest.raises(LavaError, match=f'--drape is .*{name}'):
            read_placed_picture(str(tmp_path / name), field='--drape')


def test_a_bag_that_grows(tmp_path, monkeypatch):
    monkeypatch.setattr('lava_ros.watch.frames.PERIOD', 0.0)
    monkeypatch.setattr('lava_ros.watch.frames.REST', 0.0)
    whole = record(tmp_path / 'whole', close=False)
    part = record(tmp_path / 'part', [200.0, 400.0], close=False)
    (path,), (source,) = part.glob('*.mcap'), whole.glob('*.mcap')
    frames = BagFrames(part)
    frames.poll()
    assert frames.times == [200.0, 400.0]
    version = frames.version
    frames.poll()
    assert frames.version == version
    path.write_bytes(source.read_bytes())
    frames.poll()
    assert frames.times == [200.0, 400.0, 600.0, 800.0]
    assert frames.status.level is Level.OK
    seen, expected = frames.frame(1), Recording(whole).frame_at(400.0)
    assert seen.time == 400.0 and frames.facts(1)['simulated_time_s'] == '400.0'
    assert not len(frames.particles(1).values)
    checkpoint = small_checkpoint(400.0, 5)
    monkeypatch.setattr('lava_ros.watch.frames.checkpoint_at', lambda path, time: checkpoint)
    # the origin of particles is the centre of the terrain, which is 4 m x 3 m
    placed = checkpoint.arrays['state.particle'][:, [0, 1, 3]] + [2.0, 1.5, -273.15]
    np.testing.assert_allclose(frames.particles(1).values, placed, rtol=1e-5)
    assert frames.particles(1).time == checkpoint.time
    for source_name, item in expected.layers.items():
        np.testing.assert_array_equal(seen.layers[source_name].values, item.values)
    np.testing.assert_array_equal(seen.elevation, TERRAIN.elevation.astype(np.float32))
    path.unlink()
    frames.poll()
    assert frames.status.level is Level.WARN


def test_a_bag_without_diagnostics_shows_every_map(visit, tmp_path):
    bag = record(tmp_path / 'bag', TIMES, clock=False)
    frames = BagFrames(bag)
    visitor = visit(frames)
    page = visitor.page
    visitor.wait(lambda: page.title.content)
    # two seconds of ROS time apart
    assert frames.times == [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]
    expected = list(Recording(bag).frames())
    assert len(expected) == 6
    for index, frame in enumerate(expected):
        shown = frames.frame(index).layers['thickness'].values
        np.testing.assert_array_equal(shown, frame.layers['thickness'].values)
    assert page.slider.label == 'Recorded [s]' and page.slider.value == 10.0
    assert 'after 10 s of 10 s of the recording' in page.title.content
    visitor.press(page.slider, 4.0)
    visitor.wait(lambda: 'after 4 s of 10 s of the recording' in page.title.content)


def test_page_has_warning_scale_north_and_date(visit, tmp_path):
    frames = BagFrames(
        record(tmp_path / 'bag', TIMES, custom_data={'onset': '2006-07-14T22:00:00Z'})
    )
    page = visit(frames).page
    assert 'SIMULATION, NOT VERIFIED' in page.title.content
    assert '2006-07-14 22:20 UTC' in page.title.content
    texts = {item.text: item.position for item in drawn(page, '/labels/').values()
             if hasattr(item, 'text')}
    bar, north = texts['20 m'], texts['N']
    lines = [item for name, item in drawn(page, '/labels/').items() if name.endswith('/north')]
    assert len(lines) == 1
    # the text of the scale is 20 m east of the corner at which the arrow begins
    start = lines[0].points[0, 0]
    cells = SIDE / max(TERRAIN.shape) / TERRAIN.resolution
    assert bar[0] - start[0] == pytest.approx(20.0 * cells, rel=1e-3)
    assert north[1] - start[1] == pytest.approx(20.0 * cells, rel=1e-3)
    assert abs(north[0] - start[0]) < 1e-5


def test_a_click_shows_coordinates(visit, frames):
    page = visit(frames).page
    known = {'terrain': {'epsg': 32633, 'offset': (500_000.0, 4_180_000.0)}}
    rows = _coordinates(np.array([20.0, 95.0]), known)
    assert rows['Easting, northing'] == '500020 m, 4180095 m'
    longitude, latitude = (
        float(item.strip(' °')) for item in rows['Longitude, latitude'].split(',')
    )
    assert longitude == pytest.approx(15.0002, abs=1e-4) and 37.7 < latitude < 37.8
    assert _coordinates(np.array([20.0, 95.0]), {}) == {'x, y': '20 m, 95 m'}
    assert page.values.content


def test_a_bag_without_maps_waits(visit, tmp_path):
    frames = BagFrames(record(tmp_path / 'bag', []))
    visitor = visit(frames)
    visitor.wait(lambda: 'before its first map' in visitor.page.status.content)
    assert frames.status.level is Level.WARN and frames.times == []


def test_an_ensemble_is_one_frame(visit, frames, monkeypatch):
    frame = replace(frames.frame(5), arrived=None, time=None)
    values = frame.layers[PROBABILITY].values
    panels = {PROBABILITY: Panel(frame, 'probability', values, '')}
    run = SimpleNamespace(
        panels=panels, title='3 runs', summary='all', facts={'runs': '3'}, onset=None
    )
    monkeypatch.setattr('lava_ros.watch.frames.read_run', lambda path, node: run)
    visitor = visit(ensemble_frames('folder'))
    visitor.wait(lambda: '<td>runs</td><td>3</td>' in visitor.page.facts.content)
    assert '<b>3 runs</b><br>all' in visitor.page.title.content
    assert visitor.page.choice.options == (PROBABLE,)
    assert visitor.page.slider.disabled


def test_watches_one_layer_for_each_map():
    found = {item.source: item.name for item in watched_layers()}
    assert found['thickness'] == 'height_raw' and found['arrival'] == 'arrival_time'
    assert {ARRIVED, PROBABILITY, 'hazard'} <= set(found)
