# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Checkpoint of a simulation between two steps, as plain data and as bytes.

The solvers copy a simulation to it, and continue one from it as if it had never stopped.

The bytes are a prefix, a JSON header and a body: the arrays, compressed with zstd. The prefix has
the version of the format, the lengths of header and body, and a checksum of everything, so that
damaged or truncated data and other formats are detected first. The format contains no code and no
paths.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
import hashlib
import json
import logging
import math
import struct
from typing import Any, NamedTuple

import numpy as np

import lava_ros
from lava_ros import validation
from lava_ros.effects import EFFECTS, Effects
from lava_ros.errors import LavaError, refusing
from lava_ros.files.yaml import parse_json
from lava_ros.scene import ENVIRONMENT, Lava, Scene, scene_to_dict, Terrain, Vent
from lava_ros.scene.emplaced import EmplacedFlow
from lava_ros.scene.events import TerrainEvent
from lava_ros.scene.reshaping import Barrier
from lava_ros.scene.scene import onset_from
from lava_ros.scene.uncertainty import uncertainty_from_dict
from lava_ros.simulation.accuracy import Accuracy, accuracy_from_dict
from lava_ros.simulation.carriers import METHODS

_LOG = logging.getLogger(__name__)

#: Number of the model, which is raised when the same scene and settings have another result.
MODEL = 2

#: Version of the format, the only one that is read.
VERSION = 1

#: Media type of the checkpoint attachments of a bag.
MEDIA_TYPE = 'application/vnd.lava-ros.checkpoint'

#: Size of the part that ``summary_of`` reads [bytes].
PREFIX_SIZE = 64

#: Maximum uncompressed size [bytes].
MAX_SIZE = 1 << 31

_MAGIC = b'\x89LAVA\r\n\x1a'

#: Magic, version, lengths of header and body, particle count, time [s], reserved; then a digest.
_PREFIX = struct.Struct('<8sIIQQd8s')

_DIGEST_SIZE = PREFIX_SIZE - _PREFIX.size

_LEVEL = 1

_DTYPES = ('float32', 'float64', 'int32', 'int64')

