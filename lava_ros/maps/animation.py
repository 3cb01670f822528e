# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The frames of a bag as a moving picture: GIF, or MP4 where there is ffmpeg."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import chain
from pathlib import Path
import shutil
import subprocess
import tempfile
from typing import Any

import numpy as np

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.files import file_to_write, writing
from lava_ros.files.pictures import new_figure
from lava_ros.maps import plot
from lava_ros.maps.frames import Frame, LayerFrame, Progress, Recording, silent
from lava_ros.maps.layers import SOURCES

#: Most pictures that are made: those of a GIF are in memory until it is written.
MOST_FRAMES = 300

#: How long the last picture stays [s].
STAY = 2.0

FORMATS = ('.gif', '.mp4')

_MAP = (0.075, 0.07, 0.79, 0.835)
_BAR = (0.875, 0.07, 0.02, 0.835)


def animate_bag(
    path: str | Path,
    output: str | Path,
    *,
    source: str = 'thickness',
    seconds: float = 10.0,
    fps: float = 12.0,
    width: int = 800,
    progress: Progress = silent,
) -> int:
    """Draw frames of a bag over shaded relief as .gif or .mp4; returns how many differ.

    They are evenly spread over its simulated time. The source is ``thickness``, ``temperature`` or
    ``hazard``; ``seconds`` is how long the animation lasts [s], whose last picture stays for two
    more; ``width`` that of the pictures [pixels]. LavaError where the bag cannot be read, an
    argument is not usable, or a program or library that writes the format is missing.
    """
    output = file_to_write('output', output, FORMATS)
    validation.choice('layer', source, SOURCES)
    validation.number('fps', fps, at_least=1.0, at_most=60.0)
    most = MOST_FRAMES / fps
    seconds = validation.number('seconds', seconds, at_least=0.5, at_most=most, unit='s')
    width = int(validation.number('width', width, at_least=200, at_most=3840, unit='pixels'))
    encoder = None if output.suffix.lower() == '.gif' else ffmpeg()
    recording = Recording(path)
    last, start = _survey(recording, source)
    moments = np.linspace(start, last.time or 0.0, max(2, round(seconds * fps)))
    # Video codecs want even sides.
    pixels = (2 * (width // 2), 2 * round(0.8 * width / 2))
    dpi = width / 7.6
    with new_figure('animate', source, (pixels[0] / dpi, pixels[1] / dpi), dpi) as figure:
        canvas = _Canvas(figure, last, source)
        pictures = _pictures(recording, canvas, moments, progress)
        peak = canvas.draw(last)
        with writing('output', output) as partial:
            if encoder is None:
                return _write_gif(pictures, partial, fps, peak)
            return _write_mp4(pictures, partial, fps, encoder, peak.shape)


def ffmpeg() -> str:
    """Path of the ffmpeg program, which writes MP4; LavaError where it is not installed."""
    found = shutil.which('ffmpeg')
    if found is None:
        right = 'ffmpeg on the path: apt install ffmpeg; a .gif needs none'
        raise LavaError('format', '.mp4', right)
    return found


def _survey(recording: Recording, source: str) -> tuple[Frame, float]:
    """The last frame, with the largest value that each cell ever had, and the first time [s]."""
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
        right = f'a layer the bag has with its simulated times; it has {names}'
        raise LavaError('layer', source, right)
    return last, start


class _Canvas:
    """The drawing, of which only the map and the title change."""

    def __init__(self, figure: Any, frame: Frame, source: str) -> None:
        self._source, self._canvas = source, figure.canvas
        item = frame.layers[source]
        self._scale = plot.scale_of(source, item.values, is_saturated=item.is_saturated)
        axes = figure.add_axes(_MAP)
        aspect = _MAP[2] * figure.get_figwidth() / (_MAP[3] * figure.get_figheight())
        bounds = plot.bounds_of(frame, np.isfinite(item.values))
        least = plot.LEAST_CELLS * frame.resolution
        window = plot.window_of(bounds, plot.extent_of(frame), aspect, least)
        self._part, extent = _part(frame, window)
        # Half the memory of what it comes as.
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
        """Whether a frame has the layer, on the terrain that is drawn."""
        shown = frame.layers.get(self._source)
        return shown is not None and shown.values.shape == self._shape

    def draw(self, frame: Frame) -> np.ndarray:
        """Draw a frame with a time: RGB, uint8, shape [height, width, 3]."""
        values = frame.layers[self._source].values[self._part]
        picture = plot.picture_of(values, self._ground, self._scale)
        self._image.set_data((255.0 * picture).astype(np.uint8))
        self._vents.set_data(frame.vents[:, 0], frame.vents[:, 1])
        title = plot.STYLES[self._source].title
        self._title.set_text(f'{title} after {plot.duration(frame.time or 0.0)}')
        self._canvas.draw()
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()


def _part(
    frame: Frame, window: tuple[float, float, float, float]
) -> tuple[tuple[slice, slice], tuple[float, float, float, float]]:
    """The cells that are in a window, and their edges: left, right, bottom, top [m]."""
    start, cell = np.array(frame.origin), frame.resolution
    first = np.maximum(0, np.floor((window[:2] - start) / cell)).astype(int)
    last = np.ceil((window[2:] - start) / cell).astype(int)
    last = np.minimum(frame.elevation.shape[::-1], last)
    (left, bottom), (right, top) = start + first * cell, start + last * cell
    return np.s_[first[1] : last[1], first[0] : last[0]], (left, right, bottom, top)


def _pictures(
    recording: Recording, canvas: _Canvas, moments: np.ndarray, progress: Progress
) -> Iterator[tuple[np.ndarray, int]]:
    """Each frame that is the newest at some of the moments, drawn, and at how many it is."""
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

    # One palette for all: what does not change from picture to picture then takes no space.
    # Few pixels have the colours of the lava: their count must not decide.
    palette = Image.fromarray(colours).quantize(256, Image.Quantize.MAXCOVERAGE)
    images: list[Any] = []
    durations: list[int] = []
    for picture, count in pictures:
        image = Image.fromarray(picture)
        images.append(image.quantize(palette=palette, dither=Image.Dither.NONE))
        durations.append(count * round(1000.0 / fps))
    durations[-1] += round(1000.0 * STAY)
    first, *others = images
    first.save(path, 'GIF', save_all=True, append_images=others, duration=durations, loop=0)
    return len(images)


def _write_mp4(
    pictures: Iterator[tuple[np.ndarray, int]],
    path: Path,
    fps: float,
    encoder: str,
    shape: tuple[int, ...],
) -> int:
    height, width = shape[:2]
    command = [encoder, '-y', '-loglevel', 'error', '-f', 'rawvideo', '-pix_fmt', 'rgb24']
    command += ['-s', f'{width}x{height}', '-r', f'{fps:g}', '-i', '-', '-an']
    # yuv420p plays everywhere; the index goes to the front, so that it plays while it loads.
    command += ['-c:v', 'libx264', '-crf', '20', '-pix_fmt', 'yuv420p', '-movflags', '+faststart']
    with tempfile.TemporaryFile() as errors:
        process = subprocess.Popen(
            [*command, str(path)], stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=errors
        )
        assert process.stdin is not None
        drawn = 0
        try:
            for picture, count in pictures:
                drawn += 1
                for _ in range(count):
                    process.stdin.write(picture.tobytes())
            for _ in range(round(STAY * fps)):
                process.stdin.write(picture.tobytes())
        except BrokenPipeError:
            # It has ended: its status says so, and its words why.
            process.stdin = None
        finally:
            process.communicate()
        errors.seek(0)
        said = errors.read().decode(errors='replace').strip()
    if process.returncode != 0:
        raise LavaError('output', str(path), f'an MP4 that ffmpeg can write ({said[-300:]})')
    return drawn
