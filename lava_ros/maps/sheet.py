# Copyright 2026 lava_ros contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.


"""A page of maps that can be printed: legend, scale, north, coordinates, and how it was made."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
import logging
import math
from pathlib import Path
from textwrap import wrap
from typing import Any

import numpy as np

from lava_ros.errors import LavaError
from lava_ros.files import save_picture
from lava_ros.files.optional import require
from lava_ros.maps import plot
from lava_ros.maps.export import placement_of
from lava_ros.maps.frames import Frame
from lava_ros.maps.plot import halo, INK, Scale, Window
from lava_ros.scene.features import Feature
from lava_ros.scene.projection import transformed

_LOG = logging.getLogger(__name__)

#: What every page says.
BANNER = 'SIMULATION, NOT VERIFIED'

#: Sides of A4 [inches], and pixels per inch of a picture.
_LONG, _SHORT, _DPI = 11.69, 8.27, 150

#: Around the page, above the maps, and around each map: left, right, bottom, top [inches].
_MARGIN, _HEADER, _AROUND = 0.4, 0.98, (0.42, 0.78, 0.42, 0.3)

#: Height of a line of the notes, and width of a letter [inches].
_LINE, _LETTER = 0.15, 0.061

#: Colours of outlines and overlays, by turns.
_COLOURS = ('#0b3c8c', '#111111', '#00693c', '#7b1fa2', '#8c510a')


@dataclass(frozen=True, eq=False)
class Panel:
    """A map on the page.

    Attributes:
        frame: Ground and vents.
        source: What it shows: a key of ``plot.STYLES``.
        values: float, shape [rows, columns]; NaN leaves the ground.
        title: What is above it; empty: that of the style.
        is_saturated: Whether there may be larger values than these.
        fissures: Ends of vents that are lines [m], shape [count, 2, 2].
        outlines: Cells whose outline is drawn, bool, shape [rows, columns], by name.
    """

    frame: Frame
    source: str
    values: np.ndarray
    title: str = ''
    is_saturated: bool = False
    fissures: Any = ()
    outlines: Mapping[str, np.ndarray] | None = None

    @property
    def shown(self) -> np.ndarray:
        """Cells that are to be seen, bool, shape [rows, columns]."""
        cells = [np.isfinite(self.values), *(self.outlines or {}).values()]
        return np.asarray(np.logical_or.reduce(cells))

    @property
    def offset(self) -> tuple[float, float]:
        """Easting and northing [m] of the map frame's origin; 0, 0 where nobody knows."""
        return placement_of(self.frame.scene).offset


def draw_sheet(
    panels: Sequence[Panel],
    output: str | Path,
    *,
    title: str,
    subtitle: str = '',
    notes: Mapping[str, str] | None = None,
    overlays: Mapping[str, Sequence[Feature]] | None = None,
    charts: Sequence[Callable[[Any], None]] = (),
) -> None:
    """Draw maps, and optional charts, on one page whose layout shows the lava largest.

    All maps show the same area, and maps of the same kind share a colour scale. Panels and
    overlays must be in the same coordinate system. The suffix of the file chooses the format.
    LavaError where matplotlib is not installed, or the picture cannot be written.
    """
    require('matplotlib.figure', 'plot', str(output))
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    notes, overlays = notes or {}, overlays or {}
    # what all maps show, in projected coordinates
    bounds = _union(_moved(plot.bounds_of(item.frame, item.shown), item) for item in panels)
    limits = _union(_moved(plot.extent_of(item.frame), item) for item in panels)
    page = _page(len(panels) + len(charts), bounds, notes)
    least = plot.LEAST_CELLS * min(item.frame.resolution for item in panels)
    width, height = page.map_size
    seen = plot.window_of(bounds, limits, width / height, least)
    figure = Figure(figsize=(page.width, page.height), dpi=_DPI, facecolor='white')
    FigureCanvasAgg(figure)
    scales = _scales(panels)
    handles: dict[str, Any] = {}
    for index, panel in enumerate(panels):
        axes, bar = page.axes(figure, index)
        ground, window = plot.shaded_ground(panel.frame), _moved(seen, panel, -1.0)
        scale = scales[panel.source]
        picture = plot.picture_of(panel.values, ground, scale)
        plot.draw_map(axes, panel.frame, picture, window, panel.fissures)
        plot.draw_contours(axes, panel.frame, window)
        system = placement_of(panel.frame.scene).system
        plot.draw_ticks(axes, panel.offset if system else None)
        if system:
            _draw_degrees(axes, window, panel.offset, system)
        for number, (name, cells) in enumerate((panel.outlines or {}).items()):
            handles.setdefault(name, _outline(axes, panel.frame, cells, number))
        for number, (name, features) in enumerate(overlays.items(), len(panel.outlines or {})):
            handles.setdefault(name, _overlay(axes, features, panel.offset, number))
        if index == 0:
            plot.draw_north(axes)
            if len(panels) < 4:
                plot.draw_overview(axes, panel.frame, ground, panel.shown, window)
        plot.draw_scale_bar(axes, window)
        plot.draw_colour_bar(figure, figure.add_axes(bar), scale)
        heading = panel.title or plot.STYLES[panel.source].title
        axes.set_title(heading, loc='left', fontsize=10, color=INK, pad=5)
    _warn_of_hidden(overlays, seen)
    for index, draw in enumerate(charts, len(panels)):
        draw(page.axes(figure, index)[0])
    if any(len(panel.frame.vents) for panel in panels):
        handles = {'vent': _line(**plot.VENT)} | handles
    page.write(figure, title, subtitle, notes, handles)
    save_picture(figure, output)


