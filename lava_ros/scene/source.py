# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Sources of scenes: a scene file, a case or a terrain, and inputs that replace parts of it.

Python, the command line, the node and hindcasts read all scenes here.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime, timedelta
import logging
from operator import attrgetter
from pathlib import Path
from threading import get_ident
from typing import Any

from lava_ros import validation
from lava_ros.errors import LavaError, RefusalError, refusing
from lava_ros.files.raster_formats import FORMATS
from lava_ros.files.resources import find_file
from lava_ros.files.yaml import read_yaml
from lava_ros.scene.case_files import (
    CaseFiles,
    find_case_files,
    read_case_events,
    VENT_RADIUS,
)
from lava_ros.scene.effusion_rates import (
    error_of_rates,
    Options,
    RATE_KEYS,
    read_effusion_rates,
)
from lava_ros.scene.emplaced import EmplacedFlow, read_flows
from lava_ros.scene.events import read_events
from lava_ros.scene.file_keys import CASE_TERRAIN, OUTLINE_KEYS
from lava_ros.scene.from_outline import FROM_OUTLINE_KEYS, initial_flow, InitialFlow
from lava_ros.scene.given_vents import described, GivenVents, summit, usual_vent
from lava_ros.scene.input_files import digests, files_in
from lava_ros.scene.materials import Material
from lava_ros.scene.measurements import contours_in
from lava_ros.scene.plausibility import check_date
from lava_ros.scene.reshaping import low_pass
from lava_ros.scene.scene import date_text, ENVIRONMENT, onset_from, Scene, scene_and_material
from lava_ros.scene.scene_files import read_scene
from lava_ros.scene.terrain import Terrain
from lava_ros.scene.terrain_files import demo_terrain, load_terrain, terrain_path
from lava_ros.scene.vent_files import check_places, read_vents, Series, series_of, VentRow

#: Vents of the demo, (x, y) [m] and effusion rate [m3/s]: one in the crater, which is open to the
#: north, and one on each side of its opening.
DEMO_VENTS = (
    (4050.0, 3300.0, 60.0),
    (3200.0, 4300.0, 20.0),
    (5300.0, 4200.0, 20.0),
)

#: Suffixes of elevation files.
ELEVATIONS = {'.npz', *(suffix for item in FORMATS for suffix in item.suffixes)}

#: Fields of a source that are choices for reading a table of effusion rates.
RATE_FIELDS = ('start', 'gaps', 'porosity', 'measured')


@dataclass(frozen=True, eq=False)
class CaseInputs:
    """Inputs of a case with which its observations are compared.

    Attributes:
        files: Files of the case.
        ground: Terrain before the filter.
        vents: The vents.
        start: Start of the simulation on the clock of the case [s].
        last: End of the table of effusion rates on this clock [s].
        width: Width of the filter of the terrain [m]; 0: none.
        initial: The flow from whose outline the simulation starts; None without one.
    """

    files: CaseFiles
    ground: Terrain
    vents: tuple[VentRow, ...]
    start: float
    last: float
    width: float
    initial: InitialFlow | None = None


@dataclass(frozen=True, eq=False)
class SourcedScene:
    """A scene, and where it is from.

    Attributes:
        scene: The scene.
        material: Material of its lava, with the composition that the source gives.
        files: Input files, as given and as paths.
        remarks: Warnings about the inputs, as they were logged.
        case: Inputs of a case; None for other scenes.
    """

    scene: Scene
    material: Material
    files: tuple[tuple[str, Path], ...]
    remarks: tuple[str, ...] = ()
    case: CaseInputs | None = None

    def digests(self) -> list[dict[str, Any]]:
        """Return the path as given, the size and the SHA-256 digest of each input file.

        Raises:
            LavaError: If a file cannot be read.
        """
        return digests(self.files)


