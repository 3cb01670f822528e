# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The accuracy pages in Markdown, for conf.py: presets, studies by their settings, every case."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
import math

import numpy as np

from lava_ros.layers.numbers import percent, seconds
from lava_ros.simulation.presets import DEFAULT
from lava_ros.verification import measure
from lava_ros.verification.cases import EFFECT_CASES
from lava_ros.verification.cases.case import slope_of
from lava_ros.verification.cases.sheets import LATERAL
from lava_ros.verification.rows import pareto_front, Point, points, presets_of, Row

#: The rows of a case at a setting, by quantity.
Result = dict[str, Row]

#: Relative difference within which errors count as equal.
ALIKE = 0.01


def table(head: Sequence[str], body: Iterable[Sequence[str]]) -> list[str]:
    """Format a Markdown table as lines: the column titles, then rows of as many cells."""
    lines = ['| ' + ' | '.join(head) + ' |', '|---' * len(head) + '|']
    return lines + ['| ' + ' | '.join(line) + ' |' for line in body]


def markdown(rows: Sequence[Row], titles: dict[str, str], *, stem: str) -> str:
    """Return the report as Markdown: presets first, then the studies, then every setting.

    ``titles`` has the title of each case by name; ``stem`` is the file name of the CSV and the
    chart, without suffix.
    """
    commands = [f'`{command}`' for command in dict.fromkeys(row.command for row in rows)]
    machines = ', '.join(dict.fromkeys(row.machine for row in rows))
    lines = [
        f'# Accuracy against time: {machines}',
        '',
        f'Made by {", ".join(commands)}; every measurement is in [{stem}.csv]({stem}.csv). '
        'The error of a case is the largest error of its quantities. The cost is the wall time '
        'for an hour of the flow with compiled kernels, the median of the repetitions. Runs that '
        'would have taken too long were left out. Bold settings are on the Pareto front: nothing '
        'is both faster and more accurate. An error without a result is `none`; the chart then '
        'shows a triangle at the largest error that is known.',
        '',
        *_charts(rows, stem),
        *_preset_table(points(rows), titles),
        *studies(rows, titles),
    ]
    for name in dict.fromkeys(row.case for row in rows if row.case != LATERAL):
        lines += [f'## {titles.get(name, name)}', '']
        lines += [*_case_table([row for row in rows if row.case == name]), '']
    return '\n'.join(lines)


def _charts(rows: Sequence[Row], stem: str) -> list[str]:
    """Return the charts: of the flows, and of the effects if there are any."""
    names = {row.case for row in rows}
    lines = [f'![Error against cost]({stem}.png)', ''] if names - EFFECT_CASES else []
    if names & EFFECT_CASES:
        lines += [f'![Error against cost, effects]({stem}_effects.png)', '']
    return lines


def _preset_table(found: Sequence[Point], titles: dict[str, str]) -> list[str]:
    presets = presets_of(found)
    texts = {
        (point.case, point.preset): f'{percent(point.error)} in {seconds(point.cost)}'
        for point in found
        if point.preset
    }
    body = [
        [titles.get(name, name), *(texts.get((name, preset), '') for preset in presets)]
        for name in dict.fromkeys(case for case, _ in texts)
    ]
    return ['## Presets', '', *table(['case', *presets], body), ''] if body else []


def _case_table(rows: Sequence[Row]) -> list[str]:
    """Return a table of every setting of a case, from fast to slow; the front is bold."""
    quantities = list(dict.fromkeys(row.quantity for row in rows))
    front = {point.setting for point in pareto_front(points(rows))}
    body = []
    for setting, result in sorted(_results(rows).items(), key=lambda item: _any(item[1]).wall_s):
        one = _any(result)
        label = f'{one.preset}: {setting}' if one.preset else setting
        took = f'{seconds(one.low)} to {seconds(one.high)}'
        body.append([
            f'**{label}**' if setting in front else label,
            *_errors(result, quantities),
            *_work(one),
            seconds(one.wall_s_per_simulated_hour),
            took if one.repetitions > 1 else seconds(one.wall_s),
        ])
    head = ['setting', *quantities, 'particles', 'steps', 'evaluations', 'cost', 'a run took']
    return table(head, body)


