# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The live view without a browser: what is served, and what the page holds as frames come."""

from http.client import HTTPConnection
import socket
from socket import gethostname
import sys
import time
from unittest.mock import Mock
from urllib.parse import urlsplit
from urllib.request import urlopen

import numpy as np
import pytest

pytest.importorskip('bokeh')
from bokeh.client import pull_session
from bokeh.models import Slider
from bokeh.util.token import generate_session_id

from cli.calls import refused
from lava_ros.errors import LavaError
from lava_ros.maps.frames import Recording
from lava_ros.maps.layers import ARRIVED, PROBABILITY
from lava_ros.watch import page
from lava_ros.watch.frames import BagFrames, Level, watched_layers
from lava_ros.watch.hosts import own_hosts
from lava_ros.watch.page import Page, serve
from recording import record, TERRAIN
from watch_page import Growing, served


@pytest.fixture
def frames(tmp_path):
    """Four of six frames."""
    return Growing(tmp_path, 4)


@pytest.fixture
def shown(frames):
    """A page that has been told of the first frames."""
    result = Page(frames)
    result.update()
    return result


def test_a_document_is_served_and_changes(frames):
    """Who asks gets a page of this server alone, and what it shows grows with the run."""
    with served(frames) as address:
        with urlopen(address) as answer:
            text = answer.read().decode()
        assert '<title>lava watch</title>' in text
        assert 'src="http' not in text
        session = generate_session_id()
        assert _slider(address, session) == (3, 3)
        frames.grow(6)
        end = time.monotonic() + 60.0
        while _slider(address, session) != (5, 5):
            assert time.monotonic() < end
            time.sleep(0.2)


def own(port: int, name: str = '127.0.0.1') -> str:
    """The host of a server on this machine."""
    return f'{name}:{port}'


#: Requests to a server: expected status, ``Host``, and the page that makes the request or None.
ASKED = {
    'own address': (200, own, None),
    'own name': (200, lambda port: own(port, 'LocalHost'), None),
    'own page': (200, own, lambda port: f'http://{own(port)}'),
    'another host': (403, lambda port: own(port, 'evil.example'), None),
    'another host and its page': (
        403, lambda port: own(port, 'evil.example'), lambda port: f'http://evil.example:{port}'
    ),
    'a page of another site': (403, own, lambda port: 'http://evil.example'),
    'a page of nowhere': (403, own, lambda port: 'null'),
    'another address': (403, lambda port: own(port, '203.0.113.1'), None),
    'another port': (403, lambda port: '127.0.0.1:1', None),
    'no port': (403, lambda port: '127.0.0.1', None),
    'no number': (403, lambda port: 'localhost:here', None),
    'a longer name': (403, lambda port: own(port, 'localhost.evil.example'), None),
}


@pytest.fixture(scope='module')
def server(tmp_path_factory):
    """The port of a page that stays the same."""
    with served(Growing(tmp_path_factory.mktemp('served'), 4)) as address:
        yield urlsplit(address).port


@pytest.mark.parametrize('who', ASKED)
@pytest.mark.parametrize('path', ['/', '/static/js/bokeh.min.js', '/autoload.js', '/ws', '/none'])
def test_others_are_refused(server, who, path):
    """Pages, files and WebSockets alike, by the host that is asked and the page that asks."""
    expected, host, origin = ASKED[who]
    headers = {'Host': host(server)}
    if origin is not None:
        headers['Origin'] = origin(server)
    if path == '/ws':
        headers |= {'Upgrade': 'websocket', 'Connection': 'Upgrade'}
        headers |= {'Sec-WebSocket-Version': '13', 'Sec-WebSocket-Key': 'bGF2YSBpcyBob3QgISEhIQ=='}
    asking = HTTPConnection('127.0.0.1', server, timeout=30.0)
    asking.request('GET', path, headers=headers)
    status = asking.getresponse().status
    asking.close()
    if expected == 403:
        assert status == 403
    else:
        # of its own, the server has these
        assert status == {'/ws': 101, '/autoload.js': 400, '/none': 404}.get(path, 200)


@pytest.mark.parametrize(
    ('address', 'bound', 'accepted', 'refused_hosts'),
    [
        ('127.0.0.1', ['127.0.0.1'], ['127.0.0.1:50', '[::1]:50'],
         ['lava:50', '10.0.0.1:50', 'a@127.0.0.1:50']),
        ('localhost', ['127.0.0.1', '::1'], ['localhost:50', '[::1]:50'], ['[::2]:50']),
        ('10.0.0.1', ['10.0.0.1'], ['10.0.0.1:50'], ['localhost:50', '10.0.0.1', '10.0.0.2:50']),
        ('robot1', ['10.0.0.1'], ['robot1:50', '10.0.0.1:50'], ['evil.example:50']),
        ('0.0.0.0', ['0.0.0.0'], ['10.0.0.9:50', f'{gethostname()}:50', 'localhost:50'],
         ['evil.example:50', '10.0.0.9:51', '10.0.0.9.evil.example:50']),
        ('::', ['::'], ['[fe80::1]:50', '10.0.0.9:50'], ['evil.example:50', 'fe80::1:50', '']),
    ],
)
def test_hosts_of_an_address(address, bound, accepted, refused_hosts):
    """A server of every network is asked for by any IP address, and by no other site's name."""
    sockets = [Mock(getsockname=lambda name=name: (name, 50)) for name in bound]
    is_own = own_hosts(address, sockets)
    assert all(is_own(host.lower()) for host in accepted)
    assert not any(is_own(host) for host in refused_hosts)


