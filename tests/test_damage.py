# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Damaged bags: every command reports the damage, and shows or saves the rest."""

from collections.abc import Callable, Iterator
import datetime
import os
from pathlib import Path
import random
import re
import shutil
from typing import Any
from unittest.mock import Mock

from mcap.opcode import Opcode
import pytest
import rasterio

from command_line import lava, parser_of
from lava_ros.bag import BagReader, BagWriter
from lava_ros.bag.checkpoints import attachments_in, checkpoints_of, NAME, newest_checkpoint
from lava_ros.bag.records import FRAME, MAGIC
from lava_ros.bag.replay import schedule
from lava_ros.cli.parser import COMMANDS
from lava_ros.errors import LavaError
from lava_ros.simulation.output.checkpoint import MEDIA_TYPE
from recording import record
from small_checkpoint import small_checkpoint

#: The file that describes a bag.
YAML = 'metadata.yaml'

TIMES = (200.0, 400.0, 600.0, 800.0)


@pytest.fixture(scope='module')
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Record a finished bag of four frames with a chunk and a checkpoint each."""
    directory = tmp_path_factory.mktemp('sound')
    source = BagReader(record(directory / 'source', TIMES))
    times = iter(TIMES)
    with BagWriter(directory / 'bag', custom_data=source.custom_data) as writer:
        for item in source.messages():
            topic = source.topics[item.topic]
            writer.write(item.topic, topic.message_type, item.data, item.stamp_ns, qos=topic.qos)
            if item.topic == '/diagnostics':
                time = next(times)
                data = small_checkpoint(time, int(time) // 100).to_bytes()
                writer.attach(NAME, MEDIA_TYPE, data, item.stamp_ns)
                writer.flush()
    return directory / 'bag'


@pytest.fixture
def bag(sound: Path, tmp_path: Path) -> Path:
    """Copy the bag, to be damaged."""
    return Path(shutil.copytree(sound, tmp_path / 'bag'))


def records(path: Path) -> Iterator[tuple[int, int, int]]:
    """Yield the opcode, start and end of each record of a file."""
    data, place = path.read_bytes(), len(MAGIC)
    while place < len(data) - len(MAGIC):
        opcode, length = FRAME.unpack_from(data, place)
        yield opcode, place, place + FRAME.size + length
        place += FRAME.size + length


def places_of(path: Path, opcode: Opcode) -> list[int]:
    """Return the offsets of the records with an opcode."""
    return [place for kind, place, _ in records(path) if kind == opcode]


def flip(path: Path, place: int, bit: int) -> None:
    data = bytearray(path.read_bytes())
    data[place] ^= 1 << bit
    path.write_bytes(data)


def contents(bag: Path) -> object:
    """Return everything in a bag that a recovery must keep."""
    reader = BagReader(bag)
    attachments = [item for path in reader.files for item in attachments_in(path)]
    data = [(item.name, item.log_time_ns, item.read()) for item in attachments]
    return list(reader.messages()), reader.topics, reader.custom_data, data


def test_lost_chunk_is_reported(bag: Path, tmp_path: Path) -> None:
    path = bag / 'bag_0.mcap'
    flip(path, places_of(path, Opcode.CHUNK)[-1], 4)
    status, _, report = lava('export', bag, '-o', tmp_path / 'out')
    assert status == 1
    assert f'of {path} (after 4.500 s of its messages)' in report
    with rasterio.open(tmp_path / 'out/thickness.tif') as file:
        assert file.tags()['simulated_time_s'] == '600.0'
    status, out, report = lava('bag', 'info', bag)
    assert (status, 'finished; damaged (warnings: 2)' in out) == (1, True)
    assert 'is damaged' in report and 'are missing: ' in report
    before = len(list(BagReader(bag).messages()))
    assert BagReader(bag).message_count == before
    status, out, _ = lava('bag', 'recover', bag, '-o', tmp_path / 'new')
    assert (status, 'the bag was damaged (warnings: 2)' in out) == (1, True)
    assert BagReader(tmp_path / 'new').message_count == before > 0
    assert BagReader(tmp_path / 'new').damage == ()
    assert [item.time for item in checkpoints_of(tmp_path / 'new')] == list(TIMES)


CUTS = (0, 1000)
CHUNK, METADATA = 'is damaged', 'a metadata record is damaged'
INDEX, OUTSIDE = 'the index at the end of', 'the data outside of chunks and attachments'


@pytest.mark.parametrize(('opcode', 'offset', 'bit', 'report', 'cut'), [
    *((Opcode.CHUNK, offset, 3, CHUNK, cut) for offset in (0, 2, 100) for cut in CUTS),
    *((Opcode.METADATA, FRAME.size + 60, 7, METADATA, cut) for cut in CUTS),
    (Opcode.STATISTICS, FRAME.size, 0, INDEX, 0),
    (Opcode.FOOTER, FRAME.size + 1, 0, INDEX, 0),
    (Opcode.DATA_END, FRAME.size, 0, OUTSIDE, 0),
    (Opcode.MESSAGE_INDEX, FRAME.size + 8, 0, OUTSIDE, 0),
])
def test_only_messages_of_a_damaged_chunk_are_lost(
    bag: Path, opcode: Opcode, offset: int, bit: int, report: str, cut: int
) -> None:
    path = bag / 'bag_0.mcap'
    whole, is_chunk = list(BagReader(bag).messages()), opcode is Opcode.CHUNK
    flip(path, places_of(path, opcode)[int(is_chunk)] + offset, bit)
    os.truncate(path, path.stat().st_size - cut)
    reader = BagReader(path)
    left = list(reader.messages())
    assert reader.recovered == bool(cut)
    (damage,) = reader.damage
    assert report in damage
    lost = [item for item in whole if item not in left]
    assert len(left) + len(lost) == len(whole)
    assert len({item.stamp_ns for item in lost}) == 2 * is_chunk
    assert not is_chunk or {item.topic for item in lost} >= {'/hazard', '/height', '/diagnostics'}


def test_changed_metadata_yaml_is_reported(bag: Path) -> None:
    path = bag / YAML
    path.write_text(path.read_text().replace('500000.0', '500001.0'))
    (damage,) = BagReader(bag).damage
    assert 'metadata.yaml is damaged or changed' in damage


@pytest.mark.parametrize('is_cut', [False, True])
@pytest.mark.parametrize('part', ['opcode', 'length', 'name', 'media type', 'magic', 'time'])
def test_damaged_checkpoint_is_replaced_by_the_previous_one(
    bag: Path, part: str, is_cut: bool
) -> None:
    path = bag / 'bag_0.mcap'
    place = places_of(path, Opcode.ATTACHMENT)[-1]
    content = place + FRAME.size
    data = content + 20 + len(NAME) + 4 + len(MEDIA_TYPE) + 8
    at = {
        'opcode': place, 'length': place + 1, 'name': content + 20,
        'media type': content + 24 + len(NAME) + 3, 'magic': data, 'time': data + 32,
    }
    if is_cut:
        os.truncate(path, places_of(path, Opcode.DATA_END)[0])
    flip(path, at[part], 2 if part == 'length' else 7)
    # the index of a finished file repeats the offset
    is_lost = is_cut or part not in ('opcode', 'length')
    found = newest_checkpoint(path)
    assert found.checkpoint.time == (600.0 if is_lost else 800.0)
    assert [str(path) in str(item) for item in found.refused] == [True] * is_lost
    status, out, report = lava('bag', 'info', path)
    assert (status, 'is damaged' in report) == (1, True)
    assert f'checkpoints  {3 if is_lost else 4}, ' in out
    assert ('cannot be read: The attachment' in out) == is_lost


def test_bag_without_a_data_checksum_is_checked_by_its_parts(bag: Path) -> None:
    path = bag / 'bag_0.mcap'
    data = bytearray(path.read_bytes())
    (place,) = places_of(path, Opcode.DATA_END)
    data[place + FRAME.size : place + FRAME.size + 4] = bytes(4)
    path.write_bytes(data)
    assert BagReader(bag).damage == ()
    for opcode in (Opcode.CHUNK, Opcode.ATTACHMENT):
        path.write_bytes(data)
        flip(path, places_of(path, opcode)[2] + 100, 5)
        assert len(BagReader(path).damage) == 1


BAG_COMMANDS = (
    ('bag info',), ('bag recover', '-o', 'out'), ('export', '-o', 'out', '--maps', 'thickness'),
    ('ros replay',), ('map', '-o', 'out.html'), ('map', '-o', 'out.png'),
    ('map', '-o', 'out.gif'), ('places', 'huts.csv'), ('watch', '--port', '0'),
)


def test_every_command_that_reads_a_bag_is_tested() -> None:
    taking = {
        name for name in COMMANDS
        if any(action.dest == 'bag' for action in parser_of(name)._actions)
    }
    assert taking == {name for name, *_ in BAG_COMMANDS}


@pytest.mark.parametrize('words', [
    *BAG_COMMANDS[:3],
    *(pytest.param(words, marks=pytest.mark.nightly) for words in BAG_COMMANDS[3:]),
], ids=' '.join)
def test_missing_messages_are_reported(
    bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...]
) -> None:
    command, *arguments = words
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr('lava_ros.clients.player.play', lambda bag, **_: 0)
    monkeypatch.setattr('lava_ros.watch.server.Server', Mock())
    monkeypatch.setattr('signal.signal', lambda *_: None)
    (tmp_path / 'huts.csv').write_text('name,x,y\nhut,300,300\n')
    path = bag / 'bag_0.mcap'
    whole = BagReader(bag)
    assert lava(command, bag, *arguments)[0] == 0
    shutil.rmtree('out', ignore_errors=True)
    os.truncate(path, places_of(path, Opcode.CHUNK)[2] + 100)
    left = BagReader(path)
    assert left.damage == ()
    lost = whole.message_count - left.message_count
    for option, expected in (((), 1), (('--incomplete',), 0)):
        shutil.rmtree('out', ignore_errors=True)
        status, _, report = lava(command, bag, *arguments, *option)
        assert status == expected
        listed = f'{whole.message_count} messages that {bag / YAML} lists'
        assert f'{lost} of the {listed} are' in report
        hazard = whole.topics['/hazard'].count - left.topics['/hazard'].count
        assert f'{hazard} of /hazard' in report


@pytest.mark.parametrize('words', [
    words for words in BAG_COMMANDS if words[0] not in ('bag recover', 'watch')
], ids=' '.join)
def test_cut_off_recording_is_reported(
    bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...]
) -> None:
    command, *arguments = words
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr('lava_ros.clients.player.play', lambda bag, **_: 0)
    (tmp_path / 'huts.csv').write_text('name,x,y\nhut,300,300\n')
    (bag / YAML).unlink()
    path = bag / 'bag_0.mcap'
    os.truncate(path, places_of(path, Opcode.DATA_END)[0])
    for option, expected in (((), 1), (('--incomplete',), 0)):
        shutil.rmtree('out', ignore_errors=True)
        status, _, report = lava(command, bag, *arguments, *option)
        assert (status, report.count(f'{bag} was cut off')) == (expected, 1), report
        assert 'lava bag recover' in report


@pytest.mark.parametrize('count', ['many', '-1', '1.5', '[1]'])
def test_refuses_an_invalid_message_count(bag: Path, count: str) -> None:
    path = bag / YAML
    path.write_text(re.sub(r'(?<=^    message_count: )\d+', count, path.read_text(), flags=re.M))
    with pytest.raises(LavaError, match=r'message_count of .*metadata\.yaml is'):
        BagReader(bag)


@pytest.mark.parametrize('flips', [2, pytest.param(100, marks=pytest.mark.nightly)])
@pytest.mark.parametrize('kind', [
    'finished',
    *(pytest.param(kind, marks=pytest.mark.nightly) for kind in ('cut off', YAML)),
])
def test_a_flipped_bit_is_never_silent(
    bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, flips: int, trial: Any
) -> None:
    drawn: list[Any] = []

    def draw(panels: Any, path: str | Path, **report: Any) -> None:
        drawn.append((list(map(vars, panels)), report))
        Path(path).write_bytes(b'a picture')

    monkeypatch.setattr('lava_ros.products.pictures.draw_sheet', draw)
    monkeypatch.setattr(
        'lava_ros.clients.player.play', lambda bag, **_: len(drawn.extend(schedule(bag)) or drawn)
    )
    path = bag / 'bag_0.mcap'
    # half of the bits are anywhere, half in the first bytes of records
    places = [
        byte
        for _, place, end in records(path)
        for byte in range(place, min(end, place + 60))
    ]
    if kind == YAML:
        path = bag / kind
        places = list(range(path.stat().st_size))
    if kind == 'cut off':
        (bag / YAML).unlink()
        end = places_of(path, Opcode.DATA_END)[0] - 30
        os.truncate(path, end)
        places = [place for place in places if place < end]
    data = path.read_bytes()
    out, html, huts = tmp_path / 'out', tmp_path / 'out.html', tmp_path / 'huts.csv'
    huts.write_text('name,x,y\nhut,300,300\n')
    commands = {
        'info': ('bag info', bag, '--json', '-'),
        'replay': ('ros replay', bag),
        'plot': ('map', bag, '-o', tmp_path / 'out.png'),
        'report': ('map', bag, '-o', html),
        'export': ('export', bag, '-o', out, '--every', '--maps', 'thickness', 'hazard'),
        'recover': ('bag recover', bag, '-o', out),
        'places': ('places', bag, huts),
    }
    if kind == 'cut off':
        commands |= {
            name: (*words, '--incomplete') for name, words in commands.items() if name != 'recover'
        }
    show: dict[str, Callable[[], object]] = {
        'recover': lambda: contents(out),
        'export': lambda: {item.name: item.read_bytes() for item in out.iterdir()},
        'report': html.read_bytes,
    }

    def results() -> dict[str, tuple[int, str, object]]:
        found = {}
        for name, words in commands.items():
            drawn.clear()
            shutil.rmtree(out, ignore_errors=True)
            html.unlink(missing_ok=True)
            status, printed, report = lava(*words)
            assert status in (0, 1, 2) and 'Traceback' not in report, (name, status, report)
            try:
                made = None if status == 2 else (printed, repr(drawn), show.get(name, str)())
            except (LavaError, FileNotFoundError) as error:
                pytest.fail(f'{name}, status {status}, but {error}: {report}')
            found[name] = (status, report, made)
        drawn.clear()
        return found

    expected = results()
    assert {status for status, _, _ in expected.values()} == {0}, expected
    # other places each night; a failure names its own
    chance = random.Random(kind if flips == 2 else f'{kind} {datetime.date.today()}')
    for index in range(flips):
        place = chance.choice(places) if index % 2 else chance.randrange(len(data))
        bit = chance.randrange(8)
        path.write_bytes(data)
        flip(path, place, bit)
        with trial('flips') as row:
            found = results()
            row['refused'] += any(status for status, _, _ in found.values())
            for name, (status, report, made) in found.items():
                where = f'{name}, byte {place}, bit {bit}: {report}'
                assert status == 0 or report, where
                if status == 0 and report == expected[name][1]:
                    assert made == expected[name][2], where
            try:
                time = newest_checkpoint(bag).checkpoint.time
            except LavaError:
                pytest.fail(f'byte {place}, bit {bit}: no checkpoint can be read')
            assert time in TIMES
    path.write_bytes(data)
