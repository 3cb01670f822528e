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

"""What maps over shaded relief are drawn with; ``sheet.py`` makes a page of them."""

from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import Any

import numpy as np

from lava_ros.maps.frames import Frame

#: Colours of the ground from low to high: muted, so that the lava stands out.
GROUND = ('#7f8f7a', '#a3a383', '#bfb293', '#cfc4ae', '#e4ded2')

#: Share of the flow's size left free around it.
MARGIN = 0.18

#: Fewest cells along a side of the part that is drawn.
LEAST_CELLS = 24

INK = '#222222'

#: How vents are drawn, in maps and in their legend.
VENT: dict[str, Any] = {
    'linestyle': 'none',
    'marker': '^',
    'markersize': 6,
    'markerfacecolor': 'white',
    'markeredgecolor': 'black',
    'markeredgewidth': 0.9,
}

# Steps of a grid that people reckon with.
_GRID = (1.0, 2.0, 5.0, 10.0)

Window = tuple[float, float, float, float]


@dataclass(frozen=True)
class Style:
    """How a layer is drawn: its title, unit, and colours from the lowest value to the highest.

    ``names`` say what the values 1, 2, ... mean, a colour each; none where values are numbers.
    """

    title: str
    label: str
    colours: Sequence[str]
    names: Sequence[str] = ()


#: How maps are drawn, by what they show. Those of a comparison differ to people who do not tell
#: red from green too.
STYLES = {
    'thickness': Style(
        'Lava thickness', 'm',
        ('#2a0a3d', '#6a176e', '#a92e5e', '#e2583b', '#fb9a06', '#fbe66a'),
    ),
    'temperature': Style(
        'Temperature', '°C',
        ('#1c1014', '#5b0f14', '#a11d12', '#dc4a10', '#f79420', '#fee08a', '#fffbe6'),
    ),
    'hazard': Style(
        'Hazard', '50 lava has drained away, 100 lethal',
        ('#ffffb2', '#fed976', '#feb24c', '#fd8d3c', '#f03b20', '#a50026'),
    ),
    'arrival': Style(
        'Arrival of the lava', 's',
        ('#67001f', '#b2182b', '#d6604d', '#f4a582', '#fddbc7', '#d1e5f0', '#92c5de'),
    ),
    'probability': Style(
        'Probability that lava comes', '%',
        ('#fff3c4', '#fdd17a', '#f99a3b', '#e2571e', '#a81d1d', '#5a0a2a'),
    ),
    'comparison': Style(
        'Simulated and mapped', '',
        ('#f2b134', '#2166ac', '#b2182b'),
        ('hit', 'miss', 'false alarm'),
    ),
}

#: Units of times [s], the largest first.
_TIMES = (('d', 86_400.0), ('h', 3600.0), ('min', 60.0), ('s', 1.0))


def titles(frame: Frame) -> tuple[str, str]:
    """Title of a frame with its time, and a line with its areas and the largest thickness."""
    sets = {'inundated': frame.inundated, 'standing lava': frame.standing}
    areas = {name: frame.area(cells) for name, cells in sets.items() if cells is not None}
    facts = [f'{area_words(area)} {name}' for name, area in areas.items() if area]
    facts = facts or ['no lava']
    if math.isfinite(frame.thickest):
        prefix = 'over' if frame.layers['thickness'].is_saturated else 'up to'
        facts.append(f'{prefix} {frame.thickest:.3g} m thick')
    title = 'Lava flow' if frame.time is None else f'Lava flow after {duration(frame.time)}'
    return title, '  ·  '.join(facts)


def area_words(value: float) -> str:
    """Format an area [m2] in m² or km²."""
    return f'{value / 1e6:.2f} km²' if value >= 1e5 else f'{value:.0f} m²'


def duration(seconds: float) -> str:
    """Format a time span [s]: 40 s, 12 min, 5 h 40 min, 3 d 4 h."""
    minutes = round(seconds / 60.0)
    if seconds < 120.0:
        return f'{seconds:.0f} s'
    if minutes < 120:
        return f'{minutes} min'
    if minutes < 48 * 60:
        return f'{minutes // 60} h' + (f' {minutes % 60:02d} min' if minutes % 60 else '')
    hours = round(seconds / 3600.0)
    return f'{hours // 24} d {hours % 24} h'


def extent_of(frame: Frame) -> Window:
    """Smallest x, smallest y, largest x, largest y of the terrain [m]."""
    rows, columns = frame.elevation.shape
    x, y = frame.origin
    return (x, y, x + columns * frame.resolution, y + rows * frame.resolution)


