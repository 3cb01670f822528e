# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Elements of maps over shaded relief; ``sheet.py`` combines maps into a page."""

import math
from textwrap import fill
from typing import Any

import numpy as np

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.layers.frame import Frame
from lava_ros.layers.numbers import area_words, duration
from lava_ros.products.colours import GROUND, round_up, Scale, UNIT_WORDS
from lava_ros.scene.terrain import crest_lines

#: Margin around the flow, as a fraction of its size.
MARGIN = 0.18

#: Minimum number of cells along a side of the drawn part.
LEAST_CELLS = 24

INK = '#222222'

#: Colour of the sea before it is shaded, RGBA.
SEA = (0.66, 0.78, 0.88, 1.0)

#: Style of vents in maps and legends.
VENT: dict[str, Any] = {
    'linestyle': 'none',
    'marker': '^',
    'markersize': 6,
    'markerfacecolor': 'white',
    'markeredgecolor': 'black',
    'markeredgewidth': 0.9,
}

#: Identifiers of the labels of isochrones and contours, and of the scale bar.
ISOCHRONE_LABEL, CONTOUR_LABEL = 'isochrone label', 'contour label'
SCALE_BAR = 'scale bar'

#: Styles of elevation contours and isochrones.
CONTOUR: dict[str, Any] = {'colors': '#3b352a', 'alpha': 0.5}
ISOCHRONE: dict[str, Any] = {'colors': '#101010', 'linewidths': 0.7}
#: Style of the crests of barriers in maps and legends.
BARRIER: dict[str, Any] = {'color': '#3d2b1f', 'linewidth': 1.5}

#: Minimum range of slopes of a terrain with relief, rise over run.
MIN_SLOPES = 1e-3

#: Distance of the lowest label of the y axis from the corner [inches].
CORNER = 0.3

# Round steps of coordinates and elevations.
_GRID = (1.0, 2.0, 5.0, 10.0)

Window = tuple[float, float, float, float]

#: Times between isochrones [s], and maximum number of isochrones.
_STEPS = (
    *(60, 300, 600, 1800, 3600, 7200, 6 * 3600, 12 * 3600),
    *(days * 86_400 for days in (1, 2, 3, 7)),
)
MAX_ISOCHRONES = 12

#: Maximum number of isochrones on a printed map.
MAX_DRAWN_ISOCHRONES = 6


def titles(frame: Frame) -> tuple[str, str]:
    """Return the title of a frame, and a line with its areas and maximum thickness."""
    areas = {'standing lava': frame.standing_area}
    if frame.inundated is not None:
        areas = {'inundated': frame.area(frame.inundated), **areas}
    facts = [f'{area_words(area)} {name}' for name, area in areas.items() if area]
    facts = facts or ['no lava']
    if math.isfinite(thickest := frame.thickest):
        prefix = 'over' if frame.layers['thickness'].is_saturated else 'up to'
        facts.append(f'{prefix} {thickest:.3g} m thick')
    title = 'Lava flow' if frame.time is None else f'Lava flow after {duration(frame.time)}'
    return title, '  ·  '.join(facts)


def time_note(asked: float | None, frame: Frame) -> str:
    """Return a note if the maps of a frame are of another time than the requested one [s]."""
    if asked is None or frame.time is None or abs(asked - frame.time) < 1.0:
        return ''
    shown, wanted = (f'{duration(time)} ({time:.0f} s)' for time in (frame.time, asked))
    if frame.time > asked:
        return f'maps at {shown}, the end of the time step that passes {wanted}'
    return f'maps at {shown}, the newest of the recording at or before {wanted}'


def isochrone_times(last: float, most: int = MAX_ISOCHRONES) -> np.ndarray:
    """Return ``most`` or fewer round times [s]; the last one is at or after ``last`` [s]."""
    longest = max(_STEPS[-1], last / most)
    step = next((item for item in _STEPS if last <= item * most), longest)
    return step * np.arange(1, math.ceil(last / step) + 1)


