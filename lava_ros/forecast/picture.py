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

"""What was seen narrows a forecast: a picture of probabilities before and after."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lava_ros.errors import LavaError
from lava_ros.frames import Frame
from lava_ros.plot import draw_contours, draw_scale_bar, shaded_ground, Window
from lava_ros.scene import Scene

#: From just possible to certain.
_COLOURS = ('#fff3c4', '#fdd17a', '#f99a3b', '#e2571e', '#a81d1d', '#5a0a2a')

_SEEN, _CAME, _INK = '#0b3c8c', '#111111', '#222222'

#: Share of the flow's size left free around it.
_MARGIN = 0.12


def draw_narrowing(
    scene: Scene,
    maps: Sequence[tuple[str, np.ndarray]],
    *,
    seen: np.ndarray,
    came: np.ndarray,
    output: Path,
) -> None:
    """Draw maps of probability side by side over shaded relief.

    Args:
        scene: Ground and vents.
        maps: Title and probability [0 to 100, NaN unknown] of each, shape [rows, columns].
        seen: Where lava was seen, bool, same shape.
        came: Where lava came up to the horizon, bool, same shape.
        output: The picture; its suffix chooses the format.

    Raises:
        LavaError: matplotlib is not installed, or the picture cannot be written.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.cm import ScalarMappable
        from matplotlib.colors import LinearSegmentedColormap, Normalize
        from matplotlib.figure import Figure
        from matplotlib.lines import Line2D
    except ImportError as error:
        raise LavaError('plot', str(output), "matplotlib: pip install 'lava_ros[plot]'") from error
    terrain = scene.terrain
    frame = Frame(
        elevation=np.asarray(terrain.elevation, dtype=np.float32),
        resolution=terrain.resolution,
        origin=terrain.origin,
        layers={},
        vents=np.array([vent.position for vent in scene.vents]).reshape(-1, 2),
        time=None,
        scene={},
    )
    likely = np.any([np.nan_to_num(values) > 0.0 for _, values in maps], axis=0)
    ground, window = shaded_ground(frame), _window(frame, likely | seen | came)
    colours = LinearSegmentedColormap.from_list('probability', _COLOURS)
    width = 4.6 * len(maps)
    height = 4.6 * (window[3] - window[1]) / (window[2] - window[0]) + 1.0
    figure = Figure(figsize=(width + 0.8, height), dpi=90, layout='constrained')
    FigureCanvasAgg(figure)
    row = figure.subplots(1, len(maps), squeeze=False)[0]
    for axes, (title, values) in zip(row, maps, strict=True):
        _draw(axes, frame, _over(ground, values, colours), window)
        _outline(axes, frame, seen, colors=_SEEN, linewidths=1.8)
        _outline(axes, frame, came, colors=_CAME, linewidths=1.2, linestyles='dashed')
        axes.set_title(title, loc='left', fontsize=10, color=_INK)
    bar = figure.colorbar(
        ScalarMappable(Normalize(0.0, 100.0), colours), ax=list(row), shrink=0.8, pad=0.01
    )
    bar.set_label('probability that lava comes [%]', fontsize=9, color=_INK)
    bar.ax.tick_params(labelsize=8)
    figure.legend(
        handles=[
            Line2D([], [], color=_SEEN, linewidth=1.8, label='outline that was seen'),
            Line2D([], [], color=_CAME, linewidth=1.2, linestyle='dashed', label='what came'),
            Line2D(
                [], [], linestyle='none', marker='^', markerfacecolor='white',
                markeredgecolor='black', label='vent',
            ),
        ],
        loc='outside lower center',
        ncols=3,
        fontsize=8,
        frameon=False,
    )
    try:
        figure.savefig(output)
    except (OSError, ValueError) as error:
        raise LavaError('output', str(output), f'a picture to write ({error})') from error


def _window(frame: Frame, shown: np.ndarray) -> Window:
    rows, columns = np.nonzero(shown)
    if not rows.size:
        raise LavaError('probability', 'no cell with lava', 'a forecast of lava that comes')
    size = frame.resolution
    low = np.array(frame.origin) + size * np.array([columns.min(), rows.min()])
    high = np.array(frame.origin) + size * np.array([columns.max() + 1, rows.max() + 1])
    free = _MARGIN * (high - low).max()
    return (*(low - free).tolist(), *(high + free).tolist())


def _over(ground: np.ndarray, values: np.ndarray, colours: Any) -> np.ndarray:
    """Probabilities over the ground, the relief showing through; 0 is left as ground."""
    picture = ground.copy()
    here = np.nan_to_num(values) > 0.0
    bright = ground[..., :3].mean(axis=-1)
    shown = colours(values[here] / 100.0)[..., :3]
    picture[here, :3] = shown * (0.65 + 0.5 * bright[here])[:, None]
    return np.clip(picture, 0.0, 1.0)


def _draw(axes: Any, frame: Frame, picture: np.ndarray, window: Window) -> None:
    rows, columns = frame.elevation.shape
    x, y = frame.origin
    extent = (x, x + columns * frame.resolution, y, y + rows * frame.resolution)
    axes.imshow(picture, extent=extent, origin='lower', interpolation='nearest')
    axes.set_xlim(window[0], window[2])
    axes.set_ylim(window[1], window[3])
    draw_contours(axes, frame, window)
    draw_scale_bar(axes, window)
    axes.plot(
        *frame.vents.T, linestyle='none', marker='^', markersize=6, markerfacecolor='white',
        markeredgecolor='black', markeredgewidth=0.9,
    )
    axes.set_xticks([])
    axes.set_yticks([])


def _outline(axes: Any, frame: Frame, where: np.ndarray, **style: Any) -> None:
    if not where.any():
        return
    rows, columns = where.shape
    x = frame.origin[0] + (np.arange(columns) + 0.5) * frame.resolution
    y = frame.origin[1] + (np.arange(rows) + 0.5) * frame.resolution
    axes.contour(x, y, where.astype(float), levels=[0.5], **style)
