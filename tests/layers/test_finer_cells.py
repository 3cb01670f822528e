# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Lethal area of a flow on the cells of its terrain, and on a resampled terrain."""

from dataclasses import replace
from pathlib import Path
import re

import numpy as np
import pytest
from rasterio.crs import CRS
from rasterio.transform import Affine
from rasterio.warp import reproject, Resampling

from lava_ros.files.resources import share_path
from lava_ros.layers.layer_files import load_layers
from lava_ros.scene import scene_from_yaml
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy

PAGE = Path(__file__).parents[2] / 'docs/ROS.md'

#: Simulated time [s] and distance between particles [m] of the figures in the page.
END, SPACING = 3600.0, 2.5


def resampled(terrain, cell):
    """Resample a terrain bilinearly."""
    size = np.multiply(terrain.shape, terrain.resolution)
    values = np.empty(np.round(size / cell).astype(int))
    # row 0 of a terrain is in the south
    source, target = (Affine.scale(side) for side in (terrain.resolution, cell))
    reproject(
        terrain.elevation.astype(float), values, src_transform=source, dst_transform=target,
        src_crs=CRS.from_epsg(32633), dst_crs=CRS.from_epsg(32633), resampling=Resampling.bilinear,
    )
    return replace(terrain, elevation=values, resolution=cell)


def lethal_area(scene, device):
    simulation = Simulation(scene, accuracy=Accuracy(spacing=SPACING), device=device)
    simulation.advance(END)
    layers = load_layers(share_path('msg_configs/default.yaml'))
    (layer,) = [layer for layer in layers if layer.name == 'hazard']
    lethal = layer.grid_values(simulation.snapshot()) == 100
    return lethal.sum() * scene.terrain.resolution**2


def test_lethal_area_by_cell_is_that_of_the_page(device):
    text = PAGE.read_text(encoding='utf-8')
    match = re.search(r'([\d,]+) m2 are lethal on its cells of 30 m, and ([\d,]+) m2\s', text)
    coarse, fine = (float(item.replace(',', '')) for item in match.groups())
    assert coarse > 1.1 * fine
    scene = scene_from_yaml(share_path('examples/etna.yaml'))
    # the figures are rounded, and a cell of 30 m is 2 % of the area
    assert lethal_area(scene, device) == pytest.approx(coarse, rel=0.05)
    finer = replace(scene, terrain=resampled(scene.terrain, 5.0))
    assert lethal_area(finer, device) == pytest.approx(fine, rel=0.05)