def barriers_of(frame: Frame) -> list[np.ndarray]:
    """Return the crests of barriers, map positions [m], each of shape [points, 2]."""
    terrain = frame.scene.get('terrain') or {}
    try:
        crests = crest_lines('barriers', terrain.get('barriers', ()))
        offset = validation.pair('offset', terrain.get('offset', (0.0, 0.0)))
    except LavaError:
        # bags of other programs may contain other data
        return []
    return [np.array(crest) - offset for crest in crests]


def bounds_of(frame: Frame, shown: np.ndarray) -> Window:
    """Return the bounds of a mask [rows, columns] and the vents; the terrain if both are empty."""
    x, y = frame.centres
    xs = [*x[shown.any(axis=0)], *frame.vents[:, 0]]
    ys = [*y[shown.any(axis=1)], *frame.vents[:, 1]]
    return (min(xs), min(ys), max(xs), max(ys)) if xs else frame.extent


def window_of(
    bounds: Window, limits: Window, aspect: float, least: float, margin: float = MARGIN
) -> Window:
    """Return the window to draw: ``bounds`` with a margin, inside ``limits`` where it fits.

    The window is ``aspect`` times as wide as high, and at least ``least`` [m] in both directions.
    """
    x0, y0, x1, y1 = bounds
    x0, x1 = _widened(x0, x1, margin, limits[0], limits[2])
    y0, y1 = _widened(y0, y1, margin, limits[1], limits[3])
    width, height = max(x1 - x0, least), max(y1 - y0, least)
    width, height = max(width, height * aspect), max(height, width / aspect)
    left = _inside(0.5 * (x0 + x1 - width), width, limits[0], limits[2])
    bottom = _inside(0.5 * (y0 + y1 - height), height, limits[1], limits[3])
    return (left, bottom, left + width, bottom + height)


def _widened(
    first: float, last: float, margin: float, low: float, high: float
) -> tuple[float, float]:
    """Add a margin, a fraction of the length, to both ends of a span, within limits."""
    more = margin * (last - first)
    return min(first, max(first - more, low)), max(last, min(last + more, high))


def _inside(start: float, length: float, low: float, high: float) -> float:
    """Move a span into limits; a longer span is centred on them."""
    if length >= high - low:
        return 0.5 * (low + high - length)
    return min(max(start, low), high - length)


def shaded_ground(frame: Frame) -> np.ndarray:
    """Return the relief lit from the north-west, RGBA 0..1, shape [rows, columns, 4]."""
    from matplotlib.colors import LightSource, LinearSegmentedColormap

    known = np.isfinite(frame.elevation)
    low, high = float(np.nanmin(frame.elevation)), float(np.nanmax(frame.elevation))
    elevation = np.where(known, frame.elevation, low)
    light = LightSource(azdeg=315.0, altdeg=42.0)
    # row 0 is the south here, and the top for LightSource
    shade = light.hillshade(
        elevation[::-1], vert_exag=1.6, dx=frame.resolution, dy=frame.resolution
    )[::-1]
    if max(np.ptp(slope) for slope in np.gradient(elevation, frame.resolution)) < MIN_SLOPES:
        # LightSource would stretch rounding errors
        shade = np.full(elevation.shape, 0.5)
    tint = LinearSegmentedColormap.from_list('ground', GROUND)
    colours = tint((elevation - low) / max(high - low, 1e-6))
    level = (frame.scene.get('terrain') or {}).get('sea_level')
    if isinstance(level, int | float):
        colours[frame.elevation <= level] = SEA
    colours[..., :3] *= (0.42 + 0.62 * shade)[..., None]
    colours[~known] = (0.93, 0.93, 0.93, 1.0)
    return np.clip(colours, 0.0, 1.0)


