# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The reader process: no network, no other files, limits, and its end."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
import ctypes
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
import os
from pathlib import Path
import re
import struct
import subprocess
import sys
import threading
from typing import Any

import numpy as np
import pytest

from files.references import FORMS, write_other
from files.test_rasters import GROUND, virtual_raster, write_format, write_ground
from lava_ros.errors import LavaError
from lava_ros.files.raster_formats import FORMATS, PICTURES
from lava_ros.files.rasters import read_raster
from lava_ros.files.reader import client
from lava_ros.processes import child
from lava_ros.scene.features import load_features
from lava_ros.scene.terrain_files import load_terrain
from project import MODULES

#: Event of inotify: a file was opened.
IN_OPEN, IN_ISDIR = 0x20, 0x40000000


@contextmanager
def opened_names(*folders: Path) -> Iterator[list[str]]:
    """Collect the names of the files that any process opens in folders."""
    libc = ctypes.CDLL(None, use_errno=True)
    descriptor = libc.inotify_init1(os.O_NONBLOCK)
    for folder in folders:
        assert libc.inotify_add_watch(descriptor, os.fsencode(folder), IN_OPEN) >= 0
    found: list[str] = []
    yield found
    with suppress(BlockingIOError):
        while data := os.read(descriptor, 1 << 16):
            while data:
                _, mask, _, length = struct.unpack_from('iIII', data)
                name = data[16 : 16 + length].rstrip(b'\0').decode()
                found.extend([name] if not mask & IN_ISDIR else [])
                data = data[16 + length :]
    os.close(descriptor)


@pytest.fixture(scope='module')
def server() -> Iterator[Any]:
    """Run an HTTP server that lists its requests."""
    requests: list[str] = []

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            requests.append(self.path)
            self.send_error(404)

        do_HEAD = do_GET  # noqa: N815

        def log_message(self, *_: object) -> None:
            pass

    with ThreadingHTTPServer(('127.0.0.1', 0), Handler) as running:
        running.requests = requests  # type: ignore[attr-defined]
        threading.Thread(target=running.serve_forever, daemon=True).start()
        yield running
        running.shutdown()


@pytest.fixture
def reader_code(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], None]]:
    """Return a function that sets what the next reader executes first."""

    def end() -> None:
        while client._readers:
            client._readers.pop().end()

    def set_code(text: str) -> None:
        mark = 'from {module}'
        assert mark in child._CODE
        text = text if text.endswith('\n') else f'{text}; '
        monkeypatch.setattr(child, '_CODE', child._CODE.replace(mark, text + mark))

    end()
    yield set_code
    end()


def read(path: Path) -> Any:
    """Read a file as a command would read it."""
    suffixes = {suffix for item in FORMATS for suffix in item.suffixes} - {'.gpkg', '.txt'}
    if path.suffix == '.png':
        return read_raster('picture', path, PICTURES, max_bands=4)
    if path.suffix in (*suffixes, '.npz') or path.name == 'ground.gpkg':
        return load_terrain(path)
    return load_features('--places', path)


@pytest.mark.parametrize('name', FORMS)
def test_reader_follows_no_reference(tmp_path, name, server):
    folder, other = tmp_path / 'folder', tmp_path / 'other'
    folder.mkdir()
    write_other(other)
    target, form = FORMS[name]
    places = {'{port}': str(server.server_port), '{other}': str(other)}
    for mark, text in places.items():
        target = target.replace(mark, text)
    path = form(folder, target)
    server.requests.clear()
    with opened_names(folder, other) as found, suppress(LavaError):
        read(path)
    assert not server.requests
    # the mosaics have one tile in their folder
    own = {item.name for item in folder.iterdir() if item.stem == path.stem}
    own |= {f'{path.name}.aux.xml', f'{path.name}.msk'}
    own |= {'tile.tif', 'source.tif'} if path.suffix == '.vrt' else set()
    assert path.name in found and set(found) <= own, found


def test_two_files_have_one_reader(tmp_path):
    path = write_ground(tmp_path / 'a.tif')
    readers = []
    for _ in range(2):
        np.testing.assert_array_equal(read_raster('a', path).values[0], GROUND)
        readers.append(client._readers[0].pid)
    assert readers[0] == readers[1]


def test_threads_share_the_reader(tmp_path):
    path, found = write_ground(tmp_path / 'a.tif'), []

    def work() -> None:
        found.extend(float(read_raster('a', path).values.sum()) for _ in range(5))

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == [float(GROUND.sum())] * 20


def _mosaic(folder: Path, cells: int, count: int) -> Path:
    """Write a mosaic of many sources that overlap."""
    write_ground(folder / 'tile.tif')
    head, source, tail = virtual_raster('tile.tif').partition('<SimpleSource>')[0], '', ''
    head = head.replace('rasterXSize="30" rasterYSize="40"',
                        f'rasterXSize="{cells}" rasterYSize="{cells}"')
    source = (
        '<ComplexSource resampling="cubic"><SourceFilename relativeToVRT="1">tile.tif'
        '</SourceFilename><SrcRect xOff="0" yOff="0" xSize="30" ySize="40"/>'
        f'<DstRect xOff="0" yOff="0" xSize="{cells}" ySize="{cells}"/></ComplexSource>'
    )
    tail = '</VRTRasterBand></VRTDataset>'
    (folder / 'a.vrt').write_text(head + count * source + tail)
    return folder / 'a.vrt'


