# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The chart of a report: error against cost, the front as a line and the presets in colour."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from functools import partial
import math
from pathlib import Path
from typing import Any

from lava_ros.files.pictures import new_figure, save_picture
from lava_ros.layers.numbers import percent, seconds
from lava_ros.verification.rows import pareto_front, Point, points, presets_of, Row

_INK, _GREY, _FRONT = '#222222', '#9aa0a6', '#d1495b'

#: Colours of the presets, starting with the fastest, and of the paper's.
_COLOURS = ('#fb9a06', '#e2583b', '#a92e5e', '#3d0f56', '#5f6368')

#: Ticks within a decade on an axis of more than some decades.
_SUBDIVISIONS = (
    (2.5, (1.0,)), (1.2, (1.0, 3.0)), (0.8, (1.0, 2.0, 5.0)), (0.0, (1.0, 1.5, 2.0, 3.0, 5.0, 7.0))
)


def draw(
    rows: Sequence[Row], titles: dict[str, str], output: Path, before: Sequence[Row] = ()
) -> None:
    """Draw a panel for each case with a cost, under its title; the suffix chooses the format.

    ``titles`` has the title of each case by name, ``before`` the rows of an earlier report. The
    heading has the machine of most rows, and a panel any other one.

    Raises:
        LavaError: If matplotlib is not installed, or the picture cannot be written.
    """
    everything = [item for item in points(rows) if math.isfinite(item.cost)]
    # points with a missing result are shown only for presets, at their largest known error
    everything = [item for item in everything if item.preset or math.isfinite(item.error)]
    # without a sweep of settings there is no Pareto front
    swept = list(dict.fromkeys(point.case for point in everything if not point.preset))
    cases = swept or list(dict.fromkeys(point.case for point in everything))
    colours = dict(zip(presets_of(everything), _COLOURS, strict=False))
    machine = Counter(row.machine for row in rows).most_common(1)[0][0]
    columns = max(1, min(len(cases), 3))
    lines = max(1, math.ceil(len(cases) / columns))
    width, height = (7.2, 5.2) if columns == 1 else (4.0 * columns, 3.3 * lines + 1.1)
    former = [item for item in points(before) if math.isfinite(item.cost)]
    with new_figure('chart', output, (width, height), dpi=130) as figure:
        for index, name in enumerate(cases):
            axes = figure.add_subplot(lines, columns, index + 1)
            found = [point for point in everything if point.case == name]
            _draw_case(axes, found, colours)
            front = pareto_front([point for point in former if point.case == name])
            axes.plot(*_places(front), color=_GREY, linestyle='--', linewidth=1.3, zorder=1)
            axes.set_title(titles.get(name, name), loc='left', fontsize=10, color=_INK)
            others = dict.fromkeys(row.machine for row in rows if row.case == name)
            others.pop(machine, None)
            axes.text(0.98, 0.97, '\n'.join(others), transform=axes.transAxes, fontsize=7,
                      color='#555555', va='top', ha='right')
            if index % columns == 0:
                axes.set_ylabel('largest relative error', fontsize=9, color=_INK)
            if index + columns >= len(cases):
                axes.set_xlabel('wall time for an hour of the flow', fontsize=9, color=_INK)
        top = 1.0 - 0.2 / height
        figure.text(0.012, top, 'What accuracy costs', fontsize=14, weight='bold', color=_INK,
                    va='center')
        figure.text(0.988, top, machine, fontsize=9, color='#555555', va='center',
                    ha='right')
        _draw_legend(figure, colours, height, has_former=bool(former))
        if not cases:
            figure.text(0.5, 0.45, 'No time was simulated: there is no cost to show', ha='center',
                        color='#555555')
        else:
            figure.tight_layout(rect=(0.0, 0.0, 1.0, 1.0 - 0.62 / height), w_pad=1.2, h_pad=1.2)
        save_picture(figure, output, title='What accuracy costs')


def _draw_case(axes: Any, found: Sequence[Point], colours: dict[str, str]) -> None:
    axes.set_xscale('log')
    axes.set_yscale('log')
    plain = [point for point in found if not point.preset]
    axes.scatter(*_places(plain), s=13, color=_GREY, linewidths=0, alpha=0.75, zorder=2)
    axes.plot(*_places(pareto_front(found)), color=_FRONT, linewidth=1.3, zorder=3)
    for point in found:
        if point.preset:
            axes.scatter(
                *_places([point]), s=58, marker='o' if math.isfinite(point.error) else '^',
                color=colours[point.preset], edgecolors='white', linewidths=1.2, zorder=4,
            )
    _set_limits(axes, found)
    axes.grid(which='major', color='#e6e6e6', linewidth=0.7, zorder=0)
    axes.set_axisbelow(True)
    axes.spines[['top', 'right']].set_visible(False)
    axes.spines[['left', 'bottom']].set_color('#888888')
    axes.tick_params(which='both', labelsize=8, color='#888888', labelcolor=_INK)


def _places(found: Sequence[Point]) -> tuple[list[float], list[float]]:
    # errors below 1e-7 are rounding
    return [point.cost for point in found], [max(point.least, 1e-7) for point in found]


def _set_limits(axes: Any, found: Sequence[Point]) -> None:
    """Set axis limits, and ticks at powers of ten with more in between the shorter the axis."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    costs, errors = _places(found)
    axes.set(
        xlim=(min(costs) / 1.6, max(costs) * 1.6), ylim=(min(errors) / 1.6, max(errors) * 1.6)
    )
    for axis, text in ((axes.xaxis, seconds), (axes.yaxis, percent)):
        low, high = axis.get_view_interval()
        decades = math.log10(high / low)
        subs = next(subs for least, subs in _SUBDIVISIONS if decades > least)
        axis.set_major_locator(LogLocator(subs=subs))
        axis.set_major_formatter(FuncFormatter(lambda value, _, text=text: text(value)))
        axis.set_minor_formatter(NullFormatter())


def _draw_legend(
    figure: Any, colours: dict[str, str], height: float, *, has_former: bool
) -> None:
    from matplotlib.lines import Line2D

    dot = partial(Line2D, [], [], marker='o', linestyle='')
    handles = [
        dot(markersize=7.5, color=colour, markeredgecolor='white', label=name)
        for name, colour in colours.items()
    ]
    handles += [
        Line2D([], [], color=_FRONT, linewidth=1.3, label='front'),
        dot(markersize=4, color=_GREY, markeredgecolor='none', label='other settings'),
    ]
    if has_former:
        handles.append(Line2D([], [], color=_GREY, linestyle='--', label='front before'))
    figure.legend(
        handles=handles, loc='center left', bbox_to_anchor=(0.006, 1.0 - 0.47 / height),
        ncols=len(handles), frameon=False, fontsize=9, handletextpad=0.3, columnspacing=1.3,
        borderpad=0.0,
    )
