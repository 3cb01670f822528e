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

"""Errors of a terrain: random fields that have the deviation and the correlation asked for."""

from dataclasses import replace

import numpy as np

from lava_ros.errors import LavaError
from lava_ros.scene import Terrain
from lava_ros.uncertainty import Roughness

#: Correlations the field goes on for beyond the terrain, so that opposite borders differ.
_BEYOND = 3.0

#: Steps of the field [1/m]: what is left of rounding by the Fourier transform is rounded away.
_STEPS = 1024.0


def rough_terrain(terrain: Terrain, roughness: Roughness, seed: tuple[int, ...]) -> Terrain:
    """Add a random field to a terrain; cells without data stay so.

    Args:
        terrain: The ground.
        roughness: Deviation and correlation of its errors.
        seed: Numbers that the field is drawn from.
    """
    field = random_field(terrain.shape, terrain.resolution, roughness, seed)
    return replace(terrain, elevation=terrain.elevation + field)


def random_field(
    shape: tuple[int, int], resolution: float, roughness: Roughness, seed: tuple[int, ...]
) -> np.ndarray:
    """Draw a Gaussian field with covariance s^2 exp(-(r / L)^2).

    White noise is convolved with a Gaussian of deviation L / 2, whose own convolution is the
    correlation.

    Args:
        shape: Rows and columns.
        resolution: Side of a cell [m].
        roughness: s, the deviation, and L, the correlation [m].
        seed: Numbers that the field is drawn from.

    Returns:
        The field [m], float32, shape [rows, columns].

    Raises:
        LavaError: scipy is not installed.
    """
    try:
        from scipy.special import ndtri
    except ImportError as error:
        raise LavaError(
            'uncertainty.terrain', roughness, "scipy: pip install 'lava_ros[ensemble]'"
        ) from error
    beyond = int(np.ceil(_BEYOND * roughness.correlation / resolution))
    # a field that hardly changes over the terrain need not go on for longer than it
    rows, columns = (side + min(beyond, 4 * max(shape)) for side in shape)
    # the generator's raw bits stay the same from version to version, its normal numbers may not
    bits = np.random.PCG64(np.random.SeedSequence(seed)).random_raw(rows * columns)
    noise = ndtri(((bits >> np.uint64(11)) + 0.5) * 2.0**-53).reshape(rows, columns)
    waves_y = np.fft.fftfreq(rows, resolution)[:, None]
    waves_x = np.fft.rfftfreq(columns, resolution)
    width = 0.5 * roughness.correlation
    gain = np.exp(-2.0 * (np.pi * width) ** 2 * (waves_y**2 + waves_x**2))
    kernel = np.fft.irfft2(gain, (rows, columns))
    scale = roughness.deviation / np.sqrt((kernel**2).sum())
    field = scale * np.fft.irfft2(gain * np.fft.rfft2(noise), (rows, columns))
    field = np.rint(field[: shape[0], : shape[1]] * _STEPS) / _STEPS
    return field.astype(np.float32)