def _work(row: Row) -> list[str]:
    """Return particles, steps and evaluations."""
    return [f'{count:,}' for count in (row.particles, row.steps, row.evaluations)]


def studies(rows: Sequence[Row], titles: dict[str, str]) -> list[str]:
    """Return the sections of all studies whose settings were measured, as lines of Markdown."""
    knob = [row for row in rows if row.case in measure.KNOB_CASES]
    return [
        *_convergence(knob),
        *_stepping(knob),
        *_from_paper(knob),
        *_gradients(rows, titles),
        *_lateral([row for row in rows if row.case == LATERAL]),
    ]


def _section(
    title: str, text: str, head: Sequence[str], body: Sequence[Sequence[str]]
) -> list[str]:
    """Return a section with a table, or nothing if the table has no rows."""
    return [f'## {title}', '', text, '', *table(head, body), ''] if body else []


def _results(rows: Iterable[Row]) -> dict[str, Result]:
    """Return the rows by setting and quantity."""
    found: dict[str, Result] = {}
    for row in rows:
        found.setdefault(row.setting, {})[row.quantity] = row
    return found


def _any(result: Result) -> Row:
    return next(iter(result.values()))


def _errors(result: Result, quantities: Iterable[str]) -> list[str]:
    return [percent(result[name].error) if name in result else '' for name in quantities]


def _convergence(rows: Sequence[Row]) -> list[str]:
    """Return the errors at every doubling, and their order in the particle spacing."""
    found = _results(rows)
    names = map(measure.name_of, measure.convergence())
    results = [found[name] for name in names if name in found]
    if len(results) < 2:
        return []
    quantities = list(results[0])
    spacing = [_any(result).particles ** -0.5 for result in results]
    errors = {name: [result[name].error for result in results] for name in quantities}
    body = []
    for index, result in enumerate(results):
        cells = [f'{_any(result).particles:,}']
        for name in quantities:
            pair = slice(index - 1, index + 1)
            order = _order(spacing[pair], errors[name][pair]) if index else ''
            cells += [percent(errors[name][index]), order]
        body.append([*cells, seconds(_any(result).wall_s)])
    orders = (word for name in quantities for word in ('', _order(spacing, errors[name])))
    body.append(['least squares', *orders, ''])
    head = ['particles', *(word for name in quantities for word in (name, 'order')), 'a run took']
    text = (
        f'The fixed volume at `{DEFAULT}` with steps half as long, whose error is then small, and '
        'repeated doubling of the particles. The order is the slope of log error against log '
        'particle spacing, from one line to the next and through all of them.'
    )
    return _section('Convergence', text, head, body)


def _order(spacing: Sequence[float], errors: Sequence[float]) -> str:
    if not all(math.isfinite(error) and error > 0.0 for error in errors):
        return '-'
    return f'{slope_of(np.log(spacing), np.log(errors)):.2f}'


def _stepping(rows: Sequence[Row]) -> list[str]:
    """Return the savings of the second-order integrator over Euler's, and larger errors."""
    found = _results(rows)
    body: list[list[str]] = []
    quantities: list[str] = []
    euler: Result | None = None
    for accuracy in measure.stepping():
        result = found.get(measure.name_of(accuracy))
        is_euler = accuracy.integrator == 'euler'
        euler = result if is_euler else euler
        if result is None:
            continue
        quantities = list(result)
        one = _any(result)
        particles, *work = _work(one)
        saved = larger = '' if is_euler else '-'
        if euler and not is_euler:
            saved = f'{_any(euler).evaluations / one.evaluations:.1f}'
            larger = _larger(result, euler)
        integrator = [accuracy.integrator.upper(), f'{accuracy.courant_number:g}']
        errors = _errors(result, quantities)
        body.append([particles, *integrator, *work, saved, *errors, larger, seconds(one.wall_s)])
    head = ['particles', 'integrator', 'Courant number', 'steps', 'evaluations']
    head += ["Euler's over these", *quantities, "larger than Euler's", 'a run took']
    text = (
        'The fixed volume with second-order super-time-stepping (RKL2) and with Euler steps, all '
        f'else as in `{DEFAULT}`: velocity evaluations, and the quantities whose error is larger '
        f"than Euler's by more than {100.0 * ALIKE:.0f} %."
    )
    return _section('Super-time-stepping', text, head, body if len(body) > 1 else [])


