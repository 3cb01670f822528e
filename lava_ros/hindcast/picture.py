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


"""A picture of hits, misses and false alarms over shaded ground."""

from pathlib import Path
from typing import Any

import numpy as np

from lava_ros.errors import LavaError
from lava_ros.hindcast.case import Case
from lava_ros.hindcast.maps import comparison, FALSE_ALARM, HIT, MISS
from lava_ros.hindcast.score import Score

#: Colours of what a cell can be: they differ to people who do not tell red from green too.
COLOURS = {HIT: '#f2b134', MISS: '#2166ac', FALSE_ALARM: '#b2182b'}

_NAMES = {HIT: 'hit', MISS: 'miss', FALSE_ALARM: 'false alarm'}

#: Share of the flow's size left free around it.
_MARGIN = 0.08

#: Longest side of the picture and the other's limits [inches].
_LONGEST, _SHORTEST = 11.0, 5.0


def draw_comparison(case: Case, thickness: np.ndarray, judged: Score, output: Path) -> None:
    """Draw hits, misses and false alarms.

    Args:
        case: The case.
        thickness: Thickness of the simulated lava [m], shape [rows, columns].
        judged: The comparison in numbers.
        output: The picture; its suffix chooses the format.

    Raises:
        LavaError: matplotlib is not installed, or the picture cannot be written.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.colors import LightSource, to_rgb
        from matplotlib.figure import Figure
        from matplotlib.patches import Patch
    except ImportError as error:
        raise LavaError('plot', str(output), "matplotlib: pip install 'lava_ros[plot]'") from error
    terrain = case.scene.terrain
    codes = comparison(thickness, case.footprint)
    rows, columns = _window(codes, terrain.shape)
    heights = terrain.elevation[rows, columns]
    level = np.where(np.isfinite(heights), heights, np.nanmin(terrain.elevation))
    light = LightSource(azdeg=315, altdeg=45)
    # rows go north here: the light would come from below otherwise
    shade = light.hillshade(level[::-1], dx=terrain.resolution, dy=terrain.resolution)[::-1]
    image = np.repeat(0.45 + 0.5 * shade[..., None], 3, axis=2)
    for code, colour in COLOURS.items():
        here = codes[rows, columns] == code
        image[here] = 0.3 * image[here] + 0.7 * np.array(to_rgb(colour))
    x0 = terrain.offset[0] + terrain.origin[0] + columns.start * terrain.resolution
    y0 = terrain.offset[1] + terrain.origin[1] + rows.start * terrain.resolution
    x1 = x0 + image.shape[1] * terrain.resolution
    y1 = y0 + image.shape[0] * terrain.resolution
    longest = max(image.shape)
    width, height = (_LONGEST * side / longest for side in (image.shape[1], image.shape[0]))
    figure = Figure(
        figsize=(max(width, _SHORTEST), max(height, _SHORTEST)), dpi=110, layout='constrained'
    )
    FigureCanvasAgg(figure)
    axes: Any = figure.add_subplot()
    axes.imshow(image, origin='lower', extent=(x0, x1, y0, y1), interpolation='nearest')
    for vent in case.scene.vents:
        ends = [vent.position] if vent.end is None else [vent.position, vent.end]
        x = [place[0] + terrain.offset[0] for place in ends]
        y = [place[1] + terrain.offset[1] for place in ends]
        axes.plot(x, y, '^-', color='#111111', markersize=7, markeredgecolor='white')
    total = {HIT: judged.hits, MISS: judged.misses, FALSE_ALARM: judged.false_alarms}
    cell = terrain.resolution**2 / 1e6
    axes.legend(
        handles=[
            Patch(color=COLOURS[code], label=f'{_NAMES[code]} {total[code] * cell:.2f} km²')
            for code in COLOURS
        ],
        loc='best',
        fontsize=8,
    )
    axes.set_title(f'{case.title}\nJaccard {judged.jaccard:.3f}', fontsize=10)
    axes.ticklabel_format(useOffset=False, style='plain')
    axes.tick_params(labelsize=7)
    axes.tick_params(axis='x', labelrotation=30)
    axes.set_xlabel('easting [m]', fontsize=8)
    axes.set_ylabel('northing [m]', fontsize=8)
    try:
        figure.savefig(output)
    except (OSError, ValueError) as error:
        raise LavaError('output', str(output), f'a picture to write ({error})') from error


def _window(codes: np.ndarray, shape: tuple[int, int]) -> tuple[slice, slice]:
    """The part that shows all lava, with a margin."""
    lava = np.argwhere((codes >= HIT) & (codes <= FALSE_ALARM))
    margin = max(3, int(_MARGIN * np.ptp(lava, axis=0).max()))
    low = np.maximum(lava.min(axis=0) - margin, 0)
    high = np.minimum(lava.max(axis=0) + margin + 1, shape)
    return slice(int(low[0]), int(high[0])), slice(int(low[1]), int(high[1]))
