# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Page of maps of runs on disk: `lava map`, and the picture of `lava map`."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import tzinfo
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from lava_ros.errors import LavaError, RefusalError
from lava_ros.forecast.observations import observed_in_file
from lava_ros.forecast.scores import brier_parts
from lava_ros.layers.numbers import duration
from lava_ros.products.colours import STYLES
from lava_ros.products.page_layout import BANNER, Imprint
from lava_ros.products.plot import isochrone_times, MAX_DRAWN_ISOCHRONES, Window
from lava_ros.products.reliability import draw_reliability
from lava_ros.products.run_page import dated, read_run, Run
from lava_ros.products.sheet import draw_sheet, Panel
from lava_ros.scene.features import Feature
from lava_ros.scene.onset import Onset
from lava_ros.scene.projection import in_degrees, projected, system_name


@dataclass(frozen=True, eq=False)
class RunsPage:
    """The content of a page of runs.

    Attributes:
        runs: The runs.
        panels: Their maps.
        title: Title of the page.
        subtitle: Line below it.
        notes: Facts by term.
        overlays: Features of each file by its name.
        charts: Functions that draw into the given axes.
        scores: Scores of the ensembles by the name of the run.
        window: Minimum extent of the maps [m]; None for the lava.
        scale: The N of a scale 1:N; None for the largest.
    """

    runs: Sequence[Run]
    panels: Sequence[Panel]
    title: str
    subtitle: str
    notes: Mapping[str, str]
    overlays: Mapping[str, Sequence[Feature]]
    charts: Sequence[Callable[[Any], None]]
    scores: Mapping[str, Mapping[str, float]]
    window: Window | None
    scale: float | None

    @property
    def names(self) -> list[str]:
        """Titles of the maps."""
        return [item.title or STYLES[item.source].title for item in self.panels]

    def draw(self, output: str | Path, imprint: Imprint | None = None) -> None:
        """Draw the page to print; raise LavaError if that fails."""
        draw_sheet(
            self.panels, output, title=self.title, subtitle=self.subtitle, notes=self.notes,
            overlays=self.overlays, charts=self.charts, extent=self.window, scale=self.scale,
            imprint=imprint,
        )

    def draw_pictures(self, folder: Path) -> list[tuple[str, Path]]:
        """Draw each map and chart as a picture for a screen, and return their titles and paths.

        Raises:
            LavaError: If that fails.
        """
        drawn = []
        parts: list[tuple[str, Sequence[Panel], Sequence[Callable[[Any], None]]]] = [
            *((name, [panel], ()) for name, panel in zip(self.names, self.panels, strict=True)),
            *(('Reliability of the probabilities', (), [chart]) for chart in self.charts),
        ]
        for number, (name, panels, charts) in enumerate(parts):
            path = folder / f'picture_{number}.png'
            # the page has the title
            shown = [replace(panel, title=' ') for panel in panels]
            draw_sheet(
                shown, path, title=name, overlays=self.overlays if panels else {}, charts=charts,
                extent=self.window, others=self.panels, is_bare=True,
            )
            drawn.append((name, path))
        return drawn


def draw_runs(
    paths: Sequence[str | Path], output: str | Path, *, imprint: Imprint | None = None,
    **options: Any,
) -> dict[str, Any]:
    """Draw bags and ensembles on one page to print.

    ``options`` are as in ``read_page``.

    Returns:
        The text, titles and scores of the page as plain data.

    Raises:
        LavaError: If a run or a file cannot be read, the runs cannot be compared, or the picture
            cannot be written.
    """
    page = read_page(paths, **options)
    page.draw(output, imprint)
    return {
        'title': page.title,
        'summary': page.subtitle,
        'banner': BANNER,
        'notes': page.notes,
        'maps': page.names,
        'scores': page.scores,
        'runs': {run.name: run.quality() for run in page.runs},
    }


def read_page(
    paths: Sequence[str | Path],
    *,
    node: str | None = None,
    layers: Sequence[str] = (),
    time: float | None = None,
    title: str | None = None,
    volcano: str | None = None,
    date: str | None = None,
    source: str | None = None,
    overlays: Mapping[str, Sequence[Feature]] = {},
    observed: str | None = None,
    extent: Sequence[float] | None = None,
    scale: float | None = None,
    onset: Onset | None = None,
    zone: tzinfo | None = None,
) -> RunsPage:
    """Read bags and ensembles for one page.

    Texts and files are the options of `lava map`, and ``overlays`` are features of
    ``features.load_files``. ``node`` is the full name or the namespace of a
    node of the bags, None for the only one. ``time`` is a simulated time [s], None for the last
    one; without ``layers``, the default maps are drawn. ``extent`` is west, south, east and north
    in the coordinates of the terrain [m], or in degrees; ``scale`` is the N of 1:N. Without
    ``onset``, the common onset of the runs is used; ``zone`` is the time zone of local times, None
    for the zone of this machine.

    Raises:
        LavaError: If a run or a file cannot be read, or the runs cannot be compared.
    """
    runs = [read_run(path, node=node, time=time, wanted=layers) for path in paths]
    if len({run.name for run in runs}) < len(runs):
        runs = [
            replace(run, name=f'{Path(path).resolve().parent.name}/{run.name}')
            for path, run in zip(paths, runs, strict=True)
        ]
    _check_together(runs)
    shown = list(_shown(runs, layers))
    window = None if extent is None else _window(extent, runs)
    features = {
        name: [item.on(runs[0].terrain) for item in items] for name, items in overlays.items()
    }
    charts: list[Callable[[Any], None]] = []
    scores = {}
    if observed is not None:
        masks = {run.name: observed_in_file(observed, run.terrain) for run in runs}
        shown = [
            (run, replace(panel, outlines={'observed lava': masks[run.name][0]}))
            for run, panel in shown
        ]
        for run in (run for run in runs if run.ensemble is not None):
            lava, known = masks[run.name]
            percent = run.panels['inundation_probability'].values[known]
            likely = 0.01 * np.nan_to_num(percent)
            shown_as = run.name if len(runs) > 1 else ''
            chart = partial(draw_reliability, probability=likely, came=lava[known], name=shown_as)
            charts.append(chart)
            parts = brier_parts(likely, lava[known])
            scores[run.name] = {'brier_score': parts.score, 'brier_skill': parts.skill}
    title = title or ' / '.join(dict.fromkeys(run.title for run in runs))
    if volcano:
        title = f'{volcano}: {title}'
    subtitle = runs[0].summary if len(runs) == 1 else ''
    notes = {'date': date} if date else {}
    onset = dated(onset, zone, runs)
    if onset is not None:
        notes |= _moments(onset, runs, [panel for _, panel in shown])
    notes |= _facts(runs)
    if source:
        notes['elevation'] = f'{source}, {notes["elevation"].rpartition(", ")[2]}'
    panels = [panel for _, panel in shown]
    return RunsPage(
        runs, panels, title, subtitle, notes, features, charts, scores, window, scale
    )