def draw_map(
    axes: Any,
    frame: Frame,
    picture: np.ndarray,
    window: Window,
    extent: Window | None = None,
) -> tuple[Any, Any]:
    """Draw the terrain's cells and the vents.

    Args:
        axes: Axes of the map.
        frame: Ground and vents.
        picture: RGBA of the cells, 0 to 1, shape [rows, columns, 4].
        window: Extent of the axes: left, bottom, right, top [m].
        extent: Edges of a picture of some cells: left, right, bottom, top [m]; None for all.

    Returns:
        The artists of the cells and of the vents.
    """
    x0, y0, x1, y1 = frame.extent
    image = axes.imshow(
        picture, extent=extent or (x0, x1, y0, y1), origin='lower', interpolation='nearest'
    )
    for ends in frame.fissures:
        axes.plot(*np.transpose(ends), color='black', linewidth=1.6, path_effects=halo(), zorder=3)
    for crest in barriers_of(frame):
        look = BARRIER | {'path_effects': halo(), 'zorder': 4}
        axes.plot(*crest.T, scalex=False, scaley=False, **look)
    (vents,) = axes.plot(*frame.vents.T, zorder=7, **VENT)
    axes.set(facecolor='#ededed', xlim=(window[0], window[2]), ylim=(window[1], window[3]))
    for spine in axes.spines.values():
        spine.set(color='#666666', linewidth=0.8)
    return image, vents


def draw_colour_bar(figure: Any, axes: Any, scale: Scale) -> None:
    """Draw a colour bar into its axes."""
    from matplotlib.cm import ScalarMappable

    bar = figure.colorbar(ScalarMappable(scale.norm, scale.colours), cax=axes, extend=scale.past)
    if scale.names:
        ends = scale.norm.boundaries
        names = [fill(name, 18) for name in scale.names]
        bar.set_ticks(0.5 * (ends[1:] + ends[:-1]), labels=names, rotation=90, va='center')
        bar.ax.minorticks_off()
    bar.set_label(UNIT_WORDS.get(scale.label, scale.label), fontsize=9, color=INK)
    bar.ax.tick_params(labelsize=8, color='#666666', width=0.6, length=3)
    bar.outline.set_linewidth(0.6)


def contour_interval(frame: Frame, window: Window) -> float:
    """Return the interval of elevation contours that suits a window [m]; 0 on flat ground."""
    shown = _part(frame, window)[2]
    if not np.isfinite(shown).any():
        return 0.0
    relief = float(np.nanmax(shown)) - float(np.nanmin(shown))
    return round_up(relief / 16.0, _GRID) if relief > 0.0 else 0.0


