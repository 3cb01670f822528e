# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Decoding of recorded grids."""

import numpy as np
import pytest

from lava_ros.layers.decoded import without_border
from lava_ros.layers.frame import LayerFrame
from lava_ros.layers.layer_files import layers_from_dict
from recording import TERRAIN

#: A layer whose grid has 7 rows below the terrain, 8 above, 2 columns to the left and 3 to the
#: right.
LAYERS = layers_from_dict({'layers': {'height': {
    'source': 'thickness', 'message': 'nav_msgs/OccupancyGrid', 'range': [0.0, 10.0],
    'min_cells': 45,
}}})

PLACE = (5.0, -50.0, 20.0)


@pytest.mark.parametrize(('where', 'shape', 'is_cut'), [
    ((5.0, -60.0, -15.0), (45, 45), True),
    # rounding of the resolution
    ((5.0, -60.002, -15.0), (45, 45), True),
    # one cell aside, another size, an image
    ((5.0, -55.0, -15.0), (45, 45), False),
    ((5.0, -60.0, -20.0), (45, 45), False),
    ((5.0, -60.0, -15.0), (45, 44), False),
    (None, (45, 45), False),
])
def test_border_is_cut_off_a_grid_around_the_terrain(where, shape, is_cut):
    values = np.arange(np.prod(shape), dtype=np.float32).reshape(shape)
    shown = LayerFrame(LAYERS[0], values, False)
    found, place = without_border(shown, where, TERRAIN, PLACE)
    if is_cut:
        assert place == PLACE
        np.testing.assert_array_equal(found.values, values[7:37, 2:42])
    else:
        assert found is shown and place is where
