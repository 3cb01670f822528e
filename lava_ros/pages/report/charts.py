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

"""Curves over time as SVG, drawn without any library so that the page needs none."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
import math

import numpy as np

#: Size of a chart and of the margins inside it [units of its view box].
WIDTH, HEIGHT = 440.0, 240.0
LEFT, RIGHT, TOP, BOTTOM = 52.0, 12.0, 14.0, 34.0

#: Most points of a curve.
MOST_POINTS = 400


@dataclass(frozen=True, eq=False)
class Curve:
    """A quantity over increasing simulated times [s]; NaN where it has no value."""

    label: str
    times: Sequence[float]
    values: Sequence[float]


@dataclass(frozen=True, eq=False)
class Chart:
    """Curves that share their axes; ``scale`` converts their values to the unit of the chart."""

    key: str
    title: str
    unit: str
    scale: float
    curves: Sequence[Curve]


def time_unit(span: float) -> tuple[float, str]:
    """Length [s] and name of the unit that suits a time span [s]."""
    for seconds, name, least in (
        (86_400.0, 'd', 3.0 * 86_400.0),
        (3600.0, 'h', 2.0 * 3600.0),
        (60.0, 'min', 120.0),
    ):
        if span >= least:
            return seconds, name
    return 1.0, 's'


def ticks(low: float, high: float, most: int) -> list[float]:
    """Round numbers from low to high, at most so many and one."""
    span = high - low
    if not span > 0.0:
        return [low]
    power = 10.0 ** math.floor(math.log10(span / most))
    step = next(item * power for item in (1.0, 2.0, 2.5, 5.0, 10.0) if span / most <= item * power)
    first = math.ceil(low / step - 1e-9)
    last = math.floor(high / step + 1e-9)
    return [index * step for index in range(first, last + 1)]


def thinned(curve: Curve) -> Curve:
    """The curve with at most ``MOST_POINTS`` points, its ends among them."""
    count = len(curve.times)
    if count <= MOST_POINTS:
        return curve
    chosen = np.unique(np.linspace(0, count - 1, MOST_POINTS).round().astype(int))
    return Curve(
        curve.label, [curve.times[i] for i in chosen], [curve.values[i] for i in chosen]
    )


def svg(chart: Chart, start: float, end: float) -> str:
    """Draw a chart from a time to another [s]; curves have the classes c0, c1, ... ."""
    values = [value * chart.scale for item in chart.curves for value in item.values]
    known = [value for value in values if math.isfinite(value)]
    low, high = min([0.0, *known]), max([0.0, *known])
    if chart.key == 'temperature' and known:
        low = min(known)
        low, high = math.floor(low / 50.0 - 0.2) * 50.0, math.ceil(high / 50.0 + 0.2) * 50.0
    if high <= low:
        high = low + 1.0
    levels = ticks(low, high, 4)
    if high > levels[-1] + 1e-9 * high and len(levels) > 1:
        levels.append(levels[-1] + levels[1] - levels[0])
    high = max(high, levels[-1])
    span = max(end - start, 1e-9)
    seconds, unit = time_unit(end)
    inner = (WIDTH - LEFT - RIGHT, HEIGHT - TOP - BOTTOM)

    def x_of(time: float) -> float:
        return LEFT + inner[0] * (time - start) / span

    def y_of(value: float) -> float:
        return TOP + inner[1] * (1.0 - (value - low) / (high - low))

    summary = '; '.join(
        f'{item.label}: {_text(_last(item) * chart.scale)} {chart.unit} at the end'
        for item in chart.curves
    )
    parts = [
        f'<svg viewBox="0 0 {WIDTH:g} {HEIGHT:g}" role="img" data-chart="{escape(chart.key)}" '
        f'aria-label="{escape(chart.title)} over time. {escape(summary)}">'
    ]
    for level in levels:
        y = y_of(level)
        parts.append(
            f'<line class="grid" x1="{LEFT:g}" x2="{WIDTH - RIGHT:g}" y1="{y:.1f}" y2="{y:.1f}"/>'
            f'<text class="tick" x="{LEFT - 6:g}" y="{y + 4:.1f}" text-anchor="end">'
            f'{_text(level)}</text>'
        )
    for moment in ticks(start / seconds, end / seconds, 6):
        x = x_of(moment * seconds)
        parts.append(
            f'<text class="tick" x="{x:.1f}" y="{HEIGHT - BOTTOM + 17:g}" text-anchor="middle">'
            f'{moment:g}</text>'
        )
    parts.append(
        f'<text class="tick" x="{WIDTH - RIGHT:g}" y="{HEIGHT - 3:g}" text-anchor="end">'
        f'simulated time [{unit}]</text>'
    )
    for index, item in enumerate(chart.curves):
        path, pen = [], 'M'
        few = thinned(item)
        for time, value in zip(few.times, few.values, strict=True):
            if not math.isfinite(value):
                pen = 'M'
                continue
            path.append(f'{pen}{x_of(time):.1f} {y_of(value * chart.scale):.1f}')
            pen = 'L'
        parts.append(f'<path class="curve c{index}" d="{"".join(path)}"/>')
    parts.append(
        f'<line class="cursor" x1="{LEFT:g}" x2="{LEFT:g}" y1="{TOP:g}" '
        f'y2="{HEIGHT - BOTTOM:g}"/></svg>'
    )
    return ''.join(parts)


def _last(curve: Curve) -> float:
    known = [value for value in curve.values if math.isfinite(value)]
    return known[-1] if known else math.nan


def _text(value: float) -> str:
    if not math.isfinite(value):
        return 'none'
    return f'{value:.4g}' if abs(value) < 1e5 else f'{value:.3e}'
