# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Layout of a printed page: title, imprint, legend and notes around the maps."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
import math
from textwrap import wrap
from typing import Any

import numpy as np

from lava_ros.errors import RefusalError
from lava_ros.products.plot import INK, Window

#: Warning on every page.
BANNER = 'SIMULATION, NOT VERIFIED'

#: Sides of A4 [inches], and resolution of a picture [pixels/inch].
_LONG, _SHORT, DPI = 11.69, 8.27, 150

#: Width of a picture for a screen [inches], so that its texts can be read on a phone, and its
#: minimum ratio of height and width.
_SCREEN, _FLATTEST = 4.6, 0.7

#: Margins around the page, above the maps, and around each map: left, right, bottom, top [inches].
_MARGIN, _HEADER, _AROUND = 0.4, 0.98, (0.42, 0.78, 0.42, 0.3)

#: Height of a line of the notes, and width of a letter [inches].
_LINE, _LETTER = 0.15, 0.061

#: Height of a row of the legend, width of a letter in it, and of its symbol [inches].
_LEGEND_ROW, _LEGEND_LETTER, _LEGEND_SYMBOL = 0.165, 0.058, 0.55

#: Height of the logo, and width of the block of agency, author and logo [inches].
_LOGO, _BLOCK = 0.58, 3.4


@dataclass(frozen=True)
class Imprint:
    """Publisher of a page: names, and the path of a logo (PNG or JPEG); all may be empty."""

    author: str = ''
    agency: str = ''
    logo: str = ''


@dataclass(frozen=True)
class Page:
    """The layout of a page: its size, its grid of maps, its footer and its header [inches].

    A picture without a header has the legend only.
    """

    width: float
    height: float
    rows: int
    columns: int
    footer: float
    legend: float
    header: float = _HEADER

    @property
    def map_size(self) -> tuple[float, float]:
        """Width and height of a map [inches]."""
        width = (self.width - 2.0 * _MARGIN) / self.columns - _AROUND[0] - _AROUND[1]
        room = self.height - self.header - self.footer
        return width, room / self.rows - _AROUND[2] - _AROUND[3]

    def axes(self, figure: Any, index: int) -> tuple[Any, tuple[float, float, float, float]]:
        """Return axes for a map, and the rectangle of its colour bar."""
        width, height = self.map_size
        row, column = divmod(index, self.columns)
        left = _MARGIN + column * (width + _AROUND[0] + _AROUND[1]) + _AROUND[0]
        top = self.height - self.header - row * (height + _AROUND[2] + _AROUND[3]) - _AROUND[3]
        room = (left / self.width, (top - height) / self.height)
        size = (width / self.width, height / self.height)
        bar = ((left + width + 0.08) / self.width, room[1], 0.13 / self.width, size[1])
        return figure.add_axes((*room, *size)), bar

    def write(
        self,
        figure: Any,
        title: str,
        subtitle: str,
        notes: Mapping[str, str],
        legend: Sequence[tuple[str, Any]],
        imprint: Imprint,
        logo: Any,
    ) -> None:
        """Write the texts, the legend and the logo outside the maps."""
        if legend:
            self._write_legend(figure, legend)
        if not self.header:
            return
        from matplotlib.patches import Rectangle

        strip = (0.0, 1.0 - 0.22 / self.height)
        amber = Rectangle(strip, 1.0, 0.22 / self.height, color='#f5c542', linewidth=0.0)
        figure.add_artist(amber)
        look: dict[str, Any] = {'fontsize': 8.5, 'weight': 'bold', 'ha': 'center'}
        self._text(figure, 0.5 * self.width, 0.11, BANNER, **look)
        room = self.width - 2.0 * _MARGIN
        room -= self._write_imprint(figure, imprint, logo)
        texts: tuple[tuple[float, str, dict[str, Any]], ...] = (
            (0.5, title, {'fontsize': 16.0, 'weight': 'bold'}),
            (0.8, subtitle, {'fontsize': 9.0}),
        )
        for down, words, look in texts:
            _shrink(self._text(figure, _MARGIN, down, ' '.join(words.split()), **look), room)
        columns = _columns(notes, self.width)
        for number, lines in enumerate(columns):
            left = _MARGIN + number * (self.width - 2.0 * _MARGIN) / len(columns)
            for line, words in enumerate(lines):
                down = self.height - self.footer + self.legend + (line + 0.5) * _LINE
                self._text(figure, left, down, words, fontsize=7.5)

    def _write_legend(self, figure: Any, legend: Sequence[tuple[str, Any]]) -> None:
        # matplotlib hides legend entries that begin with _
        names = ['\u200b' + name if name.startswith('_') else name for name, _ in legend]
        figure.legend(
            [handle for _, handle in legend],
            names,
            loc='upper left',
            bbox_to_anchor=(_MARGIN / self.width, self.footer / self.height),
            ncols=_legend_columns(names, self.width),
            fontsize=7.5,
            frameon=False,
            borderaxespad=0.0,
            borderpad=0.0,
        )

    def _text(self, figure: Any, x: float, down: float, words: str, **look: Any) -> Any:
        """Write a text at a distance from the left and from the top [inches]."""
        y = 1.0 - down / self.height
        return figure.text(x / self.width, y, words, va='center', color=INK, **look)

    def _write_imprint(self, figure: Any, imprint: Imprint, logo: Any) -> float:
        """Write agency, author and logo at the right of the title; return their width [inches]."""
        right, width = self.width - _MARGIN, 0.0
        if logo is not None:
            width = min(_LOGO * logo.width / logo.height, 0.5 * _BLOCK)
            height = width * logo.height / logo.width
            top = 0.28 + 0.5 * (_LOGO - height)
            place = (right - width, self.height - top - height, width, height)
            axes = figure.add_axes(np.divide(place, (self.width, self.height) * 2))
            axes.imshow(logo, interpolation='antialiased', aspect='auto')
            axes.set_axis_off()
            right -= width + 0.12
            width += 0.12
        lines = ((imprint.agency, 9.5, 'bold'), (imprint.author, 8.5, 'normal'))
        known = [line for line in lines if line[0]]
        downs = (0.47, 0.68) if len(known) > 1 else (0.57,)
        widest = 0.0
        for (words, size, weight), down in zip(known, downs, strict=False):
            text = self._text(
                figure, right, down, ' '.join(words.split()), ha='right', fontsize=size,
                weight=weight,
            )
            widest = max(widest, _shrink(text, _BLOCK - width))
        return width + widest + (0.2 if width + widest else 0.0)


