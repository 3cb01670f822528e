# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Input files of commands, and pages without pictures."""

from pathlib import Path
from typing import Any

import pytest

from command_line import done
from geodata import feature, write_features, write_scene
from recording import TERRAIN


def write_ensemble_scene(folder: Path, discharge: float, uncertainty: dict[str, Any]) -> None:
    """Write the scene file of an ensemble on the terrain of recordings."""
    vent = {'position': [50.0, 95.0], 'discharge': discharge, 'radius': 8.0}
    write_scene(
        folder, TERRAIN.elevation, 5.0, {'vents': [vent], 'uncertainty': uncertainty}, epsg=32633,
        origin=TERRAIN.origin, offset=TERRAIN.offset, source='a slope of tests',
    )


def ensemble_words(folder: Path, members: int) -> list[object]:
    """Return the command of an ensemble of the scene in a folder."""
    words = ['run', folder / 'scene.yaml', '-o', folder / 'members', '--members', members]
    return [*words, '--until', '3min', '--workers', 1, '--device', 'cpu']


def write_outline(path: Path, south_west: Any, north_east: Any) -> Path:
    """Write a rectangle in UTM zone 33 as GeoJSON."""
    (west, south), (east, north) = south_west, north_east
    ring = [(west, south), (east, south), (east, north), (west, north), (west, south)]
    return write_features(path, feature('Polygon', [ring]))


@pytest.fixture(scope='session')
def ensemble(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run four members on the terrain of recordings, and return the folder of their maps."""
    folder = tmp_path_factory.mktemp('ensemble')
    write_ensemble_scene(folder, 3.0, {'position': {'deviation': 5.0}})
    done(*ensemble_words(folder, 4))
    return folder / 'members'


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Describe the maps of a page without drawing them, which takes seconds."""

    def write(_: object, path: str | Path, **__: object) -> None:
        Path(path).write_bytes(b'a picture')

    monkeypatch.setattr('lava_ros.products.pictures.draw_sheet', write)