#: Names of the arrays of a scene: ground, emplaced flow, and ground of an event.
_ELEVATION, _FLOW, _EVENT = 'terrain.elevation', 'emplaced_flows.{}', 'events.{}'


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """State from which a simulation is resumed.

    Attributes:
        time: Simulated time [s].
        scene: Current scene.
        effects: Effects that are on.
        forced: Effects forced on or off by name; None if none are chosen from the scene.
        horizon: Time span for the choice of effects [s].
        switched_on: Simulated time [s] at which a review switched an effect on, by name.
        measured: Largest number of each effect in reviews, by name.
        accuracy: Accuracy with all automatic values filled in.
        emitted: Volume emitted before the current vents [m3].
        since: Simulated time at which the current vents start [s].
        capacity: Maximum number of particles in the arrays.
        arrays: Arrays of the solver by name; ``state.particle`` has a row for each particle.
        written_by: Version of the package that wrote the checkpoint.
        model: Number of its model; 1 if the checkpoint does not state it.
    """

    time: float
    scene: Scene
    effects: Effects
    forced: Mapping[str, bool] | None
    horizon: float
    accuracy: Accuracy
    emitted: float
    since: float
    capacity: int
    arrays: Mapping[str, np.ndarray]
    written_by: str = lava_ros.__version__
    switched_on: Mapping[str, float] = field(default_factory=dict)
    measured: Mapping[str, float] = field(default_factory=dict)
    model: int = MODEL

    def __post_init__(self) -> None:
        """Validate the numbers and arrays.

        Raises:
            LavaError: If a number is not finite, a volume is negative, or the capacity is too
                small.
        """
        for name in ('time', 'emitted', 'since'):
            validation.number(f'checkpoint.{name}', getattr(self, name))
        for name, array in self.arrays.items():
            if array.dtype.kind == 'f' and not np.isfinite(array).all():
                raise LavaError(f'checkpoint.{name}', 'not finite', 'finite numbers only')
        particles = self.arrays.get('state.particle')
        if particles is None or particles.ndim != 2 or particles.shape[1] != 4:
            found = None if particles is None else f'of shape {particles.shape}'
            raise LavaError('checkpoint.state.particle', found, 'an array of shape [count, 4]')
        if (particles[:, 2] < 0.0).any():
            raise LavaError('checkpoint.state.particle', 'a negative volume', 'volumes')
        if not len(particles) <= self.capacity < 2**31:
            expected = f'at least {len(particles)}, the number of particles'
            raise LavaError('checkpoint.capacity', self.capacity, expected)

    @property
    def particle_count(self) -> int:
        """Number of particles, or of cells with lava."""
        return len(self.arrays['state.particle'])

    def by_owner(self) -> dict[str, dict[str, np.ndarray]]:
        """Return the arrays by the two parts of their names, as ``joined`` has joined them."""
        parts: dict[str, dict[str, np.ndarray]] = {}
        for name, array in self.arrays.items():
            owner, _, own_name = name.partition('.')
            parts.setdefault(owner, {})[own_name] = array
        return parts

    def counting(self, threshold: float) -> 'Checkpoint':
        """Return the checkpoint of a simulation that counts lava at or above a thickness [m].

        With another threshold, only the lava at its time has arrived.
        """
        if math.isclose(threshold, self.accuracy.inundation_threshold):
            return self
        arrays = {
            name: array for name, array in self.arrays.items() if not name.startswith('arrived.')
        }
        accuracy = replace(self.accuracy, threshold=threshold)
        return replace(self, accuracy=accuracy, arrays=arrays)

    def to_bytes(self) -> bytes:
        """Serialise the checkpoint; ``from_bytes`` returns bitwise identical arrays."""
        arrays = {
            _ELEVATION: self.scene.terrain.elevation,
            **{_FLOW.format(n): one.thickness for n, one in enumerate(self.scene.emplaced_flows)},
            **{
                _EVENT.format(n): one.terrain.elevation
                for n, one in enumerate(self.scene.events) if one.terrain is not None
            },
            **self.arrays,
        }
        header = json.dumps(
            {
                'written_by': self.written_by,
                'model': self.model,
                'scene': scene_to_dict(self.scene),
                'effects': asdict(self.effects),
                'forced': None if self.forced is None else dict(self.forced),
                'horizon': self.horizon,
                'switched_on': dict(self.switched_on),
                'measured': dict(self.measured),
                'accuracy': asdict(self.accuracy),
                'emitted': self.emitted,
                'since': self.since,
                'capacity': self.capacity,
                'arrays': [
                    {'name': name, 'dtype': array.dtype.name, 'shape': array.shape}
                    for name, array in arrays.items()
                ],
            },
            allow_nan=False,
        ).encode()
        import zstandard

        body = zstandard.compress(b''.join(_planes(item) for item in arrays.values()), _LEVEL)
        prefix = _PREFIX.pack(
            _MAGIC, VERSION, len(header), len(body), self.particle_count, self.time, bytes(8)
        )
        return b''.join((prefix, _digest(prefix, header, body), header, body))


