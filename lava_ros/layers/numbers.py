# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Markdown tables, and numbers formatted for people."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
import math


def table(head: Sequence[str], body: Iterable[Sequence[str]]) -> list[str]:
    """Format a Markdown table as lines: the column titles, then rows of as many cells."""
    lines = ['| ' + ' | '.join(head) + ' |', '|---' * len(head) + '|']
    return lines + ['| ' + ' | '.join(line) + ' |' for line in body]


def percent(value: float) -> str:
    """Format a fraction as a percentage with two digits."""
    if not math.isfinite(value):
        return 'none'
    if 0.0 < value < 1e-5:
        return f'{value:.0e}'
    return f'{100.0 * value:.2g} %' if value < 0.0995 else f'{100.0 * value:.0f} %'


def seconds(value: float) -> str:
    """Format a time [s] with two digits, in a suitable unit."""
    if math.isnan(value):
        return '-'
    if value < 0.1:
        return f'{1e3 * value:.2g} ms'
    if value < 9.95:
        return f'{value:.2g} s'
    if value < 600.0:
        return f'{value:.0f} s'
    return f'{value / 60.0:.0f} min' if value < 7200.0 else f'{value / 3600.0:.1f} h'


def area_words(value: float) -> str:
    """Format an area [m2] in m² or km²; below 10 m² with two digits."""
    if value >= 1e5:
        return f'{value / 1e6:.2f} km²'
    return f'{value:.0f} m²' if value >= 9.5 else f'{value:.2g} m²'


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
    return f'{hours // 24} d' + (f' {hours % 24} h' if hours % 24 else '')
