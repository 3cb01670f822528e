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

"""Pictures show the lava there is."""

from dataclasses import replace
from pathlib import Path
import sys

from matplotlib.image import imread
import numpy as np
import pytest

from lava_ros.errors import LavaError
from lava_ros.frames import Frame, LayerFrame
from lava_ros.layer_files import load_layers
from lava_ros.plot import duration, plot_frame
from lava_ros.share import share_path


@pytest.fixture
def frame() -> Frame:
    """A flow of 20 x 6 cells on a slope with a hole in the data."""
    elevation = np.add.outer(np.arange(60.0), np.arange(90.0)).astype(np.float32)
    elevation[:, 80] = np.nan
    layers = {}
    for layer in load_layers(share_path('msg_configs/default.yaml')):
        if layer.enabled:
            values = np.full(elevation.shape, np.nan, dtype=np.float32)
            values[30:50, 40:46] = {'thickness': 4.0, 'temperature': 800.0, 'hazard': 100.0}[
                layer.source
            ]
            layers[layer.source] = LayerFrame(layer, values, False)
    return Frame(
        elevation=elevation,
        resolution=10.0,
        origin=(0.0, 0.0),
        layers=layers,
        vents=np.array([[430.0, 480.0]]),
        time=5400.0,
        scene={'terrain': {'epsg': 32633}},
    )


def dried(frame: Frame) -> Frame:
    """The same frame without lava."""
    layers = {
        source: replace(item, values=np.full_like(item.values, np.nan))
        for source, item in frame.layers.items()
    }
    return replace(frame, layers=layers, vents=np.empty((0, 2)))


def red(path: Path, x0: float, x1: float) -> int:
    """Count the pixels as red as lethal hazard between two shares of the width."""
    pixels = imread(path)[:, :, :3]
    part = pixels[:, int(x0 * pixels.shape[1]) : int(x1 * pixels.shape[1])]
    return int(((part[..., 0] > 0.4) & (part[..., 1] < 0.12) & (part[..., 2] < 0.25)).sum())


def test_lava_is_drawn(frame: Frame, tmp_path: Path) -> None:
    """The hazard map on the right has red cells with lava and none without."""
    plot_frame(frame, tmp_path / 'wet.png')
    plot_frame(dried(frame), tmp_path / 'dry.png')
    # The map of the hazard without its colour bar.
    wet, dry = (red(tmp_path / name, 0.66, 0.93) for name in ('wet.png', 'dry.png'))
    assert wet > 1000
    assert dry == 0
    assert (tmp_path / 'wet.png').stat().st_size < 800_000


def test_layers_that_are_missing_are_left_out(frame: Frame, tmp_path: Path) -> None:
    """A frame of one layer makes a picture of one map."""
    one = replace(frame, layers={'hazard': frame.layers['hazard']}, time=None)
    plot_frame(one, tmp_path / 'one.png')
    assert red(tmp_path / 'one.png', 0.66, 1.0) == 0
    assert red(tmp_path / 'one.png', 0.0, 0.6) > 1000


def test_flat_ground(frame: Frame, tmp_path: Path) -> None:
    """A plain without any relief is drawn too."""
    flat = replace(frame, elevation=np.full_like(frame.elevation, 5.0))
    plot_frame(flat, tmp_path / 'flat.svg')
    assert '<svg' in (tmp_path / 'flat.svg').read_text(encoding='utf-8')


@pytest.mark.parametrize('name', ['missing/a.png', 'a.lava'])
def test_a_picture_that_cannot_be_written(frame: Frame, tmp_path: Path, name: str) -> None:
    """A bad path or format is one error that names it."""
    with pytest.raises(LavaError, match=f'output is .*{name}'):
        plot_frame(frame, tmp_path / name)


def test_without_matplotlib(
    frame: Frame, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The error says how to get it."""
    monkeypatch.setitem(sys.modules, 'matplotlib.figure', None)
    with pytest.raises(LavaError, match=r"pip install 'lava_ros\[plot\]'"):
        plot_frame(frame, tmp_path / 'a.png')


@pytest.mark.parametrize(
    ('seconds', 'words'),
    [
        (0.0, '0 s'),
        (119.0, '119 s'),
        (300.0, '5 min'),
        (7200.0, '2 h'),
        (20_400.0, '5 h 40 min'),
        (2.75 * 86_400.0, '2 d 18 h'),
    ],
)
def test_duration(seconds: float, words: str) -> None:
    """Times are said as people say them."""
    assert duration(seconds) == words