def _window(extent: Sequence[float], runs: Sequence[Run]) -> Window:
    """Return the extent in the terrain's coordinates.

    Raises:
        LavaError: If the extent contains no terrain of a run.
    """
    west, south, east, north = (float(value) for value in extent)
    terrain = runs[0].terrain
    is_geographic = in_degrees(terrain, (west, south), (east, north))
    if is_geographic and east < 0.0 < west:
        # across the antimeridian
        east += 360.0
    if not (west < east and south < north):
        expected = 'WEST SOUTH EAST NORTH, west < east and south < north'
        raise LavaError('--extent', [*extent], expected)
    if is_geographic:
        corners = [projected(terrain, x, y) for x in (west, east) for y in (south, north)]
        (west, south), (east, north) = np.min(corners, axis=0), np.max(corners, axis=0)
    window = (float(west), float(south), float(east), float(north))
    for run in runs:
        x0, y0, x1, y1 = run.terrain.extent
        x, y = run.terrain.offset
        if west >= x1 + x or east <= x0 + x or south >= y1 + y or north <= y0 + y:
            expected = f'an extent that overlaps {run.name} {run.terrain.bounds(projected=True)}'
            raise LavaError('--extent', [*extent], expected)
    return window


def _moments(onset: Onset, runs: Sequence[Run], panels: Sequence[Panel]) -> dict[str, str]:
    """Return the onset, and the dates of maps and of isochrones."""
    notes = {'start of the eruption': onset.words()}
    for end in dict.fromkeys(run.end for run in runs):
        if end is not None:
            term = 'maps show' if runs[0].ensemble is None else 'forecast until'
            notes[term] = '; '.join(filter(None, (notes.get(term), onset.words(end))))
    last = max(
        (float(np.nanmax(panel.values)) for panel in panels
         if panel.source == 'arrival' and np.isfinite(panel.values).any()),
        default=0.0,
    )
    if last > 0.0:
        times = map(float, isochrone_times(last, MAX_DRAWN_ISOCHRONES))
        notes['isochrones'] = '; '.join(f'{duration(it)}: {onset.words(it)}' for it in times)
    return notes


def _check_together(runs: Sequence[Run]) -> None:
    names = [run.name for run in runs]
    if len(set(names)) < len(names):
        problem = f'Several runs have the same name: {", ".join(names)}'
        raise RefusalError('runs', problem, 'Rename a folder')
    # the full definition may add a vertical datum, which maps do not use
    systems = {
        (land.epsg, land.wkt if land.epsg is None else None)
        for land in (run.terrain for run in runs)
    }
    if len(systems) > 1:
        labels = ' and '.join(system_name(*item) for item in systems)
        problem = f'The runs have different coordinate systems: {labels}'
        raise RefusalError('runs', problem, 'Draw them on separate pages')


def _shown(runs: Sequence[Run], layers: Sequence[str]) -> Iterator[tuple[Run, Panel]]:
    names = list(layers) or runs[0].usual
    if not layers and len(runs) > 1:
        names = [name for name in names if all(name in run.panels for run in runs)][:1]
    for name in names or ['thickness']:
        for run in runs:
            if name not in run.panels:
                expected = f'one of {", ".join(run.panels)}, which {run.name} has'
                raise LavaError('--layers', name, expected)
            panel = run.panels[name]
            title = panel.title or STYLES[panel.source].title
            yield run, replace(panel, title=f'{run.name}: {title}') if len(runs) > 1 else panel


def _facts(runs: Sequence[Run]) -> dict[str, str]:
    """Return the facts of the runs, with the names of the runs where they differ."""
    notes = {}
    facts = [run.facts if len(runs) == 1 else {'result': run.summary, **run.facts} for run in runs]
    for term in dict.fromkeys(term for known in facts for term in known):
        texts = {
            run.name: known[term] for run, known in zip(runs, facts, strict=True) if term in known
        }
        if len(texts) == len(runs) and len(set(texts.values())) == 1:
            notes[term] = next(iter(texts.values()))
        else:
            notes[term] = '; '.join(f'{name}: {text}' for name, text in texts.items())
    return notes
