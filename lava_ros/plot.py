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

"""Maps of a flow over shaded relief, as a picture."""

from collections.abc import Sequence
from dataclasses import dataclass
import math
from pathlib import Path
from typing import Any

import numpy as np

from lava_ros.errors import LavaError
from lava_ros.frames import Frame, LayerFrame

#: Colours of the ground from low to high: muted, so that the lava stands out.
GROUND = ('#7f8f7a', '#a3a383', '#bfb293', '#cfc4ae', '#e4ded2')

#: Share of the flow's size left free around it.
MARGIN = 0.18

#: Fewest cells along a side of the part that is drawn.
LEAST_CELLS = 24

_INK = '#222222'
_HALO = '#ffffff'

Window = tuple[float, float, float, float]


@dataclass(frozen=True)
class Style:
    """How a layer is drawn.

    Attributes:
        title: What it is.
        label: Unit of its values.
        colours: From the lowest value to the highest.
    """

    title: str
    label: str
    colours: Sequence[str]


#: How the layers are drawn, by source.
STYLES = {
    'thickness': Style(
        'Lava thickness',
        'm',
        ('#2a0a3d', '#6a176e', '#a92e5e', '#e2583b', '#fb9a06', '#fbe66a'),
    ),
    'temperature': Style(
        'Temperature',
        '°C',
        ('#1c1014', '#5b0f14', '#a11d12', '#dc4a10', '#f79420', '#fee08a', '#fffbe6'),
    ),
    'hazard': Style(
        'Hazard',
        '0 no lava, 100 lethal',
        ('#ffffb2', '#fed976', '#feb24c', '#fd8d3c', '#f03b20', '#a50026'),
    ),
}


