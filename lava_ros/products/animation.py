# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Animation of the frames of a bag: a GIF, or an MP4 if ffmpeg is installed."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import chain
from pathlib import Path
import shutil
import subprocess
from typing import Any

import numpy as np

from lava_ros import validation
from lava_ros.errors import LavaError, RefusalError
from lava_ros.files import file_to_write, writing
from lava_ros.files.pictures import new_figure
from lava_ros.layers.frame import Frame, LayerFrame
from lava_ros.layers.layer import SOURCES
from lava_ros.layers.numbers import duration
from lava_ros.layers.recording import Progress, Recording, silent
from lava_ros.products import plot
from lava_ros.products.colours import picture_of, scale_of, STYLES

#: Maximum number of pictures; a GIF keeps all of them in memory until it is written.
MAX_FRAMES = 300

#: Additional display time of the last picture [s].
HOLD_TIME = 2.0

FORMATS = ('.gif', '.mp4')

_MAP = (0.075, 0.07, 0.79, 0.835)
_BAR = (0.875, 0.07, 0.02, 0.835)


def animate_bag(
    path: str | Path,
    output: str | Path,
    *,
    node: str | None = None,
    source: str = 'thickness',
    seconds: float = 10.0,
    fps: float = 12.0,
    width: int = 800,
    progress: Progress = silent,
) -> int:
    """Draw frames of a bag, evenly spread over its simulated time, over shaded relief.

    Args:
        path: The bag.
        output: The .gif or .mp4.
        node: Full name or namespace of the node whose maps to draw; None for the only one.
        source: Layer to draw: ``thickness``, ``temperature`` or ``hazard``.
        seconds: Duration of the animation [s] without the hold time of the last picture.
        fps: Pictures per second [1/s].
        width: Width of the pictures [pixels].
        progress: Called with the activity and its completed fraction.

    Returns:
        Number of distinct pictures.

    Raises:
        LavaError: If the bag cannot be read, an argument is not valid, or a program or library
            that writes the format is missing.
    """
    output = file_to_write('output', output, FORMATS)
    validation.choice('layer', source, SOURCES)
    validation.number('fps', fps, at_least=1.0, at_most=60.0)
    most = MAX_FRAMES / fps
    seconds = validation.number('seconds', seconds, at_least=0.5, at_most=most, unit='s')
    width = int(validation.number('width', width, at_least=200, at_most=3840, unit='pixels'))
    is_gif = output.suffix.lower() == '.gif'
    if not is_gif and shutil.which('ffmpeg') is None:
        problem = 'Writing an MP4 needs ffmpeg, which is not installed'
        raise RefusalError('format', problem, 'Install ffmpeg, or write a .gif')
    recording = Recording(path, node=node)
    last, start = _peak_frame(recording, source)
    moments = np.linspace(start, last.time or 0.0, max(2, round(seconds * fps)))
    # video codecs require even sides
    pixels = (2 * (width // 2), 2 * round(0.8 * width / 2))
    dpi = width / 7.6
    with new_figure('animate', source, (pixels[0] / dpi, pixels[1] / dpi), dpi) as figure:
        canvas = _Canvas(figure, last, source)
        pictures = _pictures(recording, canvas, moments, progress)
        peak = canvas.draw(last)
        with writing('output', output) as partial:
            if is_gif:
                return _write_gif(pictures, partial, fps, peak)
            return _write_mp4(pictures, partial, fps)


def _peak_frame(recording: Recording, source: str) -> tuple[Frame, float]:
    """Return the last frame with the maximum value of each cell, and the first time [s]."""
    last: Frame | None = None
    start = 0.0
    for frame in recording.frames():
        shown = frame.layers.get(source)
        if shown is None or frame.time is None:
            continue
        before = shown if last is None else last.layers[source]
        if last is None or before.values.shape != shown.values.shape:
            before, start = replace(before, values=shown.values), frame.time
        is_saturated = shown.is_saturated or before.is_saturated
        peak = LayerFrame(shown.layer, np.fmax(before.values, shown.values), is_saturated)
        last = replace(frame, layers={source: peak})
    if last is None:
        names = ', '.join(sorted({layer.source for layer in recording.layers.values()}))
        expected = f'a layer of the bag with simulated times; it has {names}'
        raise LavaError('layer', source, expected)
    return last, start


class _Canvas:
    """The figure, in which only the map and the title change between frames."""

    def __init__(self, figure: Any, frame: Frame, source: str) -> None:
        self._source, self._canvas = source, figure.canvas
        item = frame.layers[source]
        self._scale = scale_of(source, item.values, is_saturated=item.is_saturated)
        axes = figure.add_axes(_MAP)
        aspect = _MAP[2] * figure.get_figwidth() / (_MAP[3] * figure.get_figheight())
        bounds = plot.bounds_of(frame, np.isfinite(item.values))
        least = plot.LEAST_CELLS * frame.resolution
        window = plot.window_of(bounds, frame.extent, aspect, least)
        self._part, extent = _part(frame, window)
        # float32 halves the memory
        self._ground = plot.shaded_ground(frame)[self._part].astype(np.float32)
        self._image, self._vents = plot.draw_map(axes, frame, self._ground, window, extent=extent)
        plot.draw_contours(axes, frame, window, plot.contour_interval(frame, window))
        plot.draw_ticks(axes)
        plot.draw_scale_bar(axes, window)
        plot.draw_north(axes)
        plot.draw_colour_bar(figure, figure.add_axes(_BAR), self._scale)
        self._title = figure.text(_MAP[0], 0.955, '', fontsize=13, weight='bold', va='center')
        self._shape = frame.elevation.shape

    def shows(self, frame: Frame) -> bool:
        """Return True if a frame has the layer on a terrain of the same shape."""
        shown = frame.layers.get(self._source)
        return shown is not None and shown.values.shape == self._shape

    def draw(self, frame: Frame) -> np.ndarray:
        """Draw a frame and return RGB pixels, uint8, shape [height, width, 3]."""
        values = frame.layers[self._source].values[self._part]
        picture = picture_of(values, self._ground, self._scale)
        self._image.set_data((255.0 * picture).astype(np.uint8))
        self._vents.set_data(frame.vents[:, 0], frame.vents[:, 1])
        title = STYLES[self._source].title
        self._title.set_text(f'{title} after {duration(frame.time or 0.0)}')
        self._canvas.draw()
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()


def _part(
    frame: Frame, window: tuple[float, float, float, float]
) -> tuple[tuple[slice, slice], tuple[float, float, float, float]]:
    """Return the cells in a window, and their edges: left, right, bottom, top [m]."""
    start, cell = np.array(frame.origin), frame.resolution
    first = np.maximum(0, np.floor((window[:2] - start) / cell)).astype(int)
    last = np.ceil((window[2:] - start) / cell).astype(int)
    last = np.minimum(frame.elevation.shape[::-1], last)
    (left, bottom), (right, top) = start + first * cell, start + last * cell
    return np.s_[first[1] : last[1], first[0] : last[0]], (left, right, bottom, top)


def _pictures(
    recording: Recording, canvas: _Canvas, moments: np.ndarray, progress: Progress
) -> Iterator[tuple[np.ndarray, int]]:
    """Yield each distinct picture and the number of moments at which it is the newest."""
    newest: Frame | None = None
    done = 0
    shown = (item for item in recording.frames() if item.time is not None and canvas.shows(item))
    for frame in chain(shown, [None]):
        end = len(moments) if frame is None else int(np.searchsorted(moments, frame.time or 0.0))
        if newest is not None and end > done:
            yield canvas.draw(newest), end - done
            done = end
            progress('drawing', done / len(moments))
        newest = frame


def _write_gif(
    pictures: Iterator[tuple[np.ndarray, int]], path: Path, fps: float, colours: np.ndarray
) -> int:
    from PIL import Image

    # With one palette for all pictures, unchanged pixels take no space: matplotlib's writer makes
    # files four times as large. MAXCOVERAGE keeps the colours of lava, which only few pixels have.
    palette = Image.fromarray(colours).quantize(256, Image.Quantize.MAXCOVERAGE)
    images: list[Any] = []
    durations: list[int] = []
    for picture, count in pictures:
        image = Image.fromarray(picture)
        images.append(image.quantize(palette=palette, dither=Image.Dither.NONE))
        durations.append(count * round(1000.0 / fps))
    durations[-1] += round(1000.0 * HOLD_TIME)
    first, *others = images
    first.save(path, 'GIF', save_all=True, append_images=others, duration=durations, loop=0)
    return len(images)


def _write_mp4(pictures: Iterator[tuple[np.ndarray, int]], path: Path, fps: float) -> int:
    from matplotlib.animation import FFMpegWriter

    # all players support yuv420p; faststart allows playback while the file loads
    options = ['-crf', '20', '-pix_fmt', 'yuv420p', '-movflags', '+faststart']
    rate: Any = fps  # declared as int, but floats work
    writer = FFMpegWriter(rate, codec='libx264', extra_args=options)
    first, count = next(pictures)
    drawn = 0
    height, width = first.shape[:2]
    dpi = 100.0
    # shows the drawn pixels: redrawing a map for each repetition would be slow
    with new_figure('animate', path, (width / dpi, height / dpi), dpi) as figure:
        shown = figure.figimage(first)
        try:
            with writer.saving(figure, str(path), dpi):
                for picture, repeats in chain([(first, count)], pictures):
                    drawn += 1
                    shown.set_data(picture)
                    for _ in range(repeats):
                        writer.grab_frame()
                for _ in range(round(HOLD_TIME * fps)):
                    writer.grab_frame()
        except subprocess.CalledProcessError as error:
            problem = f'ffmpeg cannot write {path}: {error.stderr.strip()[-300:]}'
            raise RefusalError('output', problem, 'Write a .gif') from error
    return drawn