@dataclass(frozen=True, kw_only=True)
class SceneSource:
    """Inputs that describe a scene; what is given replaces what the scene or case says.

    Without any input, the scene is that of the demonstration.

    Attributes:
        path: Scene file or its name in ``examples/``, folder of a case, or elevation file.
        terrain: Elevation file, or a terrain.
        epsg: EPSG code of the coordinates of the terrain.
        nodata: Value of cells without data, a number or ``none``.
        fill_holes: True to fill inner cells without data, and pits.
        sea_level: Elevation at or below which the ground is sea [m].
        low_pass: Width of a Gaussian filter of the ground [m].
        vent: Places of vents: easting and northing [m], or longitude and latitude [degrees], as
            pairs of numbers or as text with a comma.
        vents: File of points and lines.
        effusion_rate: Effusion rate of each vent [m3/s], or a table of the rates of all together.
        start: Date of the start of the eruption (ISO 8601), which is time 0.
        gaps: Effusion rate in the gaps of the table, one of ``effusion_rates.GAPS``.
        porosity: Fraction of bubbles, if the table has dense-rock effusion rates.
        measured: Method of measurement of the table, one of ``measurements.RATE_ERRORS``.
        material: Name of the lava.
        emplaced_flows: Flows before the start, in addition to those of the scene, as in its file.
        events: Changes of the ground, in addition to those of the scene, as in its file.
        from_outline: Time of the outline of a case from which the simulation starts [s], or date.
        solidified: Lower fraction of the lava in this outline that is solid.
        insist: True to accept numbers that cannot be.
        has_vents: False leaves a terrain alone without a vent on its summit.
        words: Names of fields in errors, as the user writes them; the names here for others.
    """

    path: str | Path | None = None
    terrain: str | Path | Terrain | None = None
    epsg: int | None = None
    nodata: float | str | None = None
    fill_holes: bool | None = None
    sea_level: float | None = None
    low_pass: float | None = None
    vent: Sequence[str | Sequence[float]] = ()
    vents: str | Path | None = None
    effusion_rate: float | str | Path | None = None
    start: str | None = None
    gaps: str | None = None
    porosity: float | None = None
    measured: str | None = None
    material: str | None = None
    emplaced_flows: Sequence[Mapping[str, Any]] = ()
    events: Sequence[Mapping[str, Any]] = ()
    from_outline: float | str | None = None
    solidified: float | None = None
    insist: bool = False
    has_vents: bool = True
    words: Mapping[str, str] = field(default_factory=dict)

    def load(self) -> SourcedScene:
        """Read all files, and return the scene with its provenance.

        A terrain without a scene gets a vent on its highest point away from the borders.

        Raises:
            LavaError: If an input is not valid. The error names the key of a file, the line of a
                table, or the field as in ``words``.
        """
        remarks, log = _Remarks(), logging.getLogger('lava_ros')
        log.addHandler(remarks)
        try:
            found = self._load_case() if self._is_case else self._load_scene()
        except LavaError as error:
            raise self._as_written(error) from None
        finally:
            log.removeHandler(remarks)
        return replace(found, remarks=tuple(remarks.texts))

    def load_terrain(self) -> Terrain | None:
        """Read the terrain that is given in place of that of a scene; None without one.

        Raises:
            LavaError: If the file or an option cannot be used.
        """
        given, options = self._elevation, self._terrain_options()
        if isinstance(given, str | Path):
            try:
                return load_terrain(terrain_path(str(given)), **options)
            except LavaError as error:
                raise self._as_written(error) from None
        for name in options if given is not None else ():
            if name != 'insist':
                raise validation.surplus(self._word(name), 'to a terrain that is not a file')
        return given

    def _word(self, name: str) -> str:
        return self.words.get(name, name)

    def _as_written(self, error: LavaError) -> LavaError:
        """Return an error with the word of the field that has the wrong value, if one has."""
        name = error.field.rpartition('.')[2].removesuffix(' file')
        value = vars(self).get(name)
        is_own = value is not None and str(value) == str(error.value)
        is_own &= name != 'path' and not isinstance(error, RefusalError)
        return error.named(self._word(name)) if is_own else error

    @property
    def _is_case(self) -> bool:
        return self.path is not None and Path(self.path).is_dir()

    @property
    def _is_elevation(self) -> bool:
        is_file = self.path is not None and not self._is_case
        return is_file and Path(str(self.path)).suffix.lower() in ELEVATIONS

    @property
    def _elevation(self) -> str | Path | Terrain | None:
        """The terrain that is given, or its file."""
        if self._is_elevation and self.terrain is not None:
            raise validation.conflict(f'the elevation {self.path}', self._word('terrain'))
        return self.path if self._is_elevation else self.terrain

    @property
    def _given(self) -> GivenVents:
        choices = {name: getattr(self, name) for name in RATE_FIELDS}
        choices = {name: value for name, value in choices.items() if value is not None}
        return GivenVents(self.vent, self.vents, self.effusion_rate, choices, self._word)

    def _terrain_options(self) -> dict[str, Any]:
        """Return the options of ``load_terrain`` that are given."""
        given = {name: getattr(self, name) for name in CASE_TERRAIN}
        if self.nodata not in (None, 'none'):
            try:
                given['nodata'] = float(self.nodata)
            except (TypeError, ValueError):
                expected = 'a number, or none'
                raise LavaError(self._word('nodata'), self.nodata, expected) from None
        if self.insist:
            given['insist'] = True
        return {name: value for name, value in given.items() if value is not None}

    def _load_scene(self) -> SourcedScene:
        """Return the scene of a file, of a terrain or of the demonstration."""
        for name in ('from_outline', 'solidified'):
            if getattr(self, name) is not None:
                raise validation.surplus(self._word(name), 'to a scene that is no case')
        options, given, terrain = self._terrain_options(), self._given, self.load_terrain()
        data: dict[str, Any] = {}
        if self.path is not None and not self._is_elevation:
            data, terrain = read_scene(self.path, terrain=terrain, options=options)
            if (onset := onset_from('scene', data)) is not None:
                # a table in place of that of the scene has the same time 0
                given = replace(given, choices={'start': date_text(onset), **given.choices})
        elif terrain is None:
            for name in filter(options.__contains__, CASE_TERRAIN):
                others = f'{self._word("terrain")} or a scene'
                raise validation.dependence(self._word(name), others)
            terrain = demo_terrain()
            data['vents'] = [
                {'position': (x, y), 'discharge': q, 'radius': 20.0, 'name': f'vent {index}'}
                for index, (x, y, q) in enumerate(DEMO_VENTS)
            ]
        elif self.has_vents:
            own = {'position': summit(terrain), 'name': 'summit'}
            data['vents'] = [usual_vent(terrain) | own]
        rows, (rates, origin) = given.rows(terrain), given.table()
        if rows:
            data['vents'] = given.of_rows(rows, rates, terrain)
        elif self.effusion_rate is not None:
            data['vents'] = given.of_scene(data.get('vents', []), rates)
        if rows or self.effusion_rate is not None:
            # the error in a table of the scene is that of the rates that are replaced
            data['rate_error'] = error_of_rates(rates, self.measured)
        terrain, data['emplaced_flows'] = self._with_flows(terrain, data.get('emplaced_flows', []))
        return self._completed('scene', data | self._onset(data, origin), terrain)

    def _load_case(self) -> SourcedScene:
        """Return the scene of a case."""
        assert self.path is not None
        files, given = find_case_files(self.path), self._given
        options = files.options
        known = {name: options[name] for name in (*CASE_TERRAIN, 'insist') if name in options}
        known |= self._terrain_options()
        ground = self.load_terrain() or _ground_of(files, known)
        ground, flows = self._with_flows(ground, [])
        stated = RATE_KEYS.names('case.effusion_rate', options.get('effusion_rate', {}))
        choices = validation.build(Options, 'case.effusion_rate', {**stated, **given.choices})
        rates, origin = given.table(choices)
        if not rates:
            rates, origin = read_effusion_rates('case', files.rates, choices)
        rows = self._rows_of_case(files, ground)
        width = options.get('low_pass', 0.0) if self.low_pass is None else self.low_pass
        first, last = rates[0].start, rates[-1].end
        start = options.get('start', first)
        start = validation.number('case.start', start, at_most=last, unit='s')
        series = series_of(rows, rates)
        if (initial := self._initial_flow(files, ground, series, start, origin)) is not None:
            start, ground, flows = initial.time, initial.ground, [*flows, initial.flow]
        usual = {'radius': VENT_RADIUS * ground.resolution} | {
            name: options[f'vent_{name}']
            for name in ('radius', 'temperature') if f'vent_{name}' in options
        }
        shared = ('lava', 'uncertainty', 'insist', *ENVIRONMENT)
        data = {name: options[name] for name in shared if name in options} | {
            'vents': [
                described(row, _since(start, fluxes), usual)
                for row, fluxes in zip(rows, series, strict=True)
            ],
            'rate_error': error_of_rates(rates, choices.measured),
            'emplaced_flows': flows,
            'events': read_case_events(files, ground, known, start),
        }
        if origin is not None:
            expected = 'a time [s] at which the year is from 1 to 9999'
            with refusing('case.start', start, expected, OverflowError):
                data['onset'] = date_text(origin + timedelta(seconds=start))
        width = validation.number('case.low_pass', width, at_least=0.0)
        return self._completed(
            'case', data, ground, CaseInputs(files, ground, rows, start, last, width, initial)
        )

    def _initial_flow(
        self, files: CaseFiles, ground: Terrain, series: Sequence[Series], first: float,
        origin: datetime | None,
    ) -> InitialFlow | None:
        """Return the flow from whose outline a case starts; None without one."""
        given = files.options.get('from_outline')
        label = 'case.from_outline'
        if self.from_outline is not None:
            given, label = {'time': self.from_outline}, self._word('from_outline')
        if self.solidified is not None:
            if given is None:
                raise validation.dependence(
                    self._word('solidified'), self._word('from_outline')
                )
            given = {**FROM_OUTLINE_KEYS(label, given), 'solidified': self.solidified}
        if given is None:
            return None
        if not (stated := files.options.get('outlines')):
            raise validation.dependence(label, 'outlines in case.yaml')
        expected = 'a list of outlines, at least one'
        outlines = [
            OUTLINE_KEYS(where, item)
            for where, item in validation.items('case.outlines', stated, expected, least=1)
        ]
        return initial_flow(
            given, outlines, files.folder, ground, series, first=first, origin=origin, label=label
        )

    def _rows_of_case(self, files: CaseFiles, ground: Terrain) -> tuple[VentRow, ...]:
        """Return the vents that are given, or those of a case."""
        rows = self._given.rows(ground)
        if not rows:
            rows = self._given.with_rate(read_vents('case', files.vents, ground))
            check_places(rows, ground, files.vents.name)
            return rows
        is_own = [row.discharge is not None for row in rows]
        if any(is_own) and not all(is_own):
            expected = 'one for every vent, or for none'
            raise LavaError(f'effusion rate of {rows[is_own.index(False)].name!r}', None, expected)
        return rows

    def _with_flows(
        self, terrain: Terrain, known: Sequence[EmplacedFlow]
    ) -> tuple[Terrain, list[EmplacedFlow]]:
        """Return a terrain raised by the given flows that are ground, and all other flows."""
        label = self._word('emplaced_flows')
        terrain, flows = read_flows(label, list(self.emplaced_flows), Path(), terrain)
        return terrain, [*known, *flows]

    def _completed(
        self, label: str, data: dict[str, Any], terrain: Terrain, case: CaseInputs | None = None
    ) -> SourcedScene:
        """Make the scene of plain data and of the inputs that a scene and a case share."""
        events = read_events(
            self._word('events'), list(self.events), Path(), terrain, self._terrain_options()
        )
        data['events'] = sorted([*data.get('events', []), *events], key=attrgetter('time'))
        if self.material is not None:
            data['lava'] = {'material': self.material}
        if self.insist:
            data['insist'] = True
        scene, material = scene_and_material(data, terrain, label=label)
        width = case.width if case is not None else self.low_pass or 0.0
        if width:
            scene = scene.on(lambda ground: low_pass(ground, width))
        return SourcedScene(scene, material, tuple(self._files(case)), case=case)

    def _onset(self, data: Mapping[str, Any], of_table: datetime | None) -> dict[str, str]:
        """Return the onset of a scene: of its table of rates, as given, or of its file."""
        given = Options(start=self.start).origin
        if given is not None and of_table is None:
            # the reader of a table checks the date
            check_date(self._word('start'), given)
        known = of_table or given
        if known is None:
            return {}
        has_own = any(
            isinstance(vent.get('effusion_rate', vent.get('discharge')), list | tuple)
            for vent in data.get('vents', ()) if isinstance(vent, Mapping)
        )
        own = onset_from('scene', data)
        is_replaced = self.effusion_rate is not None or self.vent or self.vents
        if own not in (None, known) and has_own and not is_replaced:
            assert own is not None
            expected = f'{date_text(own)}, the time 0 of the effusion rates of {self.path}'
            raise LavaError(self._word('start'), self.start, expected)
        return {'onset': date_text(known)}

    def _files(self, case: CaseInputs | None) -> Iterator[tuple[str, Path]]:
        """Yield the input files, as given and as paths."""
        named = [{'file': item} for item in (self._elevation, self.vents, self.effusion_rate)]
        yield from files_in([*named, *self.emplaced_flows, *self.events], Path())
        if case is not None:
            yield from case.files.named()
        elif self.path is not None and not self._is_elevation:
            path = find_file(self.path, 'examples', field='scene', expected='a YAML file')
            yield str(self.path), path
            yield from files_in(read_yaml('scene', path), path.parent)


def _ground_of(files: CaseFiles, options: Mapping[str, Any]) -> Terrain:
    """Read the elevation of a case, with the contours that the source of the case names."""
    ground = load_terrain(files.elevation, **options)
    contours = contours_in(str(files.options.get('source', '')))
    if contours is None:
        return ground
    return replace(ground, source=f'{ground.source}, {contours[0]}')


def scene_from_yaml(path: str | Path, *, terrain: Terrain | None = None) -> Scene:
    """Read the scene of a file or case; ``terrain`` replaces its own.

    Raises:
        LavaError: As ``SceneSource.load``.
    """
    return SceneSource(path=path, terrain=terrain).load().scene


class _Remarks(logging.Handler):
    """Collects the warnings of this thread."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.texts: list[str] = []
        self._thread = get_ident()

    def emit(self, record: logging.LogRecord) -> None:
        if record.thread == self._thread:
            self.texts.append(record.getMessage())


def _since(start: float, series: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return a discharge after a time ``start`` [s], which becomes 0."""
    before = [flux for time, flux in series if time <= start]
    later = [(time - start, flux) for time, flux in series if time > start]
    return [(0.0, before[-1] if before else 0.0), *later]
