# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Curves over time as SVG, drawn without a library so that the page needs none."""

from collections.abc import Sequence
from html import escape
import math
from typing import Any, NamedTuple

import numpy as np

from lava_ros.bag.decoding import Moment
from lava_ros.maps.frames import Recording
from lava_ros.pages.report.summary import RunSummary

#: Size of a chart and of the margins inside it [units of its view box].
WIDTH, HEIGHT = 440.0, 240.0
LEFT, RIGHT, TOP, BOTTOM = 52.0, 12.0, 14.0, 34.0

#: Maximum number of points of a curve.
MAX_POINTS = 400

#: Curves of the volume, and curves that are only drawn if they are above 0.
_VOLUMES = {'emitted': 'volume_emitted_m3', 'held': 'volume_held_m3'}
_OTHERS = {
    'lost': 'volume_left_m3',
    'lost in no-data cells': 'volume_in_holes_m3',
    'in the sea': 'volume_in_sea_m3',
    'solidified': 'volume_frozen_m3',
    'overdue in the vents': 'volume_late_m3',
}


class Curve(NamedTuple):
    """A quantity over increasing simulated times [s]; NaN where it has no value."""

    label: str
    times: Sequence[float]
    values: Sequence[float]

    def thinned(self) -> list[tuple[float, float]]:
        """Return times and values of at most ``MAX_POINTS`` points, including both ends."""
        count = len(self.times)
        chosen = np.linspace(0, count - 1, min(count, MAX_POINTS)).round().astype(int)
        return [(self.times[index], self.values[index]) for index in np.unique(chosen)]


class Chart(NamedTuple):
    """Curves that share their axes."""

    key: str
    title: str
    unit: str
    curves: list[Curve]

    def data(self) -> dict[str, Any]:
        """Return the curves as plain data for the page."""
        return {
            'key': self.key,
            'unit': self.unit,
            'curves': [
                {
                    'times': [round(time, 1) for time, _ in points],
                    'values': [
                        float(f'{value:.5g}') if math.isfinite(value) else None
                        for _, value in points
                    ],
                }
                for points in (item.thinned() for item in self.curves)
            ],
        }


def charts_of(recording: Recording, summary: RunSummary) -> list[Chart]:
    """Return charts of the volume, area, front and temperature of a run."""
    run = recording.timeline.last_run
    times = [item.time for item in run]
    volumes = [
        Curve(label, times, [item.number(name) for item in run])
        for label, name in {**_VOLUMES, **_OTHERS}.items()
    ]
    volumes = [
        item for item in volumes
        if item.label in _VOLUMES or any(value > 0.0 for value in item.values)
    ]
    is_known = math.isfinite(summary.inundated[-1])
    return [
        _scaled('volume', 'Volume', 'm³', volumes),
        _scaled('area', 'Area', 'm²', [
            *([Curve('inundated', summary.times, summary.inundated)] if is_known else []),
            Curve('standing lava', summary.times, summary.standing),
        ]),
        _scaled(
            'front', 'Distance of the front', 'm',
            [Curve('from the nearest vent', summary.times, summary.front)],
        ),
        Chart('temperature', 'Highest temperature', '°C', [_temperature(run, summary)]),
    ]


def _temperature(run: Sequence[Moment], summary: RunSummary) -> Curve:
    """Return the temperature of the hottest cell: of diagnostics, or of maps in older bags."""
    values = [item.number('highest_temperature_c') for item in run]
    if any(map(math.isfinite, values)):
        return Curve('hottest cell', [item.time for item in run], values)
    return Curve('hottest cell', summary.times, summary.hottest)


def _scaled(key: str, title: str, unit: str, curves: list[Curve]) -> Chart:
    """Return a chart, in a larger unit if its values are large."""
    most = max((v for item in curves for v in item.values if math.isfinite(v)), default=0.0)
    least, name, size = {
        'm³': (1e6, 'million m³', 1e6), 'm²': (1e5, 'km²', 1e6), 'm': (1e3, 'km', 1e3),
    }[unit]
    if most < least:
        return Chart(key, title, unit, curves)
    scale = 1.0 / size
    return Chart(
        key, title, name,
        [item._replace(values=[value * scale for value in item.values]) for item in curves],
    )