def _larger(result: Result, reference: Result) -> str:
    """Return the quantities whose errors are larger than a reference's, or NaN."""
    most = {name: (1.0 + ALIKE) * row.error for name, row in reference.items()}
    larger = (name for name, row in result.items() if not row.error <= most[name])
    return ', '.join(larger) or 'none'


def _from_paper(rows: Sequence[Row]) -> list[str]:
    """Return the steps from the paper's settings to the default, one correction each."""
    found = _results(rows)
    ways = {
        label: found.get(measure.name_of(accuracy))
        for label, accuracy in measure.paper_settings().items()
    }
    paper = next(iter(ways.values()))
    if paper is None:
        return []
    quantities = list(paper)
    body = []
    for label, result in ways.items():
        if result is not None:
            particles, _, evaluations = _work(_any(result))
            errors, took = _errors(result, quantities), seconds(_any(result).wall_s)
            body.append([label, *errors, particles, evaluations, took])
    head = ['setting', *quantities, 'particles', 'evaluations', 'a run took']
    text = f'The fixed volume. {_dominated(rows, paper)}'
    return _section("From the paper's settings to ours", text, head, body)


def _dominated(rows: Sequence[Row], paper: Result) -> str:
    """Return the errors of the paper's settings and of the best that takes no longer."""
    known = [row for row in paper.values() if math.isfinite(row.error)]
    limit = _any(paper).wall_s_per_simulated_hour
    front = [item for item in pareto_front(points(rows)) if item.cost <= limit]
    if not known or not front:
        return ''
    worst, best = max(known, key=lambda row: row.error), front[-1]
    return (
        f'The best setting that takes no longer than `as-published` is '
        f'{best.preset or best.setting}: its largest error is {percent(best.error)}, in '
        f'{seconds(best.cost)} instead of {seconds(limit)} for an hour of the flow. The largest '
        f'error of `as-published` is {percent(worst.error)} ({worst.quantity}), so the ratio of '
        f'the errors is {best.error / worst.error:.2g}.'
    )


def _gradients(rows: Sequence[Row], titles: dict[str, str]) -> list[str]:
    """Return the forms of the surface's gradient, by quantity."""
    names = [*map(measure.name_of, measure.gradients().values())]
    body = []
    for case in measure.GRADIENT_CASES:
        found = _results(row for row in rows if row.case == case)
        if not all(name in found for name in names):
            continue
        results = [found[name] for name in names]
        title = titles.get(case, case)
        body += [
            [title, quantity, *(percent(result[quantity].error) for result in results)]
            for quantity in results[0]
        ]
        body.append([title, 'a run took', *(seconds(_any(item).wall_s) for item in results)])
    text = f'`Accuracy.gradient` with all else as in `{DEFAULT}`.'
    head = ['case', 'quantity', *measure.gradients()]
    return _section('Gradient forms', text, head, body)


def _lateral(rows: Sequence[Row]) -> list[str]:
    """Return errors and time of each kind of lateral stress, by kernel radius over thickness."""
    cells: dict[tuple[str, float], dict[str, str]] = {}
    time = 'time per particle and evaluation'
    for name, result in _results(rows).items():
        kind, radius = name.removesuffix(' h').split(', l = ')
        texts = {quantity: percent(row.error) for quantity, row in result.items()}
        one = _any(result)
        work = one.evaluations * one.particles
        texts[time] = f'{float(f"{1e9 * one.wall_s / work:.2g}"):,g} ns' if work else '-'
        cells[kind, float(radius)] = texts
    kinds = list(dict.fromkeys(kind for kind, _ in cells))
    quantities = list(dict.fromkeys(row.quantity for row in rows))
    body = [
        [name, f'{radius:g}', *(cells.get((kind, radius), {}).get(name, '') for kind in kinds)]
        for name in (*quantities, time)
        for radius in sorted({radius for _, radius in cells})
        if any(name in cells.get((kind, radius), {}) for kind in kinds)
    ]
    text = (
        'The response to a driving term sin(q x), by the kernel radius l over the thickness h: '
        'relative error at each wavelength that the particles resolve, and wall time of a '
        'velocity evaluation over the particles. `local` has no lateral stress.'
    )
    return _section('Lateral stress', text, ['quantity', 'l/h', *kinds], body)
