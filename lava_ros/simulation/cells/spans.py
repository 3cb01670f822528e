# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Spans of the rows of a window that a step visits: two cells beyond lava and vents.

A flow down a mountain fills a small part of the rectangle around it. Each row has its own first
and last column; beyond them nothing moves. On a CPU these are multiples of eight, so that the
loops over a row need no other instructions for its end.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from lava_ros.simulation.cells.threads import shared

#: Names in C++: first and last column of a row of the window that a step visits.
COLUMNS = """
    const int* spans = s.spans.data;
    auto begin_of = [&](long i) -> long { return spans[4 * i]; };
    auto end_of = [&](long i) -> long { return spans[4 * i + 1]; };
"""

#: Names in C++: as ``COLUMNS``, and the first and last column of a row between ``left`` and
#: ``right``.
WITHIN = COLUMNS + """
    auto first_column = [&](long i) { return begin_of(i) > left ? begin_of(i) : (long)left; };
    auto last_column = [&](long i) { return end_of(i) < right ? end_of(i) : (long)right; };
"""

_FIND = """{
    const long top = s.box.data[0], bottom = s.box.data[1];
    const long left = s.box.data[2], right = s.box.data[3];
    SHARED
    const int* vents = s.vent_box.data;
    int* spans = s.spans.data;
    for (long i = first_for_warp(top); i <= last_of(bottom); i += warps) {
        const double* h = s.thickness.data + i * s.stride;
        long from = left + thread, to = from <= right ? right - (right - from) % threads : left;
        while (from <= to && h[from] == 0.0) from += threads;
        while (from <= to && h[to] == 0.0) to -= threads;
        const bool is_dry = from > to;
        from = -largest(is_dry ? -right - 1 : -from), to = largest(is_dry ? left - 1 : to);
        if (i >= vents[0] && i <= vents[1]) {
            from = vents[2] < from ? vents[2] : from;
            to = vents[3] > to ? vents[3] : to;
        }
        if (thread == 0) spans[4 * i + 2] = from, spans[4 * i + 3] = to;
    }
    together();
    for (long i = first_for_one(top); i <= last_of(bottom); i += single) {
        long from = right + 1, to = left - 1;
        for (long n = i - 2 > top ? i - 2 : top; n <= i + 2 && n <= bottom; ++n) {
            if (spans[4 * n + 2] > spans[4 * n + 3]) continue;
            from = spans[4 * n + 2] < from ? spans[4 * n + 2] : from;
            to = spans[4 * n + 3] > to ? spans[4 * n + 3] : to;
        }
        if (from <= to) {
            from = from - 2 > left ? from - 2 : left;
            to = to + 2 < right ? to + 2 : right;
            // the faces along a row fill the vectors of a CPU
            if (is_serial) from &= -8, to = to + 7 < s.stride ? (to + 7) & -8 : s.stride - 1;
        }
        spans[4 * i] = from, spans[4 * i + 1] = to;
    }
    together();
}"""


@lru_cache
def spans_function(cells_type: Any, blocks: int = 1) -> Any:
    """Return the device function that finds the spans of the window.

    ``cells_type`` is ``Cells``, ``blocks`` the number of blocks of a world on a GPU.
    """

    @wp.func_native(_FIND.replace('SHARED', shared(blocks)))
    def find_spans(s: cells_type): ...

    return find_spans