def middles_of(frame: Frame) -> tuple[np.ndarray, np.ndarray]:
    """Map coordinates of the middles of the columns and of the rows [m]."""
    rows, columns = frame.elevation.shape
    x = frame.origin[0] + (np.arange(columns) + 0.5) * frame.resolution
    return x, frame.origin[1] + (np.arange(rows) + 0.5) * frame.resolution


def bounds_of(frame: Frame, shown: np.ndarray) -> Window:
    """Bounding box of a mask, bool, shape [rows, columns], and the vents; the terrain if empty."""
    x, y = middles_of(frame)
    xs = [*x[shown.any(axis=0)], *frame.vents[:, 0]]
    ys = [*y[shown.any(axis=1)], *frame.vents[:, 1]]
    return (min(xs), min(ys), max(xs), max(ys)) if xs else extent_of(frame)


def window_of(bounds: Window, limits: Window, aspect: float, least: float) -> Window:
    """The part of the map to draw: ``bounds`` with a margin, inside ``limits`` where it fits.

    The window is ``aspect`` times as wide as high, and at least ``least`` [m] in both directions.
    """
    x0, y0, x1, y1 = bounds
    width = max((x1 - x0) * (1.0 + 2.0 * MARGIN), least)
    height = max((y1 - y0) * (1.0 + 2.0 * MARGIN), least)
    width, height = max(width, height * aspect), max(height, width / aspect)
    left = _inside(0.5 * (x0 + x1 - width), width, limits[0], limits[2])
    bottom = _inside(0.5 * (y0 + y1 - height), height, limits[1], limits[3])
    return (left, bottom, left + width, bottom + height)


def _inside(start: float, length: float, low: float, high: float) -> float:
    """Move a span into limits; one that is longer is centred on them."""
    if length >= high - low:
        return 0.5 * (low + high - length)
    return min(max(start, low), high - length)


def shaded_ground(frame: Frame) -> np.ndarray:
    """Relief lit from the north-west, RGBA 0..1, shape [rows, columns, 4]."""
    from matplotlib.colors import LightSource, LinearSegmentedColormap

    known = np.isfinite(frame.elevation)
    low, high = float(np.nanmin(frame.elevation)), float(np.nanmax(frame.elevation))
    elevation = np.where(known, frame.elevation, low)
    light = LightSource(azdeg=315.0, altdeg=42.0)
    # Row 0 is the south here and the top for LightSource.
    shade = light.hillshade(
        elevation[::-1], vert_exag=1.6, dx=frame.resolution, dy=frame.resolution
    )[::-1]
    tint = LinearSegmentedColormap.from_list('ground', GROUND)
    colours = tint((elevation - low) / max(high - low, 1e-6))
    colours[..., :3] *= (0.42 + 0.62 * shade)[..., None]
    colours[~known] = (0.93, 0.93, 0.93, 1.0)
    return np.clip(colours, 0.0, 1.0)


@dataclass(frozen=True)
class Scale:
    """Which value has which colour: a colour map of matplotlib and its normalisation.

    ``past`` is the side on which values go past it: ``neither`` or ``max``. ``label`` names the
    unit of the values it takes, and ``unit`` is that unit in the unit of the style.
    """

    colours: Any
    norm: Any
    past: str
    label: str
    unit: float = 1.0
    names: Sequence[str] = ()


def scale_of(source: str, values: np.ndarray, *, is_saturated: bool = False) -> Scale:
    """Choose the colour scale of a map from its values, NaN where nothing is shown.

    ``source`` is one of ``STYLES``. ``is_saturated`` says that values may be larger than given.
    """
    from matplotlib.colors import BoundaryNorm, LinearSegmentedColormap, ListedColormap, Normalize

    style = STYLES[source]
    colours = LinearSegmentedColormap.from_list(source, style.colours)
    known = values[np.isfinite(values)]
    most = float(known.max()) if known.size else 1.0
    if style.names:
        count = len(style.names)
        norm = BoundaryNorm(np.arange(count + 1) + 0.5, count)
        return Scale(ListedColormap(style.colours), norm, 'neither', '', names=style.names)
    if source in ('hazard', 'probability'):
        return Scale(colours, Normalize(0.0, 100.0), 'neither', style.label)
    if source == 'arrival':
        label, unit = next(item for item in _TIMES if most >= 2.0 * item[1] or item[1] == 1.0)
        top = Normalize(0.0, _round_up(max(most / unit, 1e-6)))
        return Scale(colours, top, 'neither', label, unit)
    if source == 'temperature':
        low = math.floor(float(known.min()) / 100.0) * 100.0 if known.size else 0.0
        high = max(math.ceil(most / 100.0) * 100.0, low + 100.0)
        return Scale(colours, Normalize(low, high), 'neither', style.label)
    # A few deep cells must not make the rest all one colour.
    high = _round_up(max(float(np.percentile(known, 99.5)), 1e-6)) if known.size else 1.0
    past = 'max' if is_saturated or most > high else 'neither'
    return Scale(colours, Normalize(0.0, high), past, style.label)


