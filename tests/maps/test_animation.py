# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Moving pictures of a bag."""

import os
from pathlib import Path
import shutil
import sys

import numpy as np
from PIL import Image
import pytest

from lava_ros.errors import LavaError
from lava_ros.maps.animation import animate_bag
from recording import record

# Stand in for ffmpeg: the one says what it was told and how many pictures came, the other fails.
STAND_IN = """
size = len(sys.stdin.buffer.read())
open(sys.argv[-1], 'w').write(json.dumps([sys.argv[1:], size]))
"""
FAILING = "sys.exit('Unknown encoder libx264')"


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    """Frames at 200, 400, 600 and 800 s."""
    return record(tmp_path_factory.mktemp('animation') / 'bag')


def stand_in(text: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Put a program named ffmpeg on the path, and nothing else."""
    folder.mkdir()
    program = folder / 'ffmpeg'
    program.write_text(f'#!{sys.executable}\nimport json, sys\n{text}')
    program.chmod(0o755)
    monkeypatch.setenv('PATH', str(folder))


def lava_pixels(picture: Image.Image) -> int:
    """Pixels of the map, without the colour bar, as red as lethal hazard."""
    values = np.asarray(picture.convert('RGB')).astype(int)[:, : int(0.85 * picture.width)]
    red = (values[..., 0] > 100) & (values[..., 1] < 50) & (values[..., 2] < 70)
    return int(red.sum())


def test_gif(bag, tmp_path):
    """Each frame is longer than the one before; the last stays; it begins again by itself."""
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
    # Sixteen pictures of an eighth of a second, and the last for two seconds more.
    assert sum(durations) == pytest.approx(2000 + 2000, abs=50)
    assert durations[-1] > 2000
    assert path.stat().st_size < 300_000
    assert [item.name for item in tmp_path.iterdir()] == ['flow.gif']


def test_mp4_goes_to_ffmpeg(bag, tmp_path, monkeypatch):
    """Raw pictures of the right number and size, and options that play everywhere."""
    stand_in(STAND_IN, tmp_path / 'bin', monkeypatch)
    animate_bag(bag, tmp_path / 'flow.mp4', seconds=1.0, fps=4.0, width=301)
    text = (tmp_path / 'flow.mp4').read_text()
    assert '"300x240"' in text
    assert '"yuv420p"' in text
    # Four pictures, and the last for two seconds more.
    assert text.endswith(f', {12 * 300 * 240 * 3}]')


def test_without_a_good_ffmpeg(bag, tmp_path, monkeypatch):
    """Its failure is an error with its words, and leaves no file; what is missing is named."""
    stand_in(FAILING, tmp_path / 'bin', monkeypatch)
    with pytest.raises(LavaError, match='Unknown encoder libx264'):
        animate_bag(bag, tmp_path / 'flow.mp4', seconds=1.0, fps=4.0, width=300)
    assert [item.name for item in tmp_path.iterdir()] == ['bin']
    monkeypatch.setenv('PATH', str(tmp_path))
    with pytest.raises(LavaError, match='ffmpeg on the path: apt install ffmpeg; a .gif needs'):
        animate_bag(bag, tmp_path / 'flow.mp4')


def test_real_mp4(bag, tmp_path, monkeypatch):
    """With a real ffmpeg the file is an MP4 whose index is in front."""
    if shutil.which('ffmpeg') is None:
        wheel = pytest.importorskip('imageio_ffmpeg', reason='needs ffmpeg, or .[look]')
        (tmp_path / 'bin').mkdir()
        (tmp_path / 'bin/ffmpeg').symlink_to(wheel.get_ffmpeg_exe())
        monkeypatch.setenv('PATH', f'{tmp_path / "bin"}{os.pathsep}{os.environ["PATH"]}')
    animate_bag(bag, tmp_path / 'flow.mp4', seconds=1.0, fps=4.0, width=400)
    data = (tmp_path / 'flow.mp4').read_bytes()
    assert data[4:8] == b'ftyp'
    assert 0 < data.index(b'moov') < data.index(b'mdat')


@pytest.mark.parametrize(
    ('name', 'options', 'words'),
    [
        ('flow.avi', {}, 'name ends with .gif or .mp4'),
        ('flow.gif', {'source': 'depth'}, 'layer'),
        ('flow.gif', {'fps': 0.0}, 'fps'),
        ('flow.gif', {'seconds': 1e9}, 'seconds'),
        ('flow.gif', {'width': 10}, 'width'),
        ('missing/flow.gif', {'width': 200, 'seconds': 0.5}, 'output is .*missing'),
    ],
)
def test_what_cannot_be_is_refused(bag, tmp_path, name, options, words):
    """One error that names it."""
    with pytest.raises(LavaError, match=words):
        animate_bag(bag, tmp_path / name, **options)  # type: ignore[arg-type]


def test_a_layer_the_bag_lacks(tmp_path):
    """The error names those it has."""
    config = 'layers: {heat: {source: temperature, message: sensor_msgs/Image}}'
    bag = record(tmp_path / 'bag', config=config)
    with pytest.raises(LavaError, match='it has temperature'):
        animate_bag(bag, tmp_path / 'flow.gif', source='hazard')