def _part(frame: Frame, window: Window) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return coordinates of the columns and rows in a window [m], and their elevation."""
    x, y = frame.centres
    columns = (x >= window[0]) & (x <= window[2])
    rows = (y >= window[1]) & (y <= window[3])
    return x[columns], y[rows], frame.elevation[np.ix_(rows, columns)]


def draw_contours(axes: Any, frame: Frame, window: Window, interval: float) -> None:
    """Draw lines of equal elevation at an interval [m]; every fifth is thicker and labelled."""
    x, y, shown = _part(frame, window)
    if interval <= 0.0 or min(shown.shape) < 2 or not np.isfinite(shown).any():
        return
    low, high = float(np.nanmin(shown)), float(np.nanmax(shown))
    numbers = np.arange(math.ceil(low / interval), math.ceil(high / interval))
    for chosen, width in ((numbers % 5 != 0, 0.4), (numbers % 5 == 0, 0.9)):
        levels = numbers[chosen] * interval
        if not levels.size:
            continue
        look = {'linewidths': width, **CONTOUR}
        lines = axes.contour(x, y, shown, levels=levels, **look)
        if width > 0.5:
            for text in axes.clabel(lines, levels, fontsize=6.5, fmt='%g m', inline_spacing=2):
                text.set_gid(CONTOUR_LABEL)


def draw_isochrones(axes: Any, frame: Frame, times: np.ndarray) -> None:
    """Draw and label lines of equal arrival time at round times.

    ``times`` are arrival times [s], shape [rows, columns], NaN without arrival.
    """
    known = times[np.isfinite(times)]
    if not known.size or min(times.shape) < 2:
        return
    first, last = float(known.min()), float(known.max())
    times_drawn = map(float, isochrone_times(last, MAX_DRAWN_ISOCHRONES))
    levels = [time for time in times_drawn if first < time < last]
    if not levels:
        return
    lines = axes.contour(*frame.centres, times, levels=levels, zorder=4, **ISOCHRONE)
    lines.set_path_effects(halo(1.5))
    for time, parts in zip(levels, lines.allsegs, strict=True):
        # one label for each, in the middle of its longest part
        longest = max(parts, key=len, default=np.empty((0, 2)))
        if len(longest):
            x, y = map(float, longest[len(longest) // 2])
            axes.text(
                x, y, duration(time), fontsize=6.5, color=INK, ha='center', va='center',
                path_effects=halo(), zorder=6, clip_on=True, gid=ISOCHRONE_LABEL,
            )


def draw_ticks(axes: Any, offset: tuple[float, float] | None = None) -> None:
    """Draw coordinates along the edges, and a thin grid.

    ``offset`` is easting and northing [m] of the map frame's origin; None draws coordinates in the
    map frame.
    """
    from matplotlib.ticker import FuncFormatter

    names = ('easting [m]', 'northing [m]') if offset else ('x [m], map frame', 'y [m], map frame')
    both = (axes.xaxis, axes.yaxis)
    # a grid of squares at round coordinates
    inches = axes.get_position().width * axes.figure.get_figwidth()
    step = round_up(float(np.ptp(axes.get_xlim())) / max(inches / 0.7, 2.0), _GRID)
    for axis, name, start in zip(both, names, offset or (0, 0), strict=True):
        low, high = axis.get_view_interval()
        first = math.ceil((low + start) / step) * step - start
        ticks = np.arange(first, high, step)
        if axis is axes.yaxis:
            # a label near the corner would be on that of the x axis
            height = axes.get_position().height * axes.figure.get_figheight()
            ticks = ticks[(ticks - low) * height >= CORNER * (high - low)]
        axis.set_ticks(ticks)
        axis.set_major_formatter(
            FuncFormatter(lambda value, _, start=start: f'{value + start:,.0f}'.replace(',', ' '))
        )
        axis.set_label_text(name, fontsize=8, color='#555555')
        axis.labelpad = 2
    axes.grid(color='white', linewidth=0.5, alpha=0.45)
    axes.tick_params(labelsize=7.5, colors='#555555', width=0.6, length=3)
    for label in axes.get_yticklabels():
        label.set(rotation=90, verticalalignment='center')


def halo(width: float = 2.5) -> list[Any]:
    """Return path effects that keep thin lines and texts readable on any ground."""
    from matplotlib.patheffects import withStroke

    return [withStroke(linewidth=width, foreground='#ffffff')]


def scale_bar_length(width: float) -> float:
    """Return the length of the scale bar for a map of a width [m]: 1, 2 or 5 times 10^n m."""
    return round_up(0.11 * width, _GRID)


def scale_bar_words(length: float) -> str:
    """Format the length of a scale bar [m]."""
    return f'{length / 1000.0:g} km' if length >= 1000.0 else f'{length:g} m'


def draw_scale_bar(axes: Any, window: Window) -> None:
    """Draw a bar of a round length in the lower left corner."""
    width, height = window[2] - window[0], window[3] - window[1]
    length = scale_bar_length(width)
    left, bottom = window[0] + 0.04 * width, window[1] + 0.045 * height
    ends = ([left, left + length], [bottom, bottom])
    look = {'color': INK, 'path_effects': halo()}
    axes.plot(*ends, linewidth=3.0, solid_capstyle='butt', gid=SCALE_BAR, **look)
    axes.text(
        left, bottom + 0.012 * height, scale_bar_words(length), fontsize=8, ha='left',
        va='bottom', **look,
    )


def draw_north(axes: Any) -> None:
    """Draw an arrow to the north."""
    look = {'color': INK, 'path_effects': halo()}
    style = '-|>,head_width=0.32,head_length=0.6'
    axes.annotate(
        'N',
        xy=(0.045, 0.965),
        xytext=(0.045, 0.885),
        xycoords='axes fraction',
        fontsize=11,
        weight='bold',
        ha='center',
        va='center',
        arrowprops={'arrowstyle': style, 'linewidth': 1.6, 'shrinkA': 2, **look},
        **look,
    )
