# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Animations of a bag."""

import os
from pathlib import Path
import shutil
import sys

import numpy as np
from PIL import Image
import pytest

from lava_ros.errors import LavaError
from lava_ros.products.animation import animate_bag
from recording import record

# Substitutes for ffmpeg: one writes its arguments and the size of its input, the other fails.
STAND_IN = """
size = len(sys.stdin.buffer.read())
open(sys.argv[-1], 'w').write(json.dumps([sys.argv[1:], size]))
"""
FAILING = "sys.exit('Unknown encoder libx264')"


def stand_in(text: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Set the path to a folder with only a program named ffmpeg."""
    folder.mkdir()
    program = folder / 'ffmpeg'
    program.write_text(f'#!{sys.executable}\nimport json, sys\n{text}')
    program.chmod(0o755)
    monkeypatch.setenv('PATH', str(folder))


def lava_pixels(picture: Image.Image) -> int:
    """Count the pixels of the map, without the colour bar, as red as lethal hazard."""
    values = np.asarray(picture.convert('RGB')).astype(int)[:, : int(0.85 * picture.width)]
    red = (values[..., 0] > 100) & (values[..., 1] < 50) & (values[..., 2] < 70)
    return int(red.sum())


def test_gif_repeats_and_holds_the_last_frame(bag, tmp_path):
    path = tmp_path / 'flow.gif'
    count = animate_bag(bag, path, source='hazard', seconds=2.0, fps=8.0, width=400)
    assert count == 4
    with Image.open(path) as film:
        assert film.n_frames == 4
        assert film.size == (400, 320)
        assert film.info['loop'] == 0
        wet, durations = [], []
        for index in range(4):
            film.seek(index)
            wet.append(lava_pixels(film))
            durations.append(film.info['duration'])
    assert wet[0] > 100
    assert wet == sorted(wet)
    assert wet[3] > 3 * wet[0]
    # sixteen pictures of an eighth of a second, and the last for two more seconds
    assert sum(durations) == pytest.approx(2000 + 2000, abs=50)
    assert durations[-1] > 2000
    assert path.stat().st_size < 300_000
    assert [item.name for item in tmp_path.iterdir()] == ['flow.gif']


def test_mp4_passes_pictures_to_ffmpeg(bag, tmp_path, monkeypatch):
    stand_in(STAND_IN, tmp_path / 'bin', monkeypatch)
    animate_bag(bag, tmp_path / 'flow.mp4', seconds=1.0, fps=4.0, width=301)
    text = (tmp_path / 'flow.mp4').read_text()
    assert '"300x240"' in text
    assert '"yuv420p"' in text
    # four pictures, and the last for two more seconds
    assert text.endswith(f', {12 * 300 * 240 * 4}]')


def test_mp4_reports_a_failing_or_missing_ffmpeg(bag, tmp_path, monkeypatch):
    stand_in(FAILING, tmp_path / 'bin', monkeypatch)
    with pytest.raises(LavaError, match='Unknown encoder libx264'):
        animate_bag(bag, tmp_path / 'flow.mp4', seconds=1.0, fps=4.0, width=300)
    assert [item.name for item in tmp_path.iterdir()] == ['bin']
    monkeypatch.setenv('PATH', str(tmp_path))
    with pytest.raises(LavaError, match='Writing an MP4 needs ffmpeg, which is not installed'):
        animate_bag(bag, tmp_path / 'flow.mp4')


def test_mp4_of_a_real_ffmpeg_starts_with_its_index(bag, tmp_path, monkeypatch):
    if shutil.which('ffmpeg') is None:
        wheel = pytest.importorskip('imageio_ffmpeg', reason='needs ffmpeg, or .[look]')
        (tmp_path / 'bin').mkdir()
        (tmp_path / 'bin/ffmpeg').symlink_to(wheel.get_ffmpeg_exe())
        monkeypatch.setenv('PATH', f'{tmp_path / "bin"}{os.pathsep}{os.environ["PATH"]}')
    animate_bag(bag, tmp_path / 'flow.mp4', seconds=1.0, fps=4.0, width=400)
    data = (tmp_path / 'flow.mp4').read_bytes()
    assert data[4:8] == b'ftyp'
    assert 0 < data.index(b'moov') < data.index(b'mdat')


@pytest.mark.parametrize(('name', 'options', 'words'), [
    ('flow.avi', {}, 'name ends with .gif or .mp4'),
    ('flow.gif', {'source': 'depth'}, 'layer'),
    ('flow.gif', {'fps': 0.0}, 'fps'),
    ('flow.gif', {'seconds': 1e9}, 'seconds'),
    ('flow.gif', {'width': 10}, 'width'),
    ('missing/flow.gif', {'width': 200, 'seconds': 0.5}, 'output is .*missing'),
])
def test_rejects_invalid_arguments(bag, tmp_path, name, options, words):
    with pytest.raises(LavaError, match=words):
        animate_bag(bag, tmp_path / name, **options)  # type: ignore[arg-type]


def test_rejects_a_layer_that_the_bag_lacks(tmp_path):
    config = 'layers: {heat: {source: temperature, message: sensor_msgs/Image}}'
    bag = record(tmp_path / 'bag', config=config)
    with pytest.raises(LavaError, match='it has temperature'):
        animate_bag(bag, tmp_path / 'flow.gif', source='hazard')
