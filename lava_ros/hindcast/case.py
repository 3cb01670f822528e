# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Cases: scenes of mapped eruptions with their observations, which docs/VALIDATION.md describes.

Coordinates are those of the elevation. Times of the clock of a case are in seconds since time 0 of
``effusion_rate.csv``; those of its scene are simulated times.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from lava_ros import validation
from lava_ros.errors import LavaError, RefusalError
from lava_ros.hindcast.outlines import Outline, read_outlines
from lava_ros.hindcast.tables import check_discharge, check_elevation, check_outline
from lava_ros.scene import Scene, SceneSource, Terrain
from lava_ros.scene.case_files import find_case_files
from lava_ros.scene.features import ENDINGS
from lava_ros.scene.materials import Material
from lava_ros.scene.on_terrain import read_cover_on, read_polygons_on, read_raster_on
from lava_ros.scene.onset import Onset
from lava_ros.scene.vent_files import VentRow


@dataclass(frozen=True, eq=False)
class Case:
    """The scene of an eruption, and its mapped flow field; ``name`` is the name of the folder.

    Attributes:
        source: Source of the data; may be empty.
        scene: The scene. The map frame's origin is the grid's lower-left corner.
        material: Material of the lava, with the composition that the case gives.
        footprint: Mapped flow field at the end, bool, shape [rows, columns], row 0 in the south.
        start: Start of the simulation on the clock of the case [s].
        end: End of the simulation on this clock [s].
        volume: Volume erupted during the simulation [m3].
        low_pass: Width of the filter applied to the terrain [m]; 0: none.
        outlines: Mapped flow fields at several times, the last one ``footprint``; empty if the
            case has one footprint only.
        initial: Mapped flow field from which the simulation starts; None without one.
        stated: Names of the constants of the lava that the files of the case state, with
            ``vent_temperature`` if they state it.
        inputs: Path, size and digest of each input file (``SourcedScene.digests``).
        remarks: Warnings about the inputs.
    """

    name: str
    title: str
    source: str
    scene: Scene
    material: Material
    footprint: np.ndarray
    start: float
    end: float
    volume: float
    low_pass: float = 0.0
    outlines: tuple[Outline, ...] = ()
    initial: np.ndarray | None = None
    stated: frozenset[str] = frozenset()
    inputs: Sequence[Mapping[str, Any]] = ()
    remarks: Sequence[str] = ()

    @property
    def onset(self) -> Onset | None:
        """Date of the start of the simulation; None if the case does not state it."""
        return Onset.of(self.scene)

    @property
    def duration(self) -> float:
        """Simulated duration [s]."""
        return self.end - self.start

    @property
    def area(self) -> float:
        """Area of the mapped flow field [m2]."""
        return float(self.footprint.sum()) * self.scene.terrain.resolution**2

    @property
    def vent_cells(self) -> list[tuple[int, int]]:
        """Rows and columns of the ends of the vents."""
        ends = [end for vent in self.scene.vents for end in (vent.position, vent.end) if end]
        cells = [self.scene.terrain.cell_at(*end) for end in ends]
        return [cell for cell in cells if cell is not None]

    def with_lava(
        self, lava: Mapping[str, Any], *, temperature: float | None = None, discharge: float = 1.0
    ) -> 'Case':
        """Return the case with other constants of the lava, by name.

        ``temperature`` is the eruption temperature [K], None for the current one; ``discharge`` is
        a factor on all discharges, not on lava that is there at the start.

        Raises:
            LavaError: If a value is not valid.
        """
        vents = tuple(
            replace(
                vent,
                temperature=vent.temperature if temperature is None else temperature,
                discharge=tuple((time, flux * discharge) for time, flux in vent.series),
            )
            for vent in self.scene.vents
        )
        flows = tuple(
            flow if temperature is None else replace(flow, temperature=temperature)
            for flow in self.scene.emplaced_flows
        )
        scene = replace(
            self.scene, lava=replace(self.scene.lava, **lava), vents=vents, emplaced_flows=flows
        )
        emplaced = sum(flow.volume for flow in flows)
        volume = emplaced + (self.volume - emplaced) * discharge
        return replace(self, scene=scene, volume=volume)


