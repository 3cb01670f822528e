# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Printed page of maps with legend, scale, north arrow, coordinates and notes."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
import logging
import math
from pathlib import Path
from typing import Any

import numpy as np

from lava_ros.errors import LavaError, Typed
from lava_ros.files.pictures import new_figure, read_picture, save_picture
from lava_ros.layers.frame import Frame
from lava_ros.products import overlays as overlay_files
from lava_ros.products import plot
from lava_ros.products.colours import picture_of, Scale, scale_of, STYLES
from lava_ros.products.export import georeference_of
from lava_ros.products.overlays import COLOURS, OverlayStyle
from lava_ros.products.page_layout import choose_page, DPI, Imprint, screen_page, shrink_title
from lava_ros.products.plot import halo, INK, Window
from lava_ros.scene.features import Feature
from lava_ros.scene.projection import transformed

_LOG = logging.getLogger(__name__)

#: Limits of the denominator of a scale.
MIN_SCALE, MAX_SCALE = 10.0, 1e8


@dataclass(frozen=True, eq=False)
class Panel:
    """A map on the page.

    Attributes:
        frame: Ground and vents.
        source: Its quantity: a key of ``colours.STYLES``.
        values: float, shape [rows, columns]; NaN leaves the ground.
        title: Its title; if empty, the title of the style.
        is_saturated: True if the values are clipped, so that true values may be larger.
        outlines: Cells whose outline is drawn, bool, shape [rows, columns], by name.
    """

    frame: Frame
    source: str
    values: np.ndarray
    title: str = ''
    is_saturated: bool = False
    outlines: Mapping[str, np.ndarray] | None = None

    @property
    def shown(self) -> np.ndarray:
        """Cells with values or inside outlines, bool, shape [rows, columns]."""
        cells = [np.isfinite(self.values), *(self.outlines or {}).values()]
        return np.asarray(np.logical_or.reduce(cells))

    @property
    def offset(self) -> tuple[float, float]:
        """Easting and northing [m] of the map frame's origin; 0, 0 if unknown."""
        return georeference_of(self.frame.scene).offset


def draw_sheet(
    panels: Sequence[Panel],
    output: str | Path,
    *,
    title: str,
    subtitle: str = '',
    notes: Mapping[str, str] | None = None,
    overlays: Mapping[str, Sequence[Feature]] | None = None,
    charts: Sequence[Callable[[Any], None]] = (),
    extent: Window | None = None,
    scale: float | None = None,
    imprint: Imprint | None = None,
    others: Sequence[Panel] = (),
    is_bare: bool = False,
) -> None:
    """Draw maps and charts on one page, in the layout with the largest lava.

    All maps show the same area, and maps of the same kind share a colour scale. Panels and
    overlays must be in the same coordinate system. The suffix of the file chooses the format.

    Args:
        panels: The maps.
        output: The file.
        title: Title of the page, and of the file in its metadata.
        subtitle: Line below the title.
        notes: Facts about the maps, by term.
        overlays: Features of each file by its name.
        charts: Functions that draw into the given axes.
        extent: Minimum extent of the maps: easting and northing [m] of the south-western and of
            the north-eastern corner; None for the lava with the places within reach.
        scale: The N of a scale 1:N on paper; None for the largest possible scale.
        imprint: Publisher of the page.
        others: Maps in other pictures that share the extent and the colours.
        is_bare: True for a picture of one map or chart without texts around it; an HTML page
            contains these.

    Raises:
        LavaError: If matplotlib is not installed, the maps do not fit on the page, the logo
            cannot be read, or the picture cannot be written.
    """
    notes, overlays, imprint = dict(notes or {}), overlays or {}, imprint or Imprint()
    logo = read_picture('--logo', imprint.logo) if imprint.logo else None
    alike = [*panels, *others]
    # the area of all maps, in projected coordinates
    limits = _union(_moved(item.frame.extent, item) for item in alike)
    bounds, margin = extent, 0.0
    if bounds is None:
        bounds = _union(_moved(plot.bounds_of(item.frame, item.shown), item) for item in alike)
        bounds = overlay_files.bounds_with_places(bounds, limits, overlays.values())
        margin = plot.MARGIN
    legend, charted = _legend(panels, overlays), len(panels) + len(charts)
    if scale is not None:
        notes['scale'] = f'1:{scale:,.0f} on A4 paper'.replace(',', ' ')
    least = plot.LEAST_CELLS * min(item.frame.resolution for item in alike)
    # the note on places beyond the map makes the map smaller
    for _ in range(2):
        names = [name for name, _ in legend]
        page = screen_page(bounds, names) if is_bare else (
            choose_page(charted, bounds, notes, names)
        )
        width, height = page.map_size
        if scale is None:
            around = _union([limits, bounds])
            view = plot.window_of(bounds, around, width / height, least, margin)
        else:
            view = _at_scale(bounds, scale, page.map_size)
        gone = [item for known in overlays.values() for item in overlay_files.hidden(known, view)]
        if beyond := ', '.join(filter(None, dict.fromkeys(item.name for item in gone))):
            notes['beyond the map'] = beyond
    for name, features in overlays.items():
        if count := sum(item in gone for item in features):
            _LOG.warning(f'{name}: {count} of {len(features)} features lie outside the map')
    interval = plot.contour_interval(alike[0].frame, _moved(view, alike[0], -1.0))
    legend = [
        (f'elevation contours every {interval:g} m' if name == _CONTOURS else name, handle)
        for name, handle in legend
        if interval or name != _CONTOURS
    ]
    scales = _scales(alike)
    with new_figure('plot', output, (page.width, page.height), DPI) as figure:
        for index, panel in enumerate(panels):
            axes, bar = page.axes(figure, index)
            _draw_panel(
                axes, panel, scales[panel.source], view, interval, overlays, has_north=index == 0
            )
            plot.draw_colour_bar(figure, figure.add_axes(bar), scales[panel.source])
        for index, draw in enumerate(charts, len(panels)):
            draw(page.axes(figure, index)[0])
        page.write(figure, title, subtitle, notes, legend, imprint, logo)
        author = ', '.join(filter(None, (imprint.author, imprint.agency)))
        save_picture(figure, output, title=title, author=author)