def plot_frame(frame: Frame, output: str | Path) -> None:
    """Draw thickness, temperature and hazard of a frame into a picture.

    Args:
        frame: What to draw; layers it lacks are left out.
        output: The picture; its suffix chooses the format.

    Raises:
        LavaError: matplotlib is not installed, or the picture cannot be written.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise LavaError('plot', str(output), "matplotlib: pip install 'lava_ros[plot]'") from error
    sources = [name for name in STYLES if name in frame.layers]
    figure = Figure(figsize=(12.4, 7.4), dpi=110, facecolor='white')
    FigureCanvasAgg(figure)
    ground = shaded_ground(frame)
    # The main map is on the left; the others are above one another beside it.
    places = [(0.045, 0.065, 0.545, 0.83)]
    places += [(0.672, 0.515, 0.255, 0.38), (0.672, 0.065, 0.255, 0.38)]
    aspect = places[0][2] * figure.get_figwidth() / (places[0][3] * figure.get_figheight())
    window = window_of(frame, aspect)
    for source, place in zip(sources, places, strict=False):
        is_main = place is places[0]
        axes = figure.add_axes(place)
        draw_map(axes, frame, ground, frame.layers[source], window)
        bar = figure.add_axes((place[0] + place[2] + 0.008, place[1], 0.011, place[3]))
        draw_colour_bar(figure, bar, frame.layers[source])
        axes.set_title(STYLES[source].title, loc='left', fontsize=11, color=_INK, pad=5)
        if is_main:
            draw_contours(axes, frame, window)
            draw_ticks(axes)
            draw_north(axes)
            _draw_overview(axes, frame, ground, window)
        else:
            axes.set_xticks([])
            axes.set_yticks([])
        draw_scale_bar(axes, window)
    title, subtitle = _titles(frame)
    figure.text(0.045, 0.962, title, fontsize=16, weight='bold', color=_INK, va='center')
    figure.text(0.927, 0.962, subtitle, fontsize=10, color='#555555', va='center', ha='right')
    try:
        figure.savefig(output)
    except (OSError, ValueError) as error:
        raise LavaError('output', str(output), f'a picture to write ({error})') from error


def _titles(frame: Frame) -> tuple[str, str]:
    wet = _wet(frame)
    area = wet.sum() * frame.resolution**2
    size = f'{area / 1e6:.2f} km²' if area >= 1e5 else f'{area:.0f} m²'
    facts = [f'{size} covered' if wet.any() else 'no lava']
    if 'thickness' in frame.layers and wet.any():
        thickness = frame.layers['thickness']
        prefix = 'over' if thickness.is_saturated else 'up to'
        facts.append(f'{prefix} {np.nanmax(thickness.values):.1f} m thick')
    facts.append(f'cells of {frame.resolution:g} m')
    epsg = (frame.scene.get('terrain') or {}).get('epsg')
    if epsg:
        facts.append(f'EPSG:{epsg}')
    if len(frame.vents):
        facts.append('△ vent')
    title = 'Lava flow' if frame.time is None else f'Lava flow after {duration(frame.time)}'
    return title, '  ·  '.join(facts)


def duration(seconds: float) -> str:
    """Say a time span [s] as people do: 40 s, 12 min, 5 h 40 min, 3 d 4 h."""
    minutes = round(seconds / 60.0)
    if seconds < 120.0:
        return f'{seconds:.0f} s'
    if minutes < 120:
        return f'{minutes} min'
    if minutes < 48 * 60:
        return f'{minutes // 60} h' + (f' {minutes % 60:02d} min' if minutes % 60 else '')
    hours = round(seconds / 3600.0)
    return f'{hours // 24} d {hours % 24} h'


def _wet(frame: Frame) -> np.ndarray:
    """Cells where any layer shows lava, bool, shape [rows, columns]."""
    result = np.zeros(frame.elevation.shape, dtype=bool)
    for item in frame.layers.values():
        result |= np.isfinite(item.values)
    return result


def _extent(frame: Frame) -> Window:
    """Smallest x, smallest y, largest x, largest y of the terrain [m]."""
    rows, columns = frame.elevation.shape
    x, y = frame.origin
    return (x, y, x + columns * frame.resolution, y + rows * frame.resolution)


def window_of(frame: Frame, aspect: float) -> Window:
    """The part of the map to draw: the flow with a margin, as wide as ``aspect`` times high."""
    x0, y0, x1, y1 = _extent(frame)
    rows, columns = np.nonzero(_wet(frame))
    xs = [*(frame.origin[0] + frame.resolution * columns), *frame.vents[:, 0]]
    ys = [*(frame.origin[1] + frame.resolution * rows), *frame.vents[:, 1]]
    if not xs:
        xs, ys = [x0, x1], [y0, y1]
    least = LEAST_CELLS * frame.resolution
    width = max((max(xs) - min(xs)) * (1.0 + 2.0 * MARGIN), least)
    height = max((max(ys) - min(ys)) * (1.0 + 2.0 * MARGIN), least)
    width, height = max(width, height * aspect), max(height, width / aspect)
    middle_x, middle_y = 0.5 * (min(xs) + max(xs)), 0.5 * (min(ys) + max(ys))
    left = _inside(middle_x - 0.5 * width, width, x0, x1)
    bottom = _inside(middle_y - 0.5 * height, height, y0, y1)
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


Scale = tuple[Any, Any, str]


def scale_of(item: LayerFrame) -> Scale:
    """Colour map, normalisation and the side on which values go past it."""
    from matplotlib.colors import LinearSegmentedColormap, Normalize

    source = item.layer.source
    colours = LinearSegmentedColormap.from_list(source, STYLES[source].colours)
    values = item.values[np.isfinite(item.values)]
    if source == 'hazard':
        return colours, Normalize(0.0, 100.0), 'neither'
    if values.size == 0:
        return colours, Normalize(*(item.layer.range or (0.0, 1.0))), 'neither'
    if source == 'temperature':
        low = math.floor(float(values.min()) / 100.0) * 100.0
        high = max(math.ceil(float(values.max()) / 100.0) * 100.0, low + 100.0)
        return colours, Normalize(low, high), 'neither'
    # A few deep cells must not make the rest all one colour.
    high = _round_up(float(np.percentile(values, 99.5)))
    past = item.is_saturated or float(values.max()) > high
    return colours, Normalize(0.0, high), 'max' if past else 'neither'


def _round_up(value: float) -> float:
    """The next larger of 1, 1.5, 2, 3, 4, 5, 6, 8, 10 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(value))
    steps = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
    return power * next(step for step in steps if step * power >= value * (1.0 - 1e-9))