def load_case(directory: str | Path | SceneSource, **changes: Any) -> Case:
    """Read a case from its folder.

    Args:
        directory: The folder, or a source with its path.
        changes: Fields of ``SceneSource`` that replace parts of the scene, such as ``material``.

    Raises:
        LavaError: If a file is missing or not valid, or the files are not consistent.
    """
    given = directory if isinstance(directory, SceneSource) else SceneSource(path=directory)
    source = replace(given, **changes)
    assert source.path is not None
    folder = Path(source.path)
    if not folder.is_dir():
        # raises LavaError
        find_case_files(folder)
    found = source.load()
    assert found.case is not None
    read, scene = found.case, found.scene
    options, ground, start, last = read.files.options, read.ground, read.start, read.last
    check_elevation(ground)
    outlines: tuple[Outline, ...] = ()
    footprints = partial(_footprint, ground=ground)
    if 'outlines' in options:
        outlines = read_outlines(
            options['outlines'], folder, footprints, start=start, onset=Onset.of(scene),
            starts_from_outline=read.initial is not None,
        )
        last = start + outlines[-1].time
    end = validation.number('case.end', options.get('end', last), above=start, unit='s')
    if outlines and outlines[-1].time > end - start:
        expected = f'a time before the end, {end:g} s'
        raise LavaError(f'case.outlines[{len(outlines) - 1}].time', outlines[-1].text, expected)
    if outlines:
        footprint = outlines[-1].footprint
    else:
        assert read.files.footprint is not None
        footprint = footprints(read.files.footprint)
    name = folder.resolve().name
    # a material that replaces the lava replaces all of its constants
    stated = options if source.material is None else {**options, 'lava': {}}
    case = Case(
        name=name,
        title=str(options.get('title', name)),
        source=str(options.get('source', '')),
        scene=scene,
        material=found.material,
        footprint=footprint,
        start=start,
        end=end,
        volume=sum(vent.volume_between(0.0, end - start) for vent in scene.vents)
        + sum(flow.volume for flow in scene.emplaced_flows),
        low_pass=read.width,
        outlines=outlines,
        initial=None if read.initial is None else read.initial.covered,
        stated=_stated(stated, read.vents),
        inputs=found.digests(),
        remarks=found.remarks,
    )
    check_outline(case.vent_cells, ground, footprint)
    check_discharge(case.volume, case.area)
    return case


def _stated(options: Mapping[str, Any], vents: Iterable[VentRow]) -> frozenset[str]:
    """Return the names of the constants that the files of a case state."""
    names = {*options.get('lava', {})} - {'material'}
    if names & {'composition', 'vft_a', 'vft_b', 'vft_c'}:
        # the viscosity at the vent shifts the law that they give
        names |= {'viscosity'}
    if 'vent_temperature' in options or any(row.temperature is not None for row in vents):
        names |= {'vent_temperature'}
    return frozenset(names - {'composition'})


def _footprint(path: Path, *, ground: Terrain) -> np.ndarray:
    """Read the mapped flow field: areas, or a grid of 0 and 1 in any system, cells and extent."""
    if path.suffix.lower() in ENDINGS:
        covered = read_polygons_on(ground, path, field='the footprint')
        values = covered.astype(float)
    else:
        values = np.nan_to_num(read_raster_on(ground, path, field='the footprint'))
        covered = read_cover_on(ground, path, field='the footprint')
    other = values[(values != 0.0) & (values != 1.0)]
    if other.size:
        expected = '0 (not covered) and 1 (covered) only, and no data'
        raise LavaError('a cell of the footprint', float(other[0]), expected)
    if not covered.any():
        problem = f'The footprint {path.name} covers no cell of the elevation'
        raise RefusalError('the footprint', problem, 'Check its values and its coordinates')
    return covered