def _slider(address: str, session: str) -> tuple[int, int]:
    """Value and end of the slider in a session's document, as it is on the server."""
    pulled = pull_session(session, address)
    try:
        slider = pulled.document.select_one({'type': Slider})
        return (slider.value, slider.end)
    finally:
        pulled.close()


def test_maps_of_the_page(shown, frames):
    """The map is that of the newest frame at its place; of an earlier time, that one's."""
    # what a status quotes is no markup
    assert 'no node answers &lt;here&gt;' in shown.status.text
    # and $$ in it begins no formula
    assert shown.status.disable_math and shown.title.disable_math
    (image,) = shown.map.data['image']
    np.testing.assert_array_equal(image, frames.frame(3).layers['thickness'].values)
    place = [shown.map.data[name] for name in ('x', 'y', 'dw', 'dh')]
    assert place == [[-50.0], [20.0], [200.0], [150.0]]
    shown.slider.value = 1
    (image,) = shown.map.data['image']
    np.testing.assert_array_equal(image, frames.frame(1).layers['thickness'].values)
    shown.choice.active = shown.choice.labels.index('Arrival')
    (image,) = shown.map.data['image']
    # in minutes
    np.testing.assert_allclose(image[15, :4], np.arange(1, 5) * 100 / 60, rtol=1e-6)


def test_the_slider_follows_only_at_its_end(shown, frames):
    """Who looks at an earlier time goes on seeing it, also when frames before it are left out."""
    frames.grow(5)
    shown.update()
    assert shown.slider.value == 4
    shown.slider.value = 2
    frames.grow(6)
    shown.update()
    assert (shown.slider.value, shown.slider.end) == (2, 5)
    del frames.times[1], frames._frames[1]
    frames.version += 1
    shown.update()
    assert (shown.slider.value, shown.slider.end) == (1, 4)
    assert '10 min' in shown.title.text


def test_probabilities_are_offered_while_there_are_some(shown, frames):
    """Another button comes with them; the map that was chosen stays."""
    names = ['Lava thickness', 'Hazard', 'Temperature', 'Arrival']
    assert shown.choice.labels == names
    shown.choice.active = 1
    frames.grow(6)
    shown.update()
    assert shown.choice.labels == [*names, 'Probability']
    shown.choice.active = 4
    assert shown.map.data['image'][0][15, 0] == pytest.approx(32.6)
    assert 'nothing on this map' not in shown.title.text
    frames.frame(5).layers[PROBABILITY].values[:] = np.nan
    frames.version += 1
    shown.update()
    assert 'nothing on this map now' in shown.title.text
    shown.slider.value = 0
    assert (shown.choice.labels, shown.choice.active) == (names, 0)


def test_large_maps_are_sent_coarse(frames, monkeypatch):
    """Cells are put together to their largest value, and cover the same ground."""
    monkeypatch.setattr(page, 'MOST_CELLS', 300)
    shown = Page(frames)
    shown.update()
    (image,), (relief,) = shown.map.data['image'], shown.relief.data['image']
    assert image.shape == relief.shape == (15, 20)
    assert image[5, 0] == np.float32(3.26)
    assert (shown.map.data['dw'], shown.map.data['dh']) == ([200.0], [150.0])


def test_a_bag_that_grows(tmp_path, monkeypatch):
    """The frames of a bag are those there are by now, whatever reads them."""
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
    assert frames.status.level is Level.WELL
    seen, expected = frames.frame(1), Recording(whole).frame_at(400.0)
    assert seen.time == 400.0
    for source_name, item in expected.layers.items():
        np.testing.assert_array_equal(seen.layers[source_name].values, item.values)
    np.testing.assert_array_equal(seen.elevation, TERRAIN.elevation.astype(np.float32))


def test_a_bag_without_maps_waits(tmp_path):
    """It may have just begun: the page says what is missing."""
    bag = record(tmp_path / 'bag', [])
    frames = BagFrames(bag)
    frames.poll()
    assert frames.status.level is Level.WAITING
    assert 'layers of a simulation' in frames.status.words
    assert frames.times == []
    shown = Page(frames)
    shown.update()
    assert 'layers of a simulation' in shown.status.text


def test_what_is_watched():
    """One layer for each map: the thickness that is not rounded."""
    found = {item.source: item.name for item in watched_layers()}
    assert found['thickness'] == 'height_raw'
    assert {ARRIVED, PROBABILITY, 'hazard', 'arrival'} <= set(found)
    assert found['arrival'] == 'arrival_time'


def test_a_port_that_is_taken(frames):
    """It is named, and nothing is served."""
    with socket.socket() as taken:
        taken.bind(('127.0.0.1', 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(LavaError, match=f'--port is {port}'):
            serve(frames, '127.0.0.1', port)
    for address in ('203.0.113.1', '', 'x' * 300, '\0'):
        with pytest.raises(LavaError, match='--address'):
            serve(frames, address, 0)


def test_without_bokeh(monkeypatch):
    """The error says how to get it."""
    monkeypatch.setitem(sys.modules, 'bokeh', None)
    assert "pip install 'lava_ros[watch]'" in refused('watch')