def _moved(window: Window, panel: Panel, sign: float = 1.0) -> Window:
    east, north = (sign * value for value in panel.offset)
    return (window[0] + east, window[1] + north, window[2] + east, window[3] + north)


def _union(windows: Iterable[Window]) -> Window:
    west, south, east, north = zip(*windows, strict=True)
    return (min(west), min(south), max(east), max(north))


def _scales(panels: Sequence[Panel]) -> dict[str, Scale]:
    result = {}
    for source in dict.fromkeys(panel.source for panel in panels):
        same = [panel for panel in panels if panel.source == source]
        values = np.concatenate([panel.values[np.isfinite(panel.values)] for panel in same])
        is_saturated = any(panel.is_saturated for panel in same)
        result[source] = plot.scale_of(source, values, is_saturated=is_saturated)
    return result


@dataclass(frozen=True)
class _Page:
    """The layout of a page: its size, the height of its footer [inches], and its grid."""

    width: float
    height: float
    rows: int
    columns: int
    footer: float

    @property
    def map_size(self) -> tuple[float, float]:
        width = (self.width - 2.0 * _MARGIN) / self.columns - _AROUND[0] - _AROUND[1]
        room = self.height - _HEADER - self.footer
        return width, room / self.rows - _AROUND[2] - _AROUND[3]

    def axes(self, figure: Any, index: int) -> tuple[Any, tuple[float, float, float, float]]:
        """Axes for a map, and where its colours go."""
        width, height = self.map_size
        row, column = divmod(index, self.columns)
        left = _MARGIN + column * (width + _AROUND[0] + _AROUND[1]) + _AROUND[0]
        top = self.height - _HEADER - row * (height + _AROUND[2] + _AROUND[3]) - _AROUND[3]
        room = (left / self.width, (top - height) / self.height)
        size = (width / self.width, height / self.height)
        bar = ((left + width + 0.08) / self.width, room[1], 0.13 / self.width, size[1])
        return figure.add_axes((*room, *size)), bar

    def write(
        self,
        figure: Any,
        title: str,
        subtitle: str,
        notes: Mapping[str, str],
        handles: Mapping[str, Any],
    ) -> None:
        """Write all that is not on a map."""

        def text(x: float, down: float, words: str, **look: Any) -> Any:
            y = 1.0 - down / self.height
            return figure.text(x / self.width, y, words, va='center', color=INK, **look)

        from matplotlib.patches import Rectangle

        strip = (0.0, 1.0 - 0.22 / self.height)
        amber = Rectangle(strip, 1.0, 0.22 / self.height, color='#f5c542', linewidth=0.0)
        figure.add_artist(amber)
        text(0.5 * self.width, 0.11, BANNER, fontsize=8.5, weight='bold', ha='center')
        # a bold letter is 0.65 of its size wide
        size = min(16.0, (self.width - 2.0 * _MARGIN) * 72.0 / (0.65 * max(len(title), 1)))
        text(_MARGIN, 0.5, title, fontsize=size, weight='bold')
        text(_MARGIN, 0.8, subtitle, fontsize=9)
        if handles:
            figure.legend(
                handles.values(),
                handles.keys(),
                loc='upper left',
                bbox_to_anchor=(_MARGIN / self.width, self.footer / self.height),
                ncols=6,
                fontsize=7.5,
                frameon=False,
                borderaxespad=0.0,
                borderpad=0.0,
            )
        columns = _columns(notes, self.width)
        for number, lines in enumerate(columns):
            left = _MARGIN + number * (self.width - 2.0 * _MARGIN) / len(columns)
            for line, words in enumerate(lines):
                down = self.height - self.footer + 0.3 + (line + 0.5) * _LINE
                text(left, down, words, fontsize=7.5)


def _page(count: int, bounds: Window, notes: Mapping[str, str]) -> _Page:
    """The page on which the lava is largest."""
    width, height = (max(bounds[axis + 2] - bounds[axis], 1.0) for axis in (0, 1))

    def size(page: _Page) -> float:
        room = page.map_size
        # a place that stays empty looks like a map that is missing
        full = count / (page.rows * page.columns)
        return min(room[0] / width, room[1] / height) * math.sqrt(full)

    pages = []
    for sides in ((_LONG, _SHORT), (_SHORT, _LONG)):
        footer = 0.45 + _LINE * max((len(lines) for lines in _columns(notes, sides[0])), default=0)
        for columns in range(1, count + 1):
            rows = math.ceil(count / columns)
            page = _Page(*sides, rows=rows, columns=columns, footer=footer)
            if min(page.map_size) > 0.8:
                pages.append(page)
    if not pages:
        raise LavaError('maps', count, 'fewer maps: they do not fit on one page')
    return max(pages, key=size)