def _round_up(
    value: float, steps: Sequence[float] = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
) -> float:
    """The next larger of some steps times a power of ten."""
    power = 10.0 ** math.floor(math.log10(value))
    return power * next(step for step in steps if step * power >= value * (1.0 - 1e-9))


def picture_of(values: np.ndarray, ground: np.ndarray, scale: Scale) -> np.ndarray:
    """A map over the ground, RGBA 0..1, shape [rows, columns, 4]; NaN leaves the ground."""
    picture = ground.copy()
    here = np.isfinite(values)
    # The relief shows through the lava by its brightness alone.
    bright = ground[..., :3].mean(axis=-1)
    shown = scale.colours(scale.norm(values[here] / scale.unit))[..., :3]
    picture[here, :3] = shown * (0.72 + 0.4 * bright[here])[:, None]
    return np.clip(picture, 0.0, 1.0)


def draw_map(
    axes: Any,
    frame: Frame,
    picture: np.ndarray,
    window: Window,
    fissures: Any = (),
    extent: Window | None = None,
) -> tuple[Any, Any]:
    """Draw the terrain's cells and the vents, and return the artists of both.

    The picture is RGBA of the cells, 0 to 1, shape [rows, columns, 4]; the window the part of the
    map that the axes show: left, bottom, right, top [m]. Fissures are ends of vents [m], shape
    [count, 2, 2]. ``extent`` has the edges of a picture of only some cells: left, right, bottom,
    top [m]; None for all.
    """
    x0, y0, x1, y1 = extent_of(frame)
    image = axes.imshow(
        picture, extent=extent or (x0, x1, y0, y1), origin='lower', interpolation='nearest'
    )
    for ends in fissures:
        axes.plot(*np.transpose(ends), color='black', linewidth=1.6, path_effects=halo(), zorder=3)
    (vents,) = axes.plot(*frame.vents.T, zorder=7, **VENT)
    axes.set(facecolor='#ededed', xlim=(window[0], window[2]), ylim=(window[1], window[3]))
    for spine in axes.spines.values():
        spine.set(color='#666666', linewidth=0.8)
    return image, vents


def draw_colour_bar(figure: Any, axes: Any, scale: Scale) -> None:
    """Draw colours and their values into axes of their own."""
    from matplotlib.cm import ScalarMappable

    bar = figure.colorbar(ScalarMappable(scale.norm, scale.colours), cax=axes, extend=scale.past)
    if scale.names:
        bar.set_ticks(np.arange(len(scale.names)) + 1.0, labels=scale.names)
    bar.set_label(scale.label, fontsize=9, color=INK)
    bar.ax.tick_params(labelsize=8, color='#666666', width=0.6, length=3)
    bar.outline.set_linewidth(0.6)


def draw_contours(axes: Any, frame: Frame, window: Window) -> None:
    """Thin lines of equal elevation, every fifth of them labelled."""
    x, y = middles_of(frame)
    columns = (x >= window[0]) & (x <= window[2])
    rows = (y >= window[1]) & (y <= window[3])
    shown = frame.elevation[np.ix_(rows, columns)]
    if min(shown.shape) < 2 or not np.isfinite(shown).any():
        return
    low, high = float(np.nanmin(shown)), float(np.nanmax(shown))
    if high <= low:
        return
    step = _round_up((high - low) / 16.0)
    levels = np.arange(math.ceil(low / step) * step, high, step)
    lines = axes.contour(
        x[columns], y[rows], shown, levels=levels, colors='#3b352a', linewidths=0.45, alpha=0.45
    )
    axes.clabel(lines, levels[::4], fontsize=6.5, fmt='%g m', inline_spacing=2)


