# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Charts over time of the report, as SVG."""

from collections.abc import Sequence
import math
from pathlib import Path
from typing import NamedTuple

from lava_ros.bag.decoding import Moment
from lava_ros.files.pictures import new_figure, save_picture
from lava_ros.layers.recording import Recording
from lava_ros.products.colours import time_unit
from lava_ros.products.report.summary import RunSummary
from lava_ros.simulation.output.budget import VolumeBudget, VOLUMES

#: Width and height of a chart [inches], and its resolution.
SIZE, DPI = (4.6, 2.7), 100.0

#: Colours and line styles of the curves of a chart, in their order.
_LINES = (
    ('#a5360b', '-'), ('#1f6f8b', '--'), ('#5b7f1e', '-.'), ('#7b4fa3', ':'), ('#c08a00', '-'),
    ('#333333', '--'), ('#b05a8c', '-.'), ('#4a8f8f', ':'),
)

#: Number of volumes of a budget whose curves are drawn even if they are 0: emitted and flowing.
_MAIN = 2


class Curve(NamedTuple):
    """A quantity over increasing simulated times [s]; NaN where it has no value."""

    label: str
    times: Sequence[float]
    values: Sequence[float]


class Chart(NamedTuple):
    """Curves that share their axes."""

    key: str
    title: str
    unit: str
    curves: list[Curve]

    def texts(self) -> list[tuple[str, str]]:
        """Return the names of the curves, and their last values as texts with the unit."""
        texts = []
        for item in self.curves:
            known = [value for value in item.values if math.isfinite(value)]
            last = float(f'{known[-1]:.4g}') if known else math.nan
            texts.append((item.label, f'{last:,g} {self.unit}' if known else 'none'))
        return texts

    def draw(self, output: Path) -> None:
        """Draw the curves over simulated time; the suffix of the file chooses the format.

        Raises:
            LavaError: If matplotlib is not installed, or the picture cannot be written.
        """
        unit, seconds = time_unit(max(item.times[-1] for item in self.curves))
        with new_figure('report', output, SIZE, DPI) as figure:
            axes = figure.add_axes((0.13, 0.18, 0.84, 0.76))
            for item, (colour, line) in zip(self.curves, _LINES, strict=False):
                times = [time / seconds for time in item.times]
                axes.plot(times, item.values, line, color=colour, label=item.label)
            if self.key != 'temperature':
                axes.set_ylim(bottom=0.0)
            axes.set_xlabel(f'simulated time [{unit}]', fontsize=8)
            axes.tick_params(labelsize=8)
            axes.grid(color='#d9d4cd', linewidth=0.6)
            axes.legend(fontsize=7, frameon=False)
            save_picture(figure, output, title=self.title)


def charts_of(recording: Recording, summary: RunSummary) -> list[Chart]:
    """Return charts of the volume, area, front and temperature of a run."""
    run = recording.timeline.last_run
    times = [item.time for item in run]
    unknown = VolumeBudget(*[math.nan] * len(VOLUMES))
    budgets = [(VolumeBudget.from_texts(item.values) or unknown).parts() for item in run]
    volumes = [
        Curve(label, times, [budget[label] for budget in budgets]) for label in unknown.parts()
    ]
    volumes = [
        item for number, item in enumerate(volumes)
        if number < _MAIN or any(value > 0.0 for value in item.values)
    ]
    is_known = math.isfinite(summary.inundated[-1])
    return [
        _scaled('volume', 'Volume', 'm³', volumes),
        _scaled('area', 'Area', 'm²', [
            *([Curve('inundated', summary.times, summary.inundated)] if is_known else []),
            Curve('standing', summary.times, summary.standing),
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