def _columns(notes: Mapping[str, str], width: float) -> list[list[str]]:
    """The notes as lines, in as many columns as are readable."""
    count = round(width / 3.9)
    letters = int((width - 2.0 * _MARGIN) / count / _LETTER) - 2
    blocks = [
        wrap(f'{term}: {words}', letters, subsequent_indent='    ')
        for term, words in notes.items()
    ]
    total = sum(map(len, blocks))
    columns: list[list[str]] = [[]]
    for block in blocks:
        if len(columns) < count and len(columns[-1]) >= total / count:
            columns.append([])
        columns[-1] += block
    return [*columns, *([] for _ in range(count - len(columns)))]


def _line(**look: Any) -> Any:
    from matplotlib.lines import Line2D

    return Line2D([], [], **look)


def _outline(axes: Any, frame: Frame, cells: np.ndarray, number: int) -> Any:
    """Draw the outline of some cells; returns what the legend shows."""
    style, colour = ('solid', 'dashed', 'dotted')[number % 3], _COLOURS[number % len(_COLOURS)]
    if cells.any():
        axes.contour(
            *plot.middles_of(frame), cells.astype(float), levels=[0.5], colors=colour,
            linewidths=1.5, linestyles=style,
        )
    return _line(color=colour, linewidth=1.5, linestyle=style)


def _overlay(
    axes: Any, features: Sequence[Feature], offset: tuple[float, float], number: int
) -> Any:
    """Draw features of others; returns what the legend shows."""
    colour = _COLOURS[number % len(_COLOURS)]
    point: dict[str, Any] = {'linestyle': 'none', 'marker': 'o', 'markersize': 5, 'color': colour}
    point['markeredgecolor'] = 'white'
    line: dict[str, Any] = {'color': colour, 'linewidth': 1.4}
    for feature in features:
        for ring in feature.rings:
            x, y = (ring - offset).T
            look = point if feature.kind == 'Point' else line
            axes.plot(x, y, path_effects=halo(), zorder=5, scalex=False, scaley=False, **look)
        if feature.name and feature.kind == 'Point':
            axes.annotate(
                feature.name, (x[0], y[0]), (4, 4), textcoords='offset points', fontsize=7,
                color=colour, path_effects=halo(), zorder=6, annotation_clip=True,
            )
    return _line(**(point if all(item.kind == 'Point' for item in features) else line))


def _warn_of_hidden(overlays: Mapping[str, Sequence[Feature]], seen: Window) -> None:
    """Log which overlays have features that are not on the map."""
    low, high = seen[:2], seen[2:]
    for name, features in overlays.items():
        count = sum(
            not any(((ring >= low) & (ring <= high)).all(axis=1).any() for ring in item.rings)
            for item in features
        )
        if count:
            _LOG.warning(f'{name}: {count} of {len(features)} features lie outside the map')


def _draw_degrees(axes: Any, window: Window, offset: tuple[float, float], system: str) -> None:
    """Longitudes along the upper edge, latitudes along the right one, inside the map."""
    from matplotlib.ticker import MaxNLocator

    steps = np.linspace(0.0, 1.0, 9)
    x0, y0, x1, y1 = window
    for axis in (0, 1):
        x = x0 + steps * (x1 - x0) if axis == 0 else np.full(9, x1)
        y = np.full(9, y1) if axis == 0 else y0 + steps * (y1 - y0)
        try:
            easting, northing = x + offset[0], y + offset[1]
            degrees = transformed(system, 'EPSG:4326', easting, northing)[axis]
        except (LavaError, ValueError):
            # without rasterio, or outside the projection
            return
        low, high = degrees[0], degrees[-1]
        if not low < high:
            return
        ticks = MaxNLocator(4, steps=[1, 2, 5, 10]).tick_values(low, high)
        digits = max(0, math.ceil(-math.log10(ticks[1] - ticks[0]) - 1e-9))
        for value in ticks:
            share = float(np.interp(value, degrees, steps, left=-1.0, right=2.0))
            # the corner belongs to the north arrow, and both edges want the other
            if 0.1 < share < 0.93:
                letter = ('WE', 'SN')[axis][int(value >= 0.0)]
                words = f'{abs(value):.{digits}f}° {letter}'
                place = (share, 1.0) if axis == 0 else (1.0, share)
                inward = ((0, -3), (-3, 0))[axis]
                axes.annotate(
                    words, place, inward, xycoords='axes fraction', textcoords='offset points',
                    fontsize=6.5, color=INK, path_effects=halo(), rotation=-90.0 * axis,
                    ha='right' if axis else 'center', va='center' if axis else 'top',
                )
