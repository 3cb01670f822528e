# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Checkpoints as bytes: lossless, checked and free of local paths."""

from dataclasses import asdict, fields
import json
import struct

import numpy as np
import pytest
import zstandard

from lava_ros.effects import Effects
from lava_ros.errors import LavaError
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.output.checkpoint import (
    Checkpoint,
    from_bytes,
    PREFIX_SIZE,
    summary_of,
    VERSION,
)


def checkpoint(count=1000, **changes):
    """Return a checkpoint of a synthetic scene, without round numbers."""
    random = np.random.default_rng(7)
    elevation = random.normal(700.0, 30.0, (11, 13))
    elevation[3, 4] = np.nan
    scene = Scene(
        Terrain(
            elevation, 0.1, origin=(-1.0 / 3.0, 2.0 / 3.0), epsg=3857, offset=(1e6 / 7, 0.1),
            barriers=(((0.1, 1.0 / 3.0), (0.7, 0.0)),),
        ),
        (
            Vent((0.1, 0.9), ((0.1, 1.0 / 3.0), (0.7, 0.0)), name='é', velocity=(0.1, -0.2)),
            Vent((0.3, 1.1), 0.3, end=(0.4, 1.2), radius=0.07, temperature=1400.1),
        ),
        Lava.paper(viscosity=1e3 / 3.0, crust=True, conductivity=2.1),
        ambient_temperature=285.15,
        gravity=3.71,
    )
    values = {
        'time': 1e5 / 3.0,
        'scene': scene,
        'effects': Effects(crust=True, yielding=True),
        'forced': {'crust': True, 'inertia': False},
        'horizon': 1.0 / 3.0,
        'accuracy': Accuracy(spacing=1.0 / 7.0, thickness=0.3),
        'emitted': 1e6 / 3.0,
        'since': 0.1,
        'capacity': 4096,
        'arrays': {
            'state.particle': np.abs(random.normal(0.0, 9.0, (count, 4))).astype(np.float32),
            'state.emission_time': random.random(count),
            'state.counts': np.arange(8, dtype=np.int32),
            'solidified.deposit': random.integers(0, 2**60, (13, 15)),
        },
    }
    return Checkpoint(**{**values, **changes})


@pytest.mark.parametrize('count', [1000, 1, 0])
def test_bytes_restore_the_checkpoint(count):
    one = checkpoint(count)
    other = from_bytes(one.to_bytes())
    names = {item.name for item in fields(one)} - {'scene', 'arrays'}
    for name in names:
        assert getattr(other, name) == getattr(one, name), name
    assert other.particle_count == count
    assert list(other.arrays) == list(one.arrays)
    for name, values in one.arrays.items():
        assert other.arrays[name].dtype == values.dtype
        assert np.array_equal(other.arrays[name], values), name
    for name in ('vents', 'lava', 'ambient_temperature', 'gravity'):
        assert getattr(other.scene, name) == getattr(one.scene, name), name
    before, after = one.scene.terrain, other.scene.terrain
    for name in ('resolution', 'origin', 'epsg', 'offset'):
        assert getattr(after, name) == getattr(before, name), name
    assert np.array_equal(after.elevation, before.elevation, equal_nan=True)
    assert not after.elevation.flags.writeable
    data = other.to_bytes()
    assert data == one.to_bytes()
    # a list of checkpoints reads only the prefix of each
    assert summary_of(data[:PREFIX_SIZE]) == (1e5 / 3.0, count, len(data))
    # no forced effects and no choice differ
    for forced in (None, {}):
        assert from_bytes(checkpoint(forced=forced).to_bytes()).forced == forced


def test_every_flipped_bit_and_truncation_is_refused():
    data = checkpoint(20).to_bytes()
    for place in range(len(data)):
        damaged = bytearray(data)
        damaged[place] ^= 1 << place % 8
        with pytest.raises(LavaError, match=r'^checkpoint'):
            from_bytes(bytes(damaged))
    for length in range(len(data)):
        with pytest.raises(LavaError, match=r'^checkpoint is .* bytes'):
            from_bytes(data[:length])
    with pytest.raises(LavaError, match=f'all of its {len(data)} bytes'):
        from_bytes(data + b'\0')


def test_distinguishes_damaged_foreign_and_other_checkpoints():
    data = checkpoint(20).to_bytes()
    damaged = data[:-9] + bytes([data[-9] ^ 1]) + data[-8:]
    with pytest.raises(LavaError, match=r'checkpoint\.checksum .*the checkpoint is damaged'):
        from_bytes(damaged)
    with pytest.raises(LavaError, match='expected a checkpoint of lava_ros'):
        from_bytes(b'\x89PNG\r\n\x1a\n' + data[8:])
    for version in (0, VERSION + 1):
        other = data[:8] + struct.pack('<I', version) + data[12:]
        with pytest.raises(
            LavaError, match=rf'checkpoint\.version is {version}, expected 1: another version'
        ):
            from_bytes(other)


def test_refuses_a_state_that_is_not_valid():
    arrays = checkpoint().arrays
    for column, value, words in ((0, np.nan, 'finite'), (2, -1.0, 'negative volume')):
        spoilt = arrays['state.particle'].copy()
        spoilt[17, column] = value
        with pytest.raises(LavaError, match=rf'checkpoint\.state\.particle .*{words}'):
            checkpoint(arrays={**arrays, 'state.particle': spoilt})
    with pytest.raises(LavaError, match=r'checkpoint\.time'):
        checkpoint(time=np.inf)
    with pytest.raises(LavaError, match=r'checkpoint\.capacity is 10'):
        checkpoint(capacity=10)
    with pytest.raises(LavaError, match='state.particle'):
        checkpoint(arrays={})


def test_refuses_an_invalid_header_with_a_valid_checksum(monkeypatch):
    one = checkpoint()
    for name, value in (
        ('accuracy', {**asdict(one.accuracy), 'kernel': 'none'}),
        ('effects', {'magic': True}),
        ('scene', {}),
        ('scene', None),
    ):
        with monkeypatch.context() as patch:
            encode = json.JSONEncoder(allow_nan=False).encode
            patch.setattr(
                'lava_ros.simulation.output.checkpoint.json.dumps',
                lambda data, **_: encode({**data, name: value}),  # noqa: B023
            )
            data = one.to_bytes()
        with pytest.raises(LavaError, match=r'checkpoint|accuracy'):
            from_bytes(data)


def test_refuses_a_body_of_another_size_than_its_arrays(monkeypatch):
    compress = zstandard.compress
    with monkeypatch.context() as patch:
        patch.setattr(zstandard, 'compress', lambda data, level: compress(data + b'more', level))
        data = checkpoint(20).to_bytes()
    with pytest.raises(LavaError, match=r"checkpoint[.]body is '\d+ bytes', expected \d+ bytes"):
        from_bytes(data)


def test_checkpoint_contains_no_path(tmp_path):
    header = checkpoint().to_bytes()[PREFIX_SIZE:]
    for place in (str(tmp_path), '/tmp', '/home', '/work', '/usr'):
        assert place.encode() not in header


def test_constant_columns_compress():
    random = np.random.default_rng(1)
    particle = np.full((100_000, 4), [0.0, 0.0, 25.0, 1423.0], dtype=np.float32)
    particle[:, :2] = np.cumsum(random.normal(0.0, 1.0, (100_000, 2)), axis=0)
    arrays = {'state.particle': particle}
    data = checkpoint(arrays=arrays, capacity=2**17).to_bytes()
    assert len(data) < 8 * 100_000
    assert np.array_equal(from_bytes(data).arrays['state.particle'], particle)