@pytest.mark.parametrize(('limit', 'name', 'text'), [
    ('CPU_TIME = 2', 'a.vrt', 's of CPU time'), ('MEMORY = 1 << 28', 'a.tif', 'GiB of memory'),
])
def test_reader_that_reaches_a_limit_ends_in_one_sentence(
    tmp_path, reader_code, limit, name, text
):
    reader_code(f'import lava_ros.files.reader.confinement as limits; limits.{limit}')
    _mosaic(tmp_path, 10_000, 3000)
    write_raster_of_zeros(tmp_path / 'a.tif')
    with pytest.raises(LavaError, match=text) as caught:
        load_terrain(tmp_path / name)
    assert '\n' not in str(caught.value) and str(tmp_path / name) in str(caught.value)
    # the next file has a new reader
    assert load_terrain(tmp_path / 'tile.tif').shape == GROUND.shape


@pytest.mark.parametrize(('fault', 'text'), [
    ('import nothing', "ended with status 1. Run 'lava check install'"),
    ('os._exit(3)', "ended with status 3. Run 'lava check install'"),
    ('signal.raise_signal(9)', 'GiB of memory'), ('os.abort()', 'GiB of memory'),
    ('signal.raise_signal(signal.SIGXCPU)', 's of CPU time'),
    ('signal.raise_signal(11)', 'an undamaged file: its reader ended with signal 11'),
])
def test_reader_that_ends_is_described(tmp_path, reader_code, fault, text):
    path = write_ground(tmp_path / 'a.tif')
    reader_code(
        'import os, signal, lava_ros.files.reader.rasters as rasters\n'
        f'def prepare():\n  {fault}\n'
        'rasters.prepare = prepare\n'
    )
    with pytest.raises(LavaError, match=re.escape(text)):
        load_terrain(path)


def write_raster_of_zeros(path: Path) -> None:
    """Write a small file with 10,000 x 10,000 cells."""
    import rasterio

    with rasterio.open(path, 'w', driver='GTiff', width=10_000, height=10_000, count=1,
                       dtype='float64', compress='deflate', sparse_ok=True):
        pass


@pytest.mark.skipif(not sys.platform.startswith('linux'), reason='a system call filter of Linux')
def test_reader_has_no_sockets_programs_or_files():
    code = (
        'import os, socket\n'
        'from lava_ros.files.reader.confinement import deny_network_and_programs, limited\n'
        'print(deny_network_and_programs())\n'
        'def tried(action):\n'
        '    try: action()\n'
        '    except OSError as error: print(error.strerror)\n'
        'tried(socket.socket)\n'
        'tried(lambda: os.execv("/bin/true", ["true"]))\n'
        'tried(lambda: os.kill(os.getppid(), 0))\n'
        'with limited(0): tried(lambda: os.open("/dev/null", os.O_RDONLY))\n'
    )
    run = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert run.stdout.splitlines() == ['True', *['Permission denied'] * 3, 'Too many open files']


@pytest.mark.parametrize(('limit', 'is_reached'), [
    ('nullcontext()', True), ('limited(0)', False), ('filtered()', False),
])
@pytest.mark.parametrize('place', ['/vsicurl/http://127.0.0.1:{port}/a.tif', '{folder}/a.tif'])
def test_limits_deny_addresses_and_files(tmp_path, server, limit, is_reached, place):
    write_ground(tmp_path / 'a.tif')
    place = place.format(port=server.server_port, folder=tmp_path)
    code = (
        'from contextlib import nullcontext\n'
        'import rasterio\n'
        'from lava_ros.files.reader.confinement import deny_network_and_programs, limited\n'
        'def filtered():\n'
        '    assert deny_network_and_programs()\n'
        '    return nullcontext()\n'
        f'with {limit}:\n'
        f'    try: rasterio.open({place!r})\n'
        '    except rasterio.errors.RasterioIOError: pass\n'
    )
    server.requests.clear()
    with opened_names(tmp_path) as found:
        subprocess.run([sys.executable, '-c', code], check=True)
    # the filter allows files
    is_address = 'http' in place
    assert bool(server.requests) == (is_address and is_reached)
    assert ('a.tif' in found) == (not is_address and limit != 'limited(0)')


def test_binary_grid_has_its_parts(tmp_path):
    path = write_format(tmp_path, 'ESRI binary grid')
    with opened_names(tmp_path) as found:
        load_terrain(path)
    assert {'ground.flt', 'ground.hdr', 'ground.prj'} <= set(found)


def test_only_the_reader_opens_files_with_gdal():
    opens = re.compile(
        r'rasterio\.open\(|GDALOpenEx\(|list_layers\(|read_info\(|raw\.read\((?!text\.encode)'
    )
    found = {
        name for name, path in MODULES.items() if opens.search(path.read_text(encoding='utf-8'))
    }
    assert found == {'lava_ros.files.reader.dataset', 'lava_ros.files.reader.vectors'}
