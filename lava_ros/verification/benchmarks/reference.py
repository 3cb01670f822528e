# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A plain implementation of the bare step, as a baseline for speed.

It is the obvious way to write it: Warp's hash grid, with cells as wide as the kernel radius, finds
the neighbours; thickness, slope and motion are separate kernels, launched one after the other;
particles keep their original order. Equations, smoothing kernel and ground are those of the
product. Only the benchmark uses it.
"""

# mypy: disable-error-code="valid-type, no-untyped-def"

import math
from typing import Any

import numpy as np
import warp as wp

from lava_ros.simulation import Simulation
from lava_ros.simulation.particles.kernels import smoothing_kernel
from lava_ros.simulation.particles.layout import centre_of, ground_type
from lava_ros.simulation.particles.terrain import StaggeredTerrain, terrain_functions


class Reference:
    """The lava of a simulation, moved by plain kernels in float32."""

    def __init__(self, simulation: Simulation, step: float) -> None:
        """Copy the particles and ground of a simulation; ``step`` is the time step [s].

        The simulation has no effects switched on.
        """
        sample, scene = simulation.sample(), simulation.scene
        self._device = wp.get_device(simulation.device)
        self._radius = simulation.radius
        self._mobility = scene.lava.density * scene.gravity / (3.0 * scene.lava.viscosity)
        self._step = step
        self._terrain = StaggeredTerrain(scene.terrain, 'float32', self._device)
        self._centre = centre_of(scene.terrain)
        places = np.zeros((len(sample.volume), 3), dtype=np.float32)
        places[:, :2] = sample.position - self._centre
        self.count = len(places)
        self._position = wp.array(places, dtype=wp.vec3, device=self._device)
        self._volume = wp.array(sample.volume, dtype=wp.float32, device=self._device)
        self._thickness = wp.zeros(self.count, dtype=wp.float32, device=self._device)
        self._slope = wp.zeros(self.count, dtype=wp.vec2, device=self._device)
        x0, y0, x1, y1 = scene.terrain.extent
        columns, rows = (math.ceil(side / self._radius) + 2 for side in (x1 - x0, y1 - y0))
        self._grid = wp.HashGrid(columns, rows, 1, device=self._device)
        accuracy = simulation.accuracy
        self._kernels = _kernels(accuracy.kernel)

    @property
    def position(self) -> np.ndarray:
        """Positions (x, y) in the map frame [m], shape [count, 2]."""
        return self._position.numpy()[:, :2].astype(np.float64) + self._centre

    def advance(self, steps: int) -> None:
        """Take some steps."""
        sums, slopes, move = self._kernels
        for _ in range(steps):
            self._grid.build(self._position, self._radius)
            near = [self._grid.id, self._position, self._volume, self._radius]
            self._launch(sums, near, [self._thickness])
            self._launch(slopes, [*near, self._terrain.ground], [self._slope])
            flow = [self._thickness, self._slope, self._mobility, self._step]
            self._launch(move, flow, [self._position])

    def _launch(self, kernel: Any, inputs: list[Any], outputs: list[Any]) -> None:
        wp.launch(kernel, self.count, inputs, outputs, device=self._device)


def _kernels(name: str) -> tuple[Any, Any, Any]:
    kernel = smoothing_kernel(name, wp.float32)
    norm, shape, slope, excess = kernel.norm, kernel.shape, kernel.slope, kernel.excess
    gradient_at = terrain_functions(wp.float32).gradient_at

    def sum_thickness(
        grid: wp.uint64, position: wp.array(dtype=wp.vec3), volume: wp.array(dtype=float),
        radius: float, thickness: wp.array(dtype=float),
    ):
        i = wp.tid()
        here = position[i]
        height = wp.float32(0.0)
        for j in wp.hash_grid_query(grid, here, radius):
            q = wp.length(here - position[j]) / radius
            if q < 1.0:
                height += volume[j] * shape(q)
        height *= norm / (radius * radius)
        thickness[i] = height * (1.0 - excess(volume[i] / (radius * radius * height)))

    def sum_slope(
        grid: wp.uint64, position: wp.array(dtype=wp.vec3), volume: wp.array(dtype=float),
        radius: float, ground: ground_type(wp.float32), surface: wp.array(dtype=wp.vec2),
    ):
        i = wp.tid()
        here = position[i]
        rise = wp.vec2()
        for j in wp.hash_grid_query(grid, here, radius):
            way = here - position[j]
            q = wp.length(way) / radius
            if q < 1.0:
                rise += volume[j] * slope(q) * wp.vec2(way[0], way[1])
        rise *= norm / (radius * radius * radius * radius)
        surface[i] = rise + gradient_at(ground, here[0], here[1])

    def move(
        thickness: wp.array(dtype=float), surface: wp.array(dtype=wp.vec2), mobility: float,
        step: float, position: wp.array(dtype=wp.vec3),
    ):
        i = wp.tid()
        velocity = -mobility * thickness[i] * thickness[i] * surface[i]
        position[i] += step * wp.vec3(velocity[0], velocity[1], 0.0)

    kernels = (sum_thickness, sum_slope, move)
    sums, slopes, motion = (
        wp.kernel(function, module='unique', enable_backward=False) for function in kernels
    )
    return sums, slopes, motion
