# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Input files of commands: the scene of an ensemble, an outline."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from recording import TERRAIN


def write_scene(folder: Path, discharge: float, uncertainty: dict[str, Any]) -> None:
    """Write the scene file of an ensemble on the terrain of recordings."""
    np.savez(
        folder / 'ground.npz', elevation=TERRAIN.elevation, resolution=5.0, epsg=32633,
        origin=TERRAIN.origin, offset=TERRAIN.offset, source='a slope of tests',
    )
    (folder / 'scene.yaml').write_text(yaml.safe_dump({
        'terrain': {'file': 'ground.npz'},
        'vents': [{'position': [50.0, 95.0], 'discharge': discharge, 'radius': 8.0}],
        'uncertainty': uncertainty,
    }))


def ensemble_words(folder: Path, members: int) -> list[object]:
    """Return the command of an ensemble of the scene in a folder."""
    words = ['ensemble', folder / 'scene.yaml', '-o', folder / 'members', '--members', members]
    return [*words, '--horizon', '3min', '--workers', 1, '--device', 'cpu']


def write_outline(path: Path, ring: Any) -> Path:
    """Write a polygon in UTM zone 33 as GeoJSON."""
    area = {'type': 'Polygon', 'coordinates': [np.asarray(ring).tolist()]}
    path.write_text(json.dumps({**area, 'crs': {'properties': {'name': 'EPSG:32633'}}}))
    return path