def _draw_panel(
    axes: Any,
    panel: Panel,
    scale: Scale,
    view: Window,
    interval: float,
    overlays: Mapping[str, Sequence[Feature]],
    *,
    has_north: bool,
) -> None:
    """Draw a map of an area in projected coordinates."""
    frame, window = panel.frame, _moved(view, panel, -1.0)
    picture = picture_of(panel.values, plot.shaded_ground(frame), scale)
    plot.draw_map(axes, frame, picture, window)
    plot.draw_contours(axes, frame, window, interval)
    system = georeference_of(frame.scene).system
    plot.draw_ticks(axes, panel.offset if system else None)
    if system:
        _draw_degrees(axes, window, panel.offset, system)
    if panel.source == 'arrival':
        plot.draw_isochrones(axes, frame, panel.values)
    for number, cells in enumerate((panel.outlines or {}).values()):
        if cells.any():
            look = _outline_style(number)
            axes.contour(
                *frame.centres, cells.astype(float), levels=[0.5],
                colors=look['color'], linewidths=look['linewidth'], linestyles=look['linestyle'],
            )
    first = len(panel.outlines or {})
    styled = [
        (features, OverlayStyle.of(number))
        for number, features in enumerate(overlays.values(), first)
    ]
    plot.draw_scale_bar(axes, window)
    if has_north:
        plot.draw_north(axes)
    overlay_files.draw_overlays(axes, styled, window, panel.offset, frame.vents)
    heading = panel.title or STYLES[panel.source].title
    text = axes.set_title(heading, loc='left', fontsize=10, color=INK, pad=5)
    shrink_title(text, axes)


#: Placeholder in a legend until the interval is chosen, at least as long as the final text.
_CONTOURS = 'elevation contours every 00000 m'


def _legend(
    panels: Sequence[Panel], overlays: Mapping[str, Sequence[Feature]]
) -> list[tuple[str, Any]]:
    """Return names and symbols of the elements of maps without a colour bar."""
    outlines = dict.fromkeys(name for panel in panels for name in panel.outlines or {})
    entries = [(_CONTOURS, _line(color=plot.CONTOUR['colors'], alpha=plot.CONTOUR['alpha']))]
    if any(plot.barriers_of(panel.frame) for panel in panels):
        entries.insert(0, ('barrier', _line(**plot.BARRIER)))
    if any(len(panel.frame.vents) for panel in panels):
        entries.insert(0, ('vent', _line(**plot.VENT)))
    if any(panel.source == 'arrival' for panel in panels):
        look = {'color': plot.ISOCHRONE['colors'], 'linewidth': plot.ISOCHRONE['linewidths']}
        entries.append(('isochrones of first arrival', _line(**look)))
    entries += [(name, _line(**_outline_style(index))) for index, name in enumerate(outlines)]
    count = len(outlines)
    return entries + [
        (name, OverlayStyle.of(number).handle(features))
        for number, (name, features) in enumerate(overlays.items(), count)
    ]