def time_unit(span: float) -> tuple[float, str]:
    """Return length [s] and name of the unit for a time span [s]."""
    for seconds, name, least in ((86_400.0, 'd', 3.0), (3600.0, 'h', 2.0), (60.0, 'min', 2.0)):
        if span >= least * seconds:
            return seconds, name
    return 1.0, 's'


def ticks(low: float, high: float, most: int) -> list[float]:
    """Return at most ``most`` + 1 round numbers from low to high."""
    span = high - low
    if not span > 0.0:
        return [low]
    power = 10.0 ** math.floor(math.log10(span / most))
    step = next(item * power for item in (1.0, 2.0, 2.5, 5.0, 10.0) if span / most <= item * power)
    first = math.ceil(low / step - 1e-9)
    last = math.floor(high / step + 1e-9)
    return [index * step for index in range(first, last + 1)]


def svg(chart: Chart, start: float, end: float) -> str:
    """Draw a chart between two times [s]; curves have the classes c0, c1, ... ."""
    known = [value for item in chart.curves for value in item.values if math.isfinite(value)]
    low, high = min([0.0, *known]), max([0.0, *known])
    if chart.key == 'temperature' and known:
        low, high = min(known), max(known)
        low, high = math.floor(low / 50.0 - 0.2) * 50.0, math.ceil(high / 50.0 + 0.2) * 50.0
    if high <= low:
        high = low + 1.0
    levels = ticks(low, high, 4)
    if high > levels[-1] + 1e-9 * high and len(levels) > 1:
        levels.append(levels[-1] + levels[1] - levels[0])
    high = max(high, levels[-1])
    span = max(end - start, 1e-9)
    seconds, unit = time_unit(end)
    right, bottom = WIDTH - RIGHT, HEIGHT - BOTTOM

    def x_of(time: float) -> float:
        return LEFT + (right - LEFT) * (time - start) / span

    def y_of(value: float) -> float:
        return TOP + (bottom - TOP) * (1.0 - (value - low) / (high - low))

    def text(x: str, y: str, anchor: str, words: str) -> str:
        return f'<text class="tick" x="{x}" y="{y}" text-anchor="{anchor}">{words}</text>'

    summary = '; '.join(
        f'{item.label}: {_text(_last(item))} {chart.unit} at the end' for item in chart.curves
    )
    parts = [
        f'<svg viewBox="0 0 {WIDTH:g} {HEIGHT:g}" role="img" data-chart="{escape(chart.key)}" '
        f'aria-label="{escape(chart.title)} over time. {escape(summary)}">'
    ]
    for level in levels:
        y = y_of(level)
        parts.append(
            f'<line class="grid" x1="{LEFT:g}" x2="{right:g}" y1="{y:.1f}" y2="{y:.1f}"/>'
            + text(f'{LEFT - 6:g}', f'{y + 4:.1f}', 'end', _text(level))
        )
    for moment in ticks(start / seconds, end / seconds, 6):
        x = x_of(moment * seconds)
        parts.append(text(f'{x:.1f}', f'{bottom + 17:g}', 'middle', f'{moment:g}'))
    parts.append(text(f'{right:g}', f'{HEIGHT - 3:g}', 'end', f'simulated time [{unit}]'))
    for index, item in enumerate(chart.curves):
        path, pen = '', 'M'
        for time, value in item.thinned():
            if math.isfinite(value):
                path += f'{pen}{x_of(time):.1f} {y_of(value):.1f}'
            pen = 'L' if math.isfinite(value) else 'M'
        parts.append(f'<path class="curve c{index}" d="{path}"/>')
    parts.append(
        f'<line class="cursor" x1="{LEFT:g}" x2="{LEFT:g}" y1="{TOP:g}" y2="{bottom:g}"/></svg>'
    )
    return ''.join(parts)


def _last(curve: Curve) -> float:
    return next((value for value in reversed(curve.values) if math.isfinite(value)), math.nan)


def _text(value: float) -> str:
    if not math.isfinite(value):
        return 'none'
    return f'{value:.4g}' if abs(value) < 1e5 else f'{value:.3e}'