def picture_of(item: LayerFrame, ground: np.ndarray, colours: Scale) -> np.ndarray:
    """A layer over the ground, RGBA 0..1, shape [rows, columns, 4]."""
    colour_map, norm, _ = colours
    picture = ground.copy()
    wet = np.isfinite(item.values)
    # The relief shows through the lava by its brightness alone.
    bright = ground[..., :3].mean(axis=-1)
    lava = colour_map(norm(np.where(wet, item.values, 0.0)))[..., :3]
    picture[wet, :3] = lava[wet] * (0.72 + 0.4 * bright[wet])[:, None]
    return np.clip(picture, 0.0, 1.0)


def draw_map(
    axes: Any, frame: Frame, ground: np.ndarray, item: LayerFrame, window: Window
) -> None:
    """Draw a layer over the ground, and the vents, into axes that show the window."""
    x0, y0, x1, y1 = _extent(frame)
    axes.imshow(
        picture_of(item, ground, scale_of(item)),
        extent=(x0, x1, y0, y1),
        origin='lower',
        interpolation='nearest',
    )
    axes.plot(
        frame.vents[:, 0],
        frame.vents[:, 1],
        linestyle='none',
        marker='^',
        markersize=6,
        markerfacecolor='white',
        markeredgecolor='black',
        markeredgewidth=0.9,
    )
    axes.set_facecolor('#ededed')
    axes.set_xlim(window[0], window[2])
    axes.set_ylim(window[1], window[3])
    for spine in axes.spines.values():
        spine.set_color('#666666')
        spine.set_linewidth(0.8)


def draw_colour_bar(figure: Any, axes: Any, item: LayerFrame) -> None:
    """Draw the colours of a layer and their values into axes of their own."""
    from matplotlib.cm import ScalarMappable

    colours, norm, extend = scale_of(item)
    bar = figure.colorbar(ScalarMappable(norm, colours), cax=axes, extend=extend)
    bar.set_label(STYLES[item.layer.source].label, fontsize=9, color=_INK)
    bar.ax.tick_params(labelsize=8, color='#666666', width=0.6, length=3)
    bar.outline.set_linewidth(0.6)


def draw_contours(axes: Any, frame: Frame, window: Window) -> None:
    """Thin lines of equal elevation, every fifth of them labelled."""
    x0, y0, _, _ = _extent(frame)
    rows, columns = frame.elevation.shape
    x = x0 + (np.arange(columns) + 0.5) * frame.resolution
    y = y0 + (np.arange(rows) + 0.5) * frame.resolution
    here = np.ix_((y >= window[1]) & (y <= window[3]), (x >= window[0]) & (x <= window[2]))
    shown = frame.elevation[here]
    if min(shown.shape) < 2 or not np.isfinite(shown).any():
        return
    low, high = float(np.nanmin(shown)), float(np.nanmax(shown))
    if high <= low:
        return
    step = _round_up((high - low) / 16.0)
    levels = np.arange(math.ceil(low / step) * step, high, step)
    if len(levels) == 0:
        return
    lines = axes.contour(
        x[(x >= window[0]) & (x <= window[2])],
        y[(y >= window[1]) & (y <= window[3])],
        shown,
        levels=levels,
        colors='#3b352a',
        linewidths=0.45,
        alpha=0.45,
    )
    axes.clabel(lines, levels[::4], fontsize=6.5, fmt='%g m', inline_spacing=2)


def draw_ticks(axes: Any) -> None:
    """Map coordinates along the edges."""
    from matplotlib.ticker import FuncFormatter, MaxNLocator

    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(5))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f'{value:,.0f}'.replace(',', ' ')))
    axes.tick_params(labelsize=7.5, colors='#555555', width=0.6, length=3)
    for label in axes.get_yticklabels():
        label.set_rotation(90)
        label.set_verticalalignment('center')
    axes.set_xlabel('x [m], map frame', fontsize=8, color='#555555', labelpad=2)


