# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Progress of a run, which tells a restarted process how far the killed process had simulated."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field
import hashlib
import json
from pathlib import Path
import re
from typing import Any

from lava_ros import validation
from lava_ros.errors import LavaError, refusing
from lava_ros.files import open_input, replacing
from lava_ros.files.yaml import parse_json
from lava_ros.scene import Scene, scene_to_dict, Terrain

#: Maximum size of the file that is read [bytes].
MAX_SIZE = 64 * 1024

#: Valid tokens. They are parts of file names.
_TOKEN = re.compile(r'[A-Za-z0-9._-]{1,64}')


def check_token(token: str) -> None:
    """Raise LavaError if a token is not valid; an empty text means that there is none."""
    if token and not _TOKEN.fullmatch(token):
        expected = 'at most 64 letters, digits, dots, hyphens and underscores'
        raise LavaError('restart_token', token, expected)


@dataclass(frozen=True)
class Progress:
    """Progress of a run.

    Attributes:
        bag: Bag with the newest checkpoint of the run.
        checkpoint_time: Simulated time of that checkpoint [s].
        time: Simulated time of the newest maps [s].
        stamp_ns: ROS time at which they were published [ns].
        behind: Simulated time by which a resumed simulation was still behind the clock [s].
        is_held: True if simulated time was held.
        is_paused: True if it was held by ``~/pause``.
        is_recording: True if a recording was wanted.
        given: Digests of the inputs given at the start (``digests``).
        vents: Publications on ``vents`` that the checkpoint includes: source timestamp and
            sequence number of each.
    """

    bag: str
    checkpoint_time: float = 0.0
    time: float = 0.0
    stamp_ns: int = 0
    behind: float = 0.0
    is_held: bool = False
    is_paused: bool = False
    is_recording: bool = False
    given: Mapping[str, str] = field(default_factory=dict)
    vents: tuple[tuple[int, int], ...] = ()


class RestartFile:
    """The file with the progress of a run.

    It survives the end of the process, but not a loss of power. ``error`` is the reason why it
    could not be written, empty without one.
    """

    def __init__(self, path: Path) -> None:
        """Initialize; ``path`` need not exist."""
        self.path = path
        self.error = ''
        self._written: Progress | None = None

    def read(self) -> Progress | None:
        """Return the progress of the killed process, None without a file.

        Raises:
            LavaError: If the file is damaged.
        """
        label, expected = f'restart file {self.path}', 'a file written by the node'
        try:
            with (
                refusing(label, str(self.path), expected, OSError),
                open_input(self.path) as stream,
            ):
                data = parse_json(label, stream.read(MAX_SIZE))
        except LavaError:
            if not self.path.exists():
                return None
            raise
        try:
            data = {**data, 'vents': tuple((int(a), int(b)) for a, b in data['vents'])}
            data['given'] = {str(key): str(value) for key, value in data['given'].items()}
            progress = Progress(**data)
            for name in ('time', 'checkpoint_time', 'stamp_ns', 'behind'):
                validation.number(f'{label}.{name}', getattr(progress, name), at_least=0.0)
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            reason = f'{expected} ({type(error).__name__}: {error})'
            raise LavaError(label, str(self.path), reason) from error
        return progress

    def write(self, progress: Progress) -> None:
        """Replace the file if the progress has changed; note an error in ``error``."""
        if progress == self._written:
            return
        try:
            with replacing(self.path, is_durable=False) as partial:
                partial.write_text(json.dumps(asdict(progress)), encoding='utf-8')
        except OSError as error:
            self.error = f'{self.path} cannot be written: {error.strerror or error}'
        else:
            self.error, self._written = '', progress

    def remove(self) -> None:
        """Remove the file at the end of the run, so that no later process continues it."""
        with suppress(OSError):
            self.path.unlink(missing_ok=True)


def digests(scene: Scene | None, terrain: Terrain | None, **others: str) -> dict[str, str]:
    """Return a digest of each input given at the start of a run, by name."""
    parts: dict[str, Any] = dict(others)
    if scene is not None:
        parts |= scene_to_dict(scene)
        terrain = scene.terrain
    result = {name: _digest(json.dumps(value).encode()) for name, value in parts.items()}
    if terrain is not None:
        place: tuple[Any, ...] = (
            terrain.shape, terrain.resolution, terrain.origin, terrain.epsg, terrain.offset,
        )
        if terrain.sea_level is not None:
            place += (terrain.sea_level,)
        result['terrain'] = _digest(repr(place).encode(), terrain.elevation.tobytes())
    return result


def differing(given: Mapping[str, str], before: Mapping[str, str]) -> list[str]:
    """Return the names of the inputs that differ."""
    return [name for name in sorted({*given, *before}) if given.get(name) != before.get(name)]


def _digest(*parts: bytes) -> str:
    digest = hashlib.blake2b(digest_size=8)
    for part in parts:
        digest.update(part)
    return digest.hexdigest()