def draw_ticks(axes: Any, offset: tuple[float, float] | None = None) -> None:
    """Draw coordinates along the edges, and a thin grid.

    ``offset`` is the map frame's origin [m]; coordinates are then easting and northing. None draws
    those of the map frame.
    """
    from matplotlib.ticker import FuncFormatter

    names = ('easting [m]', 'northing [m]') if offset else ('x [m], map frame', 'y [m], map frame')
    both = (axes.xaxis, axes.yaxis)
    # a grid of squares, at round numbers of what people read
    inches = axes.get_position().width * axes.figure.get_figwidth()
    step = _round_up(float(np.ptp(axes.get_xlim())) / max(inches / 0.7, 2.0), _GRID)
    for axis, name, start in zip(both, names, offset or (0, 0), strict=True):
        low, high = axis.get_view_interval()
        first = math.ceil((low + start) / step) * step - start
        axis.set_ticks(np.arange(first, high, step))
        axis.set_major_formatter(
            FuncFormatter(lambda value, _, start=start: f'{value + start:,.0f}'.replace(',', ' '))
        )
        axis.set_label_text(name, fontsize=8, color='#555555')
        axis.labelpad = 2
    axes.grid(color='white', linewidth=0.5, alpha=0.45)
    axes.tick_params(labelsize=7.5, colors='#555555', width=0.6, length=3)
    for label in axes.get_yticklabels():
        label.set(rotation=90, verticalalignment='center')


def halo() -> list[Any]:
    """Path effects that keep thin lines and texts readable on any ground."""
    from matplotlib.patheffects import withStroke

    return [withStroke(linewidth=2.5, foreground='#ffffff')]


def draw_scale_bar(axes: Any, window: Window) -> None:
    """A bar of a round length in the lower left corner."""
    width, height = window[2] - window[0], window[3] - window[1]
    length = _round_up(0.13 * width)
    label = f'{length / 1000.0:g} km' if length >= 1000.0 else f'{length:g} m'
    left, bottom = window[0] + 0.04 * width, window[1] + 0.045 * height
    ends = ([left, left + length], [bottom, bottom])
    look = {'color': INK, 'path_effects': halo()}
    axes.plot(*ends, linewidth=3.0, solid_capstyle='butt', **look)
    middle, above = left + 0.5 * length, bottom + 0.012 * height
    axes.text(middle, above, label, fontsize=8, ha='center', va='bottom', **look)


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


def draw_overview(
    axes: Any, frame: Frame, ground: np.ndarray, shown: np.ndarray, window: Window
) -> None:
    """The whole terrain in the corner that hides the least lava, unless it is shown anyway."""
    x0, y0, x1, y1 = extent_of(frame)
    if (window[2] - window[0]) * (window[3] - window[1]) > 0.6 * (x1 - x0) * (y1 - y0):
        return
    from matplotlib.patches import Rectangle

    box = axes.get_position()
    figure = axes.figure
    height = 0.25
    width = height * (x1 - x0) / (y1 - y0)
    width *= box.height * figure.get_figheight() / (box.width * figure.get_figwidth())
    width = min(width, 0.45)
    # between it and the edge is room for a line of text
    edge = 0.16 / (box.width * figure.get_figwidth())
    left, bottom = _emptiest_corner(frame, shown, window, width, height, edge)
    inset = axes.inset_axes((left, bottom, width, height))
    picture = ground.copy()
    picture[shown] = (0.75, 0.10, 0.05, 1.0)
    inset.imshow(picture, extent=(x0, x1, y0, y1), origin='lower', interpolation='antialiased')
    sides = (window[2] - window[0], window[3] - window[1])
    seen = Rectangle(window[:2], *sides, fill=False, edgecolor='black', linewidth=1.1)
    inset.add_patch(seen)
    inset.set(xticks=[], yticks=[])
    for spine in inset.spines.values():
        spine.set(color='white', linewidth=1.8)


def _emptiest_corner(
    frame: Frame, shown: np.ndarray, window: Window, width: float, height: float, edge: float
) -> tuple[float, float]:
    """Lower-left corner, in shares of the window, of the right or lower corner with least lava.

    The upper left belongs to the north arrow and the lower left to the scale bar.
    """
    rows, columns = np.nonzero(shown)
    x = (frame.origin[0] + frame.resolution * columns - window[0]) / (window[2] - window[0])
    y = (frame.origin[1] + frame.resolution * rows - window[1]) / (window[3] - window[1])

    def hidden(corner: tuple[float, float]) -> int:
        inside = (x >= corner[0]) & (x <= corner[0] + width)
        return int((inside & (y >= corner[1]) & (y <= corner[1] + height)).sum())

    corners = [(1.0 - width - edge, 0.018), (1.0 - width - edge, 0.965 - height)]
    return min(corners, key=hidden)