def _halo() -> list[Any]:
    from matplotlib.patheffects import withStroke

    return [withStroke(linewidth=2.5, foreground=_HALO)]


def draw_scale_bar(axes: Any, window: Window) -> None:
    """A bar of a round length in the lower left corner."""
    width, height = window[2] - window[0], window[3] - window[1]
    length = _round_up(0.13 * width)
    label = f'{length / 1000.0:g} km' if length >= 1000.0 else f'{length:g} m'
    left, bottom = window[0] + 0.04 * width, window[1] + 0.045 * height
    axes.plot(
        [left, left + length],
        [bottom, bottom],
        color=_INK,
        linewidth=3.0,
        solid_capstyle='butt',
        path_effects=_halo(),
    )
    axes.text(
        left + 0.5 * length,
        bottom + 0.012 * height,
        label,
        fontsize=8,
        color=_INK,
        ha='center',
        va='bottom',
        path_effects=_halo(),
    )


def draw_north(axes: Any) -> None:
    """Draw an arrow to the north."""
    axes.annotate(
        'N',
        xy=(0.045, 0.965),
        xytext=(0.045, 0.885),
        xycoords='axes fraction',
        fontsize=11,
        weight='bold',
        color=_INK,
        ha='center',
        va='center',
        arrowprops={
            'arrowstyle': '-|>,head_width=0.32,head_length=0.6',
            'color': _INK,
            'linewidth': 1.6,
            'shrinkA': 2,
            'path_effects': _halo(),
        },
        path_effects=_halo(),
    )


def _draw_overview(axes: Any, frame: Frame, ground: np.ndarray, window: Window) -> None:
    """The whole terrain in the corner that hides the least lava, unless it is shown anyway."""
    x0, y0, x1, y1 = _extent(frame)
    if (window[2] - window[0]) * (window[3] - window[1]) > 0.6 * (x1 - x0) * (y1 - y0):
        return
    from matplotlib.patches import Rectangle

    box = axes.get_position()
    figure = axes.figure
    height = 0.25
    width = height * (x1 - x0) / (y1 - y0)
    width *= box.height * figure.get_figheight() / (box.width * figure.get_figwidth())
    left, bottom = _emptiest_corner(frame, window, min(width, 0.45), height)
    inset = axes.inset_axes((left, bottom, min(width, 0.45), height))
    picture = ground.copy()
    picture[_wet(frame)] = (0.75, 0.10, 0.05, 1.0)
    inset.imshow(picture, extent=(x0, x1, y0, y1), origin='lower', interpolation='antialiased')
    inset.add_patch(
        Rectangle(
            window[:2],
            window[2] - window[0],
            window[3] - window[1],
            fill=False,
            edgecolor='black',
            linewidth=1.1,
        )
    )
    inset.set_xticks([])
    inset.set_yticks([])
    for spine in inset.spines.values():
        spine.set_color('white')
        spine.set_linewidth(1.8)


def _emptiest_corner(
    frame: Frame, window: Window, width: float, height: float
) -> tuple[float, float]:
    """Lower-left corner, in shares of the window, of the right or lower corner with least lava.

    The upper left belongs to the north arrow and the lower left to the scale bar.
    """
    rows, columns = np.nonzero(_wet(frame))
    x = (frame.origin[0] + frame.resolution * columns - window[0]) / (window[2] - window[0])
    y = (frame.origin[1] + frame.resolution * rows - window[1]) / (window[3] - window[1])

    def hidden(corner: tuple[float, float]) -> int:
        inside = (x >= corner[0]) & (x <= corner[0] + width)
        return int((inside & (y >= corner[1]) & (y <= corner[1] + height)).sum())

    edge = 0.018
    corners = [(1.0 - width - edge, edge), (1.0 - width - edge, 1.0 - height - edge)]
    return min(corners, key=hidden)
