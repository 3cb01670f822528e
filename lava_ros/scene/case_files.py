# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Files of a case: the folder of a mapped eruption, which docs/VALIDATION.md describes."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from lava_ros.errors import LavaError
from lava_ros.files import similar_file
from lava_ros.files.yaml import read_yaml
from lava_ros.scene.events import read_events, TerrainEvent
from lava_ros.scene.features import ENDINGS, TABLES
from lava_ros.scene.file_keys import CASE_KEYS
from lava_ros.scene.input_files import files_in
from lava_ros.scene.materials import with_material_in_lava
from lava_ros.scene.terrain import Terrain


def _vector_files(stem: str) -> tuple[str, ...]:
    return tuple(f'{stem}{ending}' for ending in ENDINGS if ending not in TABLES)


#: Possible names of the footprint; the first that exists is used, and none with ``outlines``.
FOOTPRINTS = ('footprint.asc', 'footprint.tif', *_vector_files('footprint'))

#: Possible names of each file; the first that exists is used.
FILES = (
    ('elevation.asc', 'elevation.tif'),
    FOOTPRINTS,
    ('vent.csv', *_vector_files('vent')),
    ('effusion_rate.csv',),
)

#: File with everything else.
OPTIONS = 'case.yaml'

#: Radius of a vent without its own, in cells.
VENT_RADIUS = 1.5


@dataclass(frozen=True)
class CaseFiles:
    """Files of a case.

    Attributes:
        folder: The folder.
        options: Content of ``case.yaml``.
        elevation: Elevation of the ground.
        vents: Places of the vents.
        rates: Table of effusion rates.
        footprint: Mapped flow field; None if the options list outlines.
    """

    folder: Path
    options: Mapping[str, Any]
    elevation: Path
    vents: Path
    rates: Path
    footprint: Path | None

    def named(self) -> Iterator[tuple[str, Path]]:
        """Yield all files that decide the scene, by name and as paths."""
        found = [self.elevation, self.vents, self.rates]
        if (options := self.folder / OPTIONS).exists():
            found.append(options)
        yield from ((str(path), path) for path in found)
        yield from files_in(self.options.get('events', []), self.folder)


def find_case_files(directory: str | Path) -> CaseFiles:
    """Find the files of a case, and read its options.

    Raises:
        LavaError: If a file is missing, or ``case.yaml`` cannot be read.
    """
    folder = Path(directory)
    if not folder.is_dir():
        raise LavaError('case', str(folder), f'a folder that exists{similar_file(folder)}')
    path = folder / OPTIONS
    data = read_yaml('case', path) if path.exists() else None
    options = CASE_KEYS.names('case', {} if data is None else data)
    options = with_material_in_lava('case', options)
    found = [next(filter(Path.is_file, map(folder.joinpath, names)), None) for names in FILES]
    missing = [
        ' or '.join(names[:3])
        for names, path in zip(FILES, found, strict=True)
        if not path and not (names is FOOTPRINTS and 'outlines' in options)
    ]
    if missing:
        raise LavaError('case', str(folder), f'a folder that also contains {", ".join(missing)}')
    elevation, footprint, vents, rates = found
    assert elevation and vents and rates
    return CaseFiles(folder, options, elevation, vents, rates, footprint)


def read_case_events(
    files: CaseFiles, ground: Terrain, options: Mapping[str, Any], start: float
) -> list[TerrainEvent]:
    """Read the changes of the ground of a case, each with the whole ground after it.

    Args:
        files: Files of the case.
        ground: Terrain before the events.
        options: Options of ``load_terrain`` for a new elevation.
        start: Start of the simulation on the clock of the case [s]; an earlier change is at 0.

    Raises:
        LavaError: As in ``read_events``.
    """
    events = []
    items = files.options.get('events', [])
    for item in read_events('case.events', items, files.folder, ground, options):
        ground = item.ground(ground)
        time = max(item.time - start, 0.0)
        # with the ground in place of its barriers: the filter of a case smooths these, too
        events.append(replace(item, time=time, terrain=ground, barriers=()))
    return events