def _outline_style(number: int) -> dict[str, Any]:
    line = ('solid', 'dashed', 'dotted')[number % 3]
    return {'color': COLOURS[number % len(COLOURS)], 'linewidth': 1.5, 'linestyle': line}


def _at_scale(bounds: Window, scale: float, size: tuple[float, float]) -> Window:
    """Return the window around a rectangle [m] of a map of a size [inches] at a scale 1:N.

    Raises:
        LavaError: If the rectangle does not fit.
    """
    sides = [0.0254 * scale * length for length in size]
    spans = (bounds[2] - bounds[0], bounds[3] - bounds[1])
    if spans[0] > sides[0] or spans[1] > sides[1]:
        least = max(span / (0.0254 * length) for span, length in zip(spans, size, strict=True))
        raise LavaError(
            '--scale', scale if isinstance(scale, Typed) else f'1:{scale:g}',
            f'1:{math.ceil(least)} or smaller, so that lava and places, or the extent, fit on A4',
        )
    x, y = 0.5 * (bounds[0] + bounds[2]), 0.5 * (bounds[1] + bounds[3])
    return (x - 0.5 * sides[0], y - 0.5 * sides[1], x + 0.5 * sides[0], y + 0.5 * sides[1])


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
        result[source] = scale_of(source, values, is_saturated=is_saturated)
    return result


def _line(**look: Any) -> Any:
    from matplotlib.lines import Line2D

    return Line2D([], [], **look)


def _draw_degrees(axes: Any, window: Window, offset: tuple[float, float], system: str) -> None:
    """Draw longitudes along the upper edge and latitudes along the right edge, inside the map."""
    from matplotlib.ticker import MaxNLocator

    steps = np.linspace(0.0, 1.0, 9)
    x0, y0, x1, y1 = window
    box, figure = axes.get_position(), axes.figure
    inches = (box.width * figure.get_figwidth(), box.height * figure.get_figheight())
    for axis in (0, 1):
        x = x0 + steps * (x1 - x0) if axis == 0 else np.full(9, x1)
        y = np.full(9, y1) if axis == 0 else y0 + steps * (y1 - y0)
        try:
            easting, northing = x + offset[0], y + offset[1]
            degrees = transformed(system, 'EPSG:4326', easting, northing)[axis]
        except (LavaError, ValueError):
            # rasterio is missing, or the map is outside the projection
            return
        # continue beyond the antimeridian
        degrees = np.unwrap(degrees, period=360.0)
        low, high = degrees[0], degrees[-1]
        if not low < high:
            continue
        ticks = MaxNLocator(4, steps=[1, 2, 5, 10]).tick_values(low, high)
        digits = max(0, math.ceil(-math.log10(ticks[1] - ticks[0]) - 1e-9))
        places = np.interp(ticks, degrees, steps, left=-1.0, right=2.0)
        # keep the corner of the north arrow free, and labels half their width away from the end
        is_inside = (places > 0.1) & (places < 1.0 - max(0.36 / inches[axis], 0.07))
        ticks, places = ticks[is_inside], places[is_inside]
        # a label needs 0.8 inches
        gap = inches[axis] * float(np.diff(places).min(initial=1.0))
        every = math.ceil(0.8 / gap)
        for value, along in zip(ticks[::every], places[::every], strict=True):
            value = (value + 180.0) % 360.0 - 180.0
            letter = ('WE', 'SN')[axis][int(value >= 0.0)]
            is_antimeridian = round(abs(value), digits) == 180.0
            words = f'{abs(value):.{digits}f}°' + ('' if is_antimeridian else f' {letter}')
            place = (along, 1.0) if axis == 0 else (1.0, along)
            inward = ((0, -3), (-3, 0))[axis]
            axes.annotate(
                words, place, inward, xycoords='axes fraction', textcoords='offset points',
                fontsize=6.5, color=INK, path_effects=halo(), rotation=-90.0 * axis,
                ha='right' if axis else 'center', va='center' if axis else 'top',
            )