def joined(owners: Mapping[str, Mapping[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Return the arrays of all owners, each named by its owner and its own name."""
    return {
        f'{owner}.{name}': array for owner, arrays in owners.items()
        for name, array in arrays.items()
    }


def warn_of_other_model(checkpoint: Checkpoint) -> None:
    """Log a warning if a run continues that another model began."""
    if checkpoint.model != MODEL:
        _LOG.warning(
            f'the run began with model {checkpoint.model} of lava_ros {checkpoint.written_by}, '
            f'and continues with model {MODEL}: its result matches neither model'
        )


class Summary(NamedTuple):
    """Contents of the prefix of a checkpoint.

    Attributes:
        time: Simulated time [s].
        particle_count: Number of particles, or of cells with lava.
        size: Size of the whole checkpoint [bytes].
    """

    time: float
    particle_count: int
    size: int


def summary_of(data: bytes) -> Summary:
    """Read the first ``PREFIX_SIZE`` bytes of a checkpoint; the rest may be missing.

    Raises:
        LavaError: If they do not begin a checkpoint, or begin one of another version.
    """
    if len(data) < PREFIX_SIZE or data[: len(_MAGIC)] != _MAGIC:
        start = f'{len(data)} bytes that start with {data[: len(_MAGIC)]!r}'
        raise LavaError('checkpoint', start, 'a checkpoint of lava_ros')
    _, version, header, body, count, time, _ = _PREFIX.unpack_from(data)
    if version != VERSION:
        expected = f'{VERSION}: another version of lava_ros wrote this'
        raise LavaError('checkpoint.version', version, expected)
    return Summary(time, count, PREFIX_SIZE + header + body)


def from_bytes(data: bytes) -> Checkpoint:
    """Read a checkpoint from all of its bytes.

    Raises:
        LavaError: If they are damaged, truncated, of another format or version, or not valid.
    """
    summary = summary_of(data)
    if len(data) != summary.size:
        raise LavaError('checkpoint', f'{len(data)} bytes', f'all of its {summary.size} bytes')
    header = _header_of(data)
    body = memoryview(data)[PREFIX_SIZE + len(header) :]
    stored = data[_PREFIX.size : PREFIX_SIZE]
    found = _digest(data[: _PREFIX.size], header, body)
    if found != stored:
        expected = f'{stored.hex()}: the checkpoint is damaged'
        raise LavaError('checkpoint.checksum', found.hex(), expected)
    try:
        return _checkpoint(parse_json('checkpoint.header', header), body, summary.time)
    except (KeyError, TypeError, AttributeError, UnicodeDecodeError, ValueError) as error:
        if isinstance(error, LavaError):
            raise
        reason = f'{type(error).__name__}: {error}'
        raise LavaError('checkpoint.header', reason, 'a header written by lava_ros') from error


def method_of(data: bytes) -> str:
    """Return the carriers of the lava (``Accuracy.method``) by the header of a checkpoint.

    Raises:
        LavaError: If the header is not valid.
    """
    header = parse_json('checkpoint.header', _header_of(data))
    expected = 'a header written by lava_ros'
    with refusing('checkpoint.header', header, expected, KeyError, TypeError, AttributeError):
        # absent before 0.2
        method = header['accuracy'].get('method', METHODS[0])
    return validation.choice('checkpoint.accuracy.method', method, METHODS)


def _header_of(data: bytes) -> bytes:
    return data[PREFIX_SIZE : PREFIX_SIZE + _PREFIX.unpack_from(data)[2]]


def _checkpoint(header: dict[str, Any], body: memoryview, time: float) -> Checkpoint:
    arrays = _arrays(header['arrays'], body)
    data = header['scene']
    terrain = {**data['terrain']}
    shape = tuple(terrain.pop('shape'))
    elevation = arrays.pop(_ELEVATION)
    if elevation.shape != shape:
        raise LavaError('checkpoint.terrain', elevation.shape, f'elevations of shape {shape}')
    ground = Terrain(elevation, **terrain)
    flows = [
        EmplacedFlow(
            arrays.pop(_FLOW.format(number)), item['resolution'], tuple(item['origin']),
            item['temperature'], item['source'],
        )
        for number, item in enumerate(data.get('emplaced_flows', []))
    ]
    scene = Scene(
        ground,
        vents=tuple(Vent(**vent) for vent in data['vents']),
        lava=Lava.paper(**data['lava']),
        **{name: data[name] for name in ENVIRONMENT if name in data},
        uncertainty=uncertainty_from_dict(data.get('uncertainty', {})),
        emplaced_flows=tuple(flows),
        events=tuple(
            _event(item, ground, arrays.pop(_EVENT.format(number), None))
            for number, item in enumerate(data.get('events', []))
        ),
        onset=onset_from('checkpoint.scene', data),
    )
    forced = header['forced']
    return Checkpoint(
        time=time,
        scene=scene,
        effects=Effects(**header['effects']),
        forced=None if forced is None else {str(key): bool(forced[key]) for key in forced},
        horizon=validation.number('checkpoint.horizon', header['horizon'], above=0.0, unit='s'),
        accuracy=accuracy_from_dict(header['accuracy']),
        emitted=header['emitted'],
        since=header['since'],
        capacity=header['capacity'],
        arrays=arrays,
        written_by=str(header['written_by']),
        switched_on=_by_effect('switched_on', header['switched_on']),
        measured=_by_effect('measured', header['measured']),
        model=validation.whole(
            'checkpoint.model', header.get('model', 1), at_least=1, at_most=2**31
        ),
    )


def _event(
    data: dict[str, Any], ground: Terrain, elevation: np.ndarray | None
) -> TerrainEvent:
    terrain = None
    if elevation is not None:
        terrain = replace(ground, elevation=elevation, source=data['source'], barriers=())
    barriers = tuple(
        Barrier.from_dict('checkpoint.events', item) for item in data.get('barriers', [])
    )
    return TerrainEvent(data['time'], data['text'], terrain, barriers)


def _by_effect(label: str, values: dict[str, Any]) -> dict[str, float]:
    names = validation.keys(f'checkpoint.{label}', values, allowed=EFFECTS)
    return {
        name: validation.number(f'checkpoint.{label}.{name}', names[name]) for name in names
    }


def _arrays(entries: list[dict[str, Any]], body: memoryview) -> dict[str, np.ndarray]:
    layout = []
    for entry in entries:
        dtype = np.dtype(validation.choice('checkpoint.dtype', entry['dtype'], _DTYPES))
        shape = tuple(int(side) for side in entry['shape'])
        if min(shape, default=0) < 0:
            raise LavaError(f'checkpoint.{entry["name"]}', shape, 'a shape')
        layout.append((str(entry['name']), dtype, shape, math.prod(shape) * dtype.itemsize))
    import zstandard

    size = sum(item[-1] for item in layout)
    if size > MAX_SIZE:
        raise LavaError('checkpoint', f'{size} bytes of arrays', f'at most {MAX_SIZE}')
    try:
        # the decompressor allocates the size in the frame, which may be wrong
        claimed = zstandard.frame_content_size(body)
        if claimed != size:
            raise LavaError('checkpoint.body', f'{claimed} bytes', f'{size} bytes')
        content = memoryview(zstandard.decompress(body))
    except zstandard.ZstdError as error:
        raise LavaError('checkpoint.body', str(error), f'{size} bytes, compressed') from error
    arrays, position = {}, 0
    for name, dtype, shape, length in layout:
        arrays[name] = _from_planes(content[position : position + length], dtype, shape)
        position += length
    return arrays


def _planes(array: np.ndarray) -> bytes:
    """Return the byte planes of an array: first bytes of all rows, second bytes, and so on.

    Bytes that vary little from row to row, such as exponents, then compress well.
    """
    rows = np.ascontiguousarray(array.reshape(_rows(array.shape)))
    return rows.view(np.uint8).T.tobytes() if array.size else b''


def _from_planes(data: memoryview, dtype: np.dtype[Any], shape: tuple[int, ...]) -> np.ndarray:
    if not data:
        return np.zeros(shape, dtype)
    planes = np.frombuffer(data, np.uint8).reshape(-1, _rows(shape)[0])
    return np.ascontiguousarray(planes.T).view(dtype).reshape(shape)


def _rows(shape: tuple[int, ...]) -> tuple[int, int]:
    """Return the number of rows and their length, which is 1 unless rows belong to particles."""
    if len(shape) == 2 and shape[1] <= 4:
        return shape[0], shape[1]
    return math.prod(shape), 1


def _digest(*parts: bytes | memoryview) -> bytes:
    digest = hashlib.blake2b(digest_size=_DIGEST_SIZE)
    for part in parts:
        digest.update(part)
    return digest.digest()