def _shrink(text: Any, room: float) -> float:
    """Reduce the font of a text to fit a width [inches], and return its width."""
    width = float(text.get_window_extent().width) / DPI
    if width > room:
        # text width is not exactly proportional to font size
        text.set_fontsize(0.97 * text.get_fontsize() * room / width)
    return min(width, room)


def shrink_title(text: Any, axes: Any) -> None:
    """Reduce the font of a map's title so that it ends before the next map."""
    # the title may extend above the colour bar
    _shrink(text, axes.get_position().width * axes.figure.get_figwidth() + 0.7)


def _legend_columns(names: Sequence[str], width: float) -> int:
    """Return the number of columns of a legend, all as wide as the longest name."""
    longest = _LEGEND_SYMBOL + _LEGEND_LETTER * max(map(len, names))
    return max(1, min(len(names), int((width - 2.0 * _MARGIN) / longest)))


def choose_page(
    count: int, bounds: Window, notes: Mapping[str, str], legend: Sequence[str]
) -> Page:
    """Return the page layout with the largest lava; LavaError if the maps do not fit."""
    width, height = (max(bounds[axis + 2] - bounds[axis], 1.0) for axis in (0, 1))

    def size(page: Page) -> float:
        room = page.map_size
        # an empty position in the grid looks like a missing map
        full = count / (page.rows * page.columns)
        return min(room[0] / width, room[1] / height) * math.sqrt(full)

    pages = []
    for sides in ((_LONG, _SHORT), (_SHORT, _LONG)):
        rows = math.ceil(len(legend) / _legend_columns(legend, sides[0])) if legend else 0
        above = 0.13 + _LEGEND_ROW * rows
        footer = _LINE * max((len(lines) for lines in _columns(notes, sides[0])), default=0)
        footer += above + 0.15
        for columns in range(1, count + 1):
            rows = math.ceil(count / columns)
            page = Page(*sides, rows=rows, columns=columns, footer=footer, legend=above)
            if min(page.map_size) > 0.8:
                pages.append(page)
    if not pages:
        raise RefusalError('maps', f'{count} maps do not fit on one page', 'Choose fewer')
    return max(pages, key=size)


def screen_page(bounds: Window, legend: Sequence[str]) -> Page:
    """Return the layout of a picture of one map on a screen, as high as its bounds need."""
    width, height = (max(bounds[axis + 2] - bounds[axis], 1.0) for axis in (0, 1))
    rows = math.ceil(len(legend) / _legend_columns(legend, _SCREEN)) if legend else 0
    above = 0.13 + _LEGEND_ROW * rows
    page = Page(_SCREEN, 1.0, 1, 1, footer=above, legend=above, header=0.0)
    map_width, missing = page.map_size[0], 1.0 - page.map_size[1]
    shape = min(max(height / width, _FLATTEST), 1.0 / _FLATTEST)
    return replace(page, height=map_width * shape + missing)


def _columns(notes: Mapping[str, str], width: float) -> list[list[str]]:
    """Return the lines of the notes in readable columns."""
    count = round(width / 3.9)
    letters = int((width - 2.0 * _MARGIN) / count / _LETTER) - 2
    blocks = [
        wrap(f'{term}: {words}', letters, subsequent_indent='    ')
        for term, words in notes.items()
    ]
    total = sum(map(len, blocks))
    columns: list[list[str]] = [[]]
    for block in blocks:
        if len(columns) < count and len(columns[-1]) >= total / count:
            columns.append([])
        columns[-1] += block
    return [*columns, *([] for _ in range(count - len(columns)))]
