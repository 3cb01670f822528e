# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The shipped masks in costmaps that move with the robot, and in static ones, without Nav2."""

from dataclasses import replace
from itertools import product
import math
from pathlib import Path

import numpy as np
import pytest
import yaml

from lava_ros.layers.layer_files import load_layers
from scripts import load_script

ROOT = Path(__file__).parents[2]
FILTERS = yaml.safe_load((ROOT / 'params/nav2_filters.yaml').read_text(encoding='utf-8'))

#: Radius of the robot, and side of a cell of the costmap [m]; updates of the costmap [Hz].
RADIUS, CELL, UPDATES = 0.3, 0.05, 5.0

allowed_delay = load_script(ROOT / 'docs/benchmarks/nav2_tables.py').allowed_delay


class Window:
    """A rolling costmap of Nav2 1.3 with a keepout filter, as in LayeredCostmap::updateMap.

    ``drawn`` is true where the costmap has the mask. A mask is drawn with the next update, in as
    many columns and rows as it has. The cells that the window reaches are empty.
    """

    def __init__(self, side, mask_cells, position):
        self.count = round(side / CELL)
        self.drawn = np.zeros((self.count, self.count), bool)
        self._mask_cells = mask_cells
        self._corner = self._corner_at(position)

    def _corner_at(self, position):
        return np.floor(np.asarray(position) / CELL).astype(int) - self.count // 2

    def update(self, position, *, has_new_mask):
        corner = self._corner_at(position)
        (column, row), self._corner = corner - self._corner, corner
        before, self.drawn = self.drawn, np.zeros_like(self.drawn)

        def overlap(shift):
            ends = max(0, shift), min(self.count, self.count + shift)
            return slice(*ends), slice(ends[0] - shift, ends[1] - shift)

        (old_rows, rows), (old_columns, columns) = overlap(row), overlap(column)
        self.drawn[rows, columns] = before[old_rows, old_columns]
        if has_new_mask:
            self.drawn[: self._mask_cells, : self._mask_cells] = True

    def has_mask_under(self, position):
        centres = (self._corner[:, None] + np.arange(self.count) + 0.5) * CELL
        x, y = centres - np.asarray(position)[:, None]
        columns, rows = np.abs(x) < RADIUS, np.abs(y) < RADIUS
        near = np.hypot(x[None, columns], y[rows, None]) < RADIUS
        return bool(self.drawn[np.ix_(rows, columns)][near].all())


def drive(side, speed, heartbeat, mask_cells, *, direction, phase):
    """Return True if the window has the mask under the robot at all times of a drive.

    Masks arrive with the heartbeat [s], ``phase`` [s] after an update of the costmap.
    """
    window, period = Window(side, mask_cells, (0.0, 0.0)), 1.0 / UPDATES
    unit = np.array([math.cos(direction), math.sin(direction)])
    window.update((0.0, 0.0), has_new_mask=True)
    is_whole, arrived = True, 0
    for index in range(1, math.ceil((0.5 * side / speed + 3.0 * heartbeat) / period)):
        time = index * period
        position = speed * time * unit
        # shortly before the update, the robot is still in the last window
        is_whole &= window.has_mask_under(speed * (time - 1e-6) * unit)
        count = math.floor((time - phase) / heartbeat) + 1
        window.update(position, has_new_mask=count > arrived)
        arrived = max(count, arrived)
        is_whole &= window.has_mask_under(position)
    return is_whole


def masks_of(costmap, file):
    """Return the keepout masks of the filters of a shipped costmap, in a file of layers."""
    servers = [item['ros__parameters'] for name, item in FILTERS.items() if 'info_server' in name]
    topics = {item['filter_info_topic']: item['mask_topic'] for item in servers}
    values = FILTERS[costmap][costmap]['ros__parameters']
    filters = [values[name] for name in values['filters']]
    named = [topics[item['filter_info_topic']] for item in filters if 'Keepout' in item['plugin']]
    layers = {f'/{layer.topic}': layer for layer in load_layers(ROOT / 'msg_configs' / file)}
    return [layers[topic] for topic in named]


def is_safe(side, speed, heartbeat, mask_cells):
    """Return True if all of several drives have the mask under the robot."""
    ways = product((0.0, math.pi, 4.0), (0.001, 0.1, 0.199))
    return all(
        drive(side, speed, heartbeat, mask_cells, direction=direction, phase=phase)
        for direction, phase in ways
    )


@pytest.mark.parametrize('file', ['nav2_keepout.yaml', 'nav2_speed.yaml'])
@pytest.mark.parametrize('speed', [0.25, 0.5, 1.0])
@pytest.mark.parametrize('side', [3.0, 5.0, 10.0])
def test_shipped_mask_is_under_a_robot_that_drives_in_a_window(file, side, speed):
    (mask,) = masks_of('local_costmap', file)
    # a small terrain has no more cells than the mask is padded to
    assert is_safe(side, speed, mask.heartbeat, mask.min_cells)
    # so it has if every mask is late, as on a busy machine
    delay = allowed_delay(side, speed, mask.heartbeat)
    assert delay > 0.4
    assert is_safe(side, speed, mask.heartbeat + delay - 1e-3, mask.min_cells)


@pytest.mark.parametrize(('side', 'speed', 'heartbeat', 'cells', 'is_whole'), [
    (3.0, 0.25, 1.0, 256, True),
    (3.0, 0.5, 1.0, 256, True),
    (3.0, 1.0, 1.3, 256, False),
    (3.0, 0.5, 5.0, 256, False),
    # only the corner of a window that has more cells than the mask is drawn
    (10.0, 0.25, 0.5, 60, False),
])
def test_mask_is_lost_in_a_window_without_heartbeat_or_cells(
    side, speed, heartbeat, cells, is_whole
):
    assert is_safe(side, speed, heartbeat, cells) is is_whole


@pytest.mark.parametrize('file', ['nav2_keepout.yaml', 'nav2_speed.yaml'])
def test_padded_mask_has_the_cells_of_the_mask(file):
    (mask,), (padded,) = (masks_of(name, file) for name in ('local_costmap', 'global_costmap'))
    assert (padded.min_cells, padded.heartbeat) == (2048, 5.0)
    same = {name: getattr(mask, name) for name in ('name', 'topic', 'min_cells', 'heartbeat')}
    assert replace(padded, **same) == mask
