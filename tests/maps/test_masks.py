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

"""Masks for Nav2: what its filters make of them, cell by cell."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from lava_ros.maps.layer_files import layers_from_dict, load_layers
from lava_ros.maps.layers import within
from lava_ros.scene import Terrain
from lava_ros.simulation.snapshot import Snapshot
from recording import snapshot_at

CONFIGS = Path(__file__).parents[2] / 'msg_configs'
RESOLUTION = 10.0

#: What Nav2's costmaps call a wall, and the cost that already counts as a collision.
LETHAL, INSCRIBED = 254, 253


def keepout_cost(value: int, cost: int) -> int:
    """The cost of a cell after Nav2's KeepoutFilter, by its documentation."""
    return cost if value == -1 else max(cost, round(2.54 * value))


def speed_limit(value: int, last: float, base: float = 0.0, multiplier: float = 1.0) -> float:
    """The limit after Nav2's SpeedFilter [percent], 0.0 for none, by its documentation."""
    if value == -1:
        return last
    limit = 0.0 if value == 0 else base + multiplier * value
    return limit if 0.0 <= limit <= 100.0 else 0.0


def _snapshot() -> Snapshot:
    """A row of cells: lava from cell 40 on, thicker and hotter eastwards; none at the end."""
    thickness = np.zeros((3, 60), dtype=np.float32)
    celsius = np.full((3, 60), np.nan, dtype=np.float32)
    thickness[1, 40:50] = [0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0, 2.0, 5.0, 5.0]
    celsius[1, 40:50] = [50.0, 60.0, 100.0, 150.0, 200.0, 300.0, 500.0, 800.0, 1000.0, np.nan]
    thickness[:, 58:] = np.nan
    terrain = Terrain(np.where(np.isnan(thickness), np.nan, 100.0), RESOLUTION)
    snapshot = snapshot_at(1.0, thickness, terrain)
    return dataclasses.replace(snapshot, temperature=celsius + np.float32(273.15))


SNAPSHOT = _snapshot()
WET = SNAPSHOT.thickness > 0.0
OUTSIDE = np.isnan(SNAPSHOT.thickness)
ROWS, COLUMNS = np.indices(WET.shape)
DISTANCE = RESOLUTION * np.min(
    [np.hypot(ROWS - row, COLUMNS - column) for row, column in np.argwhere(WET)], axis=0
)


def _mask(file: str, name: str) -> np.ndarray:
    (layer,) = [layer for layer in load_layers(CONFIGS / file) if layer.name == name]
    assert (layer.topic, layer.enabled) == (name, True)
    assert (layer.qos.reliability, layer.qos.durability) == ('reliable', 'transient_local')
    return layer.values(SNAPSHOT)


@pytest.mark.parametrize('file', ['nav2_keepout.yaml', 'nav2_speed.yaml'])
def test_the_keepout_mask_is_a_wall_or_nothing(file):
    """Every lava cell, its margin and the outside are lethal to Nav2; all else is left alone."""
    mask = _mask(file, 'keepout_mask')
    assert set(np.unique(mask)) == {0, 100}
    forbidden = (DISTANCE <= 20.0) | OUTSIDE
    np.testing.assert_array_equal(mask == 100, forbidden)
    costs = np.vectorize(keepout_cost)(mask, 7)
    np.testing.assert_array_equal(costs == LETHAL, forbidden)
    assert (costs[~forbidden] == 7).all()


def test_the_hazard_grid_itself_is_no_wall():
    """Why there is a mask: hazard below 100 is a price to Nav2, and -1 is permission."""
    (layer,) = [item for item in load_layers(CONFIGS / 'default.yaml') if item.name == 'hazard']
    values = layer.values(SNAPSHOT)
    costs = np.vectorize(keepout_cost)(values, 0)
    assert (costs[WET] < INSCRIBED).any()
    assert (costs[OUTSIDE] == 0).all()


def test_the_speed_mask_limits_wherever_lava_is_near():
    """Percent of full speed: 50 near lava, down to 10 in it, none far away, never an error."""
    mask = _mask('nav2_speed.yaml', 'speed_mask')
    assert (mask >= 0).all()
    limits = np.vectorize(speed_limit)(mask, np.nan)
    near = (DISTANCE <= 100.0) & ~WET & ~OUTSIDE
    far = (DISTANCE > 100.0) & ~OUTSIDE
    assert far.any()
    assert (limits[near] == 50.0).all()
    assert (limits[far] == 0.0).all()
    assert (limits[OUTSIDE] == 10.0).all()
    assert ((limits[WET] >= 10.0) & (limits[WET] <= 50.0)).all()
    assert (np.diff(limits[1, 40:50]) <= 0.0).all()
    assert limits[1, 48] == 10.0


def test_lava_of_unknown_temperature_counts_as_the_worst():
    """Its cell is a wall in the one mask and has the lowest limit in the other."""
    assert np.isnan(SNAPSHOT.temperature[1, 49])
    assert _mask('nav2_keepout.yaml', 'keepout_mask')[1, 49] == 100
    assert _mask('nav2_speed.yaml', 'speed_mask')[1, 49] == 10


def _layer(**changes):
    data = {'source': 'thickness', 'message': 'nav_msgs/OccupancyGrid', **changes}
    return layers_from_dict({'layers': {'one': data}})[0]


def test_a_step_is_of_the_source():
    """From the step on a cell is 100, below it 0, and a wet cell below it is no exception."""
    values = _layer(step=0.5).values(SNAPSHOT)
    assert values[1, 40:50].tolist() == [0, 0, 0, 0, 0, 100, 100, 100, 100, 100]
    values = _layer(source='temperature', step=300.0, threshold=0.0).values(SNAPSHOT)
    # The last temperature is unknown.
    assert values[1, 40:50].tolist() == [0] * 5 + [100] * 5
    values = _layer(step=0.5, margin=10.0).values(SNAPSHOT)
    assert values[1, 40:52].tolist() == [0] * 4 + [100] * 7 + [0]


def test_scales_run_either_way():
    """The ends of the range are the ends of the scale; a cell with lava is never 0."""
    up = _layer(range=[0.0, 5.0], scale=[20, 80], threshold=0.0).values(SNAPSHOT)
    assert up[1, 40] == 20 and up[1, 46] == 32 and up[1, 48] == 80
    down = _layer(range=[0.0, 5.0], scale=[100, 0], threshold=0.0).values(SNAPSHOT)
    assert down[1, 40] == 100 and down[1, 46] == 80 and down[1, 48] == 1
    assert (up[0] == down[0])[:58].all()


@pytest.mark.parametrize('distance', [0.0, 0.9, 1.0, 1.5, 2.0, 3.7, 40.0])
@pytest.mark.parametrize('share', [0.0, 0.01, 0.2, 1.0])
def test_within_is_what_every_pair_says(distance, share):
    """A cell is near exactly when the distance to some marked cell says so."""
    marked = np.random.default_rng(1).random((17, 23)) < share
    rows, columns = np.indices(marked.shape)
    expected = marked.copy()
    for row, column in np.argwhere(marked):
        expected |= np.hypot(rows - row, columns - column) <= distance
    before = marked.copy()
    np.testing.assert_array_equal(within(marked, distance), expected)
    np.testing.assert_array_equal(marked, before)
