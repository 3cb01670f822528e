# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The page of one browser: ground and lava in 3-D, a time slider, and texts."""

from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import partial
from html import escape
from itertools import pairwise
import math
from typing import Any

from matplotlib.colors import ListedColormap, to_rgb
import numpy as np
from PIL import Image
from viser import ClientHandle

from lava_ros.errors import LavaError
from lava_ros.layers.frame import Frame
from lava_ros.layers.layer import ARRIVAL, ARRIVED, EXPECTED
from lava_ros.layers.numbers import duration
from lava_ros.products.colours import round_up, Scale, scale_of, STYLES, time_unit
from lava_ros.products.export import georeference_of
from lava_ros.products.page_layout import BANNER
from lava_ros.products.plot import BARRIER, barriers_of, shaded_ground, titles
from lava_ros.products.run_page import ENSEMBLE_MAPS
from lava_ros.scene.on_terrain import PlacedPicture
from lava_ros.scene.projection import DEGREES, transformed
from lava_ros.simulation.carriers import COUNTED
from lava_ros.watch.frames import COMMANDS, Frames, Level, Status, WatchedParticles
from lava_ros.watch.surface import Ground, SIDE
from lava_ros.watch.tone import tones

#: Title and style of each map, in the order of the list.
SHOWN = {
    **{name: (STYLES[name].title, name) for name in ('thickness', 'hazard', 'temperature')},
    ARRIVED: ('Arrival', 'arrival'),
    ARRIVAL: ('Arrival forecast', 'arrival'),
    **{source: (title, style) for source, style, title in ENSEMBLE_MAPS.values()},
}

#: Number of colours of a map that does not consist of classes.
COLOURS = 24

#: Maximum number of particles and of labels, and of pixels along a side of the ground's picture.
MAX_PARTICLES, MAX_LABELS, MAX_PIXELS = 100_000, 200, 1600

#: Height of a map above the ground in the view, so that the ground does not show through.
LIFT = np.array([0.0, 0.0, 0.0005 * SIDE], dtype=np.float32)

#: Warning at the top of the page.
_WARNING = f'<span style="background: #f5c542; color: #222; padding: 1px 8px">{BANNER}</span>'

#: Directions from the middle of the lava to the camera.
_VIEWS = {'From above': (0.0, -0.001, 1.0), 'From the south': (0.0, -0.8, 0.6)}


def ground_picture(frame: Frame, drape: PlacedPicture | None = None) -> np.ndarray:
    """Return the shaded relief of a frame with a picture over it, uint8, shape [y, x, 3].

    Raises:
        LavaError: If the picture cannot be put on the terrain.
    """
    step = -(-max(frame.elevation.shape) // MAX_PIXELS)
    part = frame.elevation[::step, ::step]
    coarse = replace(frame, elevation=part, resolution=step * frame.resolution)
    relief = (255.0 * shaded_ground(coarse)[..., :3]).astype(np.uint8)
    if drape is None:
        return relief
    # a picture may cover more than the cells of the terrain
    fine = MAX_PIXELS // max(part.shape)
    shape, size = np.multiply(part.shape, fine), coarse.resolution / fine
    ground = np.asarray(Image.fromarray(relief).resize(shape[::-1]))
    target = replace(coarse.terrain, elevation=np.zeros(shape), resolution=size)
    colours = drape.on(target, field='--drape')
    return np.where(np.isfinite(colours), np.rint(colours), ground).astype(np.uint8)


class Page:
    """The page of one browser, with its own slider and choice of map.

    All methods are called from one thread, for which clicks wait in a queue.
    """

    def __init__(
        self, client: ClientHandle, frames: Frames, ground_of: Callable[[Frame], Ground], *,
        control: bool = False,
    ) -> None:
        """Add the elements of the page; with ``control``, it can send commands to the node."""
        self._client, self._frames, self._ground_of = client, frames, ground_of
        self._version, self._ticks, self._time, self._last = -1, 0, math.nan, 0
        self._problem: Status | None = None
        self._asked: deque[Callable[[], Any]] = deque(maxlen=8)
        self._drawn: tuple[Any, ...] = ()
        self._labelled: tuple[Any, ...] = ()
        self._ground: Ground | None = None
        self._mesh: Any = None
        self._lava: dict[Any, Any] = {}
        self._place: np.ndarray | None = None
        gui = client.gui
        gui.configure_theme(
            dark_mode=True, show_logo=False, show_share_button=False, control_width='large'
        )
        gui.set_panel_label('lava watch')
        self.title, self.status = gui.add_html(''), gui.add_html('')
        self.choice = gui.add_dropdown('Map', ('-',))
        self.legend = gui.add_html('')
        # times in a unit that suits the run
        self.slider = gui.add_slider('Time', 0.0, 1.0, 0.01, 0.0, disabled=True)
        self._index, self._put, self._unit = 0, 0.0, 1.0
        self.play = gui.add_checkbox('Play', False)
        self.stretch = gui.add_slider('Vertical scale', 1.0, 5.0, 0.25, 1.0)
        self.particles = gui.add_checkbox('Particles', False)
        for name in _VIEWS:
            self._add_button(name, self._look, name)
        self.values = gui.add_html(_box('Click on the ground to read its values.'))
        self.opens: Any = None
        if control:
            with gui.add_folder('Control'):
                self.opens = gui.add_checkbox('Click opens a vent', True)
                for name in COMMANDS:
                    self._add_button(name.capitalize(), frames.command, name)
        with gui.add_folder('Diagnostics', expand_by_default=False):
            self.facts = gui.add_html('')
        client.scene.on_click()(lambda event: self._asked.append(partial(self._click, event)))

    def _add_button(self, text: str, act: Callable[..., Any], *args: Any) -> None:
        button = self._client.gui.add_button(text)
        button.on_click(lambda _: self._asked.append(partial(act, *args)))

    def update(self) -> None:
        """Process clicks, and show new frames and changed choices."""
        while self._asked:
            self._asked.popleft()()
        if self._frames.times:
            index = self._move()
            inputs = (self.choice, self.stretch, self.particles)
            wanted = (self._version, index, *(item.value for item in inputs))
            if wanted != self._drawn:
                self._drawn, self._problem = wanted, None
                try:
                    with self._client.atomic():
                        self._show(index)
                except LavaError as error:
                    self._problem = Status(Level.ERROR, str(error))
            self.facts.content = _table(self._frames.facts(index))
        level, words = self._problem or self._frames.status
        words = '<br>'.join(map(escape, filter(None, (words, self._frames.answer))))
        self.status.content = _box(words, f'color: {level.value}')

    def _move(self) -> int:
        """Move the slider with new frames if it is at its end, or while it plays."""
        slider, times = self.slider, [time or 0.0 for time in self._frames.times]
        last, index = len(times) - 1, self._index
        if self._version != self._frames.version:
            # disabled while there is only one frame
            is_at_end = slider.disabled or index >= self._last
            self._version, self._last = self._frames.version, last
            name, self._unit = time_unit(times[-1])
            slider.label = f'{"Time" if self._frames.is_simulated else "Recorded"} [{name}]'
            low, high = times[0] / self._unit, times[-1] / self._unit
            slider.min, slider.disabled = low, last == 0
            slider.max = high if high > low else low + 1.0
            slider.step = round_up((slider.max - low) / 1000.0, (1.0, 2.0, 5.0, 10.0))
            index = last if is_at_end else int(np.searchsorted(times, self._time))
        elif slider.value != self._put:
            # half a step allows for the rounding of the slider
            wanted = (slider.value + 0.5 * slider.step) * self._unit
            index = max(int(np.searchsorted(times, wanted, side='right')) - 1, 0)
            self._put = slider.value
        elif self.play.value:
            self._ticks += 1
            index += self._ticks % 2
        index = min(index, last)
        if index != self._index or not math.isclose(times[index], self._time):
            slider.value = self._put = times[index] / self._unit
        self._index, self._time = index, times[index]
        return index

    def _show(self, index: int) -> None:
        frame = self._frames.frame(index)
        particles = self._frames.particles(index) if self.particles.value else None
        counted = COUNTED[self._frames.method]
        self.particles.label = counted.capitalize()
        maps = {name: item.values for name, item in frame.layers.items()}
        if frame.arrived is not None:
            maps[ARRIVED] = frame.arrived
        names = {SHOWN[source][0]: source for source in SHOWN if source in maps} or {'-': ''}
        if self.choice.options != (*names,):
            self.choice.options = names
        source = names.get(self.choice.value, '')
        is_shown = np.isfinite(maps[source]) if source else np.False_
        mesh, ground = self._mesh, self._ground_of(frame)
        self._ground = ground
        ground.fit(frame, frame.lava | is_shown)
        if mesh is None or mesh.glb_data is not ground.mesh:
            self._mesh = self._client.scene.add_glb('/ground', ground.mesh, scale=self._scale)
        if mesh is None:
            self._look('From the south')
        elif mesh.scale != self._scale:
            # the camera rises with the ground
            rise = np.subtract(self._scale, mesh.scale) * ground.middle
            self._client.camera.position = self._client.camera.position + rise
            self._mesh.scale = self._scale
        title, facts = map(escape, self._frames.heading or titles(frame))
        so_far = self._so_far(index)
        if source and not is_shown.any():
            # a withdrawn forecast is a map without known cells
            facts += ' · <b>this map is empty at this time</b>'
        self.title.content = _box(
            f'{_WARNING}<br><b>{title}{so_far}</b><br>{facts}', 'font-size: 15px'
        )
        before, self._lava = self._lava, {}
        if particles is not None:
            self._draw_particles(ground, frame, particles, counted)
        elif source:
            near = {name: values[ground.part] for name, values in maps.items()}
            self._draw_lava(ground, near, source, before)
        for name in before.keys() - self._lava.keys():
            before[name].remove()
        self._draw_labels(ground, frame)
        if self._place is not None:
            self.values.content = _table(_values(ground, maps, self._place, frame.scene))

    def _so_far(self, index: int) -> str:
        """Return the time of the newest frame, and the date of the present one, as a text."""
        time, last, onset = self._frames.times[index], self._frames.times[-1], self._frames.onset
        if last is None:
            return ''
        if not self._frames.is_simulated:
            return f' after {duration(time or 0.0)} of {duration(last)} of the recording'
        date = ''
        if onset is not None and time is not None:
            # the date would be out of range
            with suppress(LavaError):
                date = f', {onset.words(time)}'
        return f' of {duration(last)} so far{date}'

    def _draw_lava(
        self, ground: Ground, maps: Mapping[str, np.ndarray], source: str, before: dict[Any, Any]
    ) -> None:
        """Draw a mesh of each colour, if possible one of ``before``, which takes less time."""
        (title, style), values = SHOWN[source], maps[source]
        scale = scale_of(style, values)
        shades = scale.colours.resampled(min(scale.colours.N, COLOURS))
        palette = tones(shades(np.arange(shades.N), bytes=True)[:, :3])
        self.legend.content = _legend(title, scale, palette.shown)
        deep = maps.get('thickness', maps.get(EXPECTED, np.full_like(values, np.nan)))
        depth = ground.blocks(deep)
        blocks = depth if deep is values else ground.blocks(values)
        known = scale.norm(np.ma.masked_invalid(blocks / scale.unit))
        colours = ListedColormap(palette.sent / 255.0)(known, bytes=True)
        for colour, points, faces in ground.lava(colours, depth):
            mesh = self._lava[colour] = before.get(colour) or self._client.scene.add_mesh_simple(
                '/lava/{}_{}_{}'.format(*colour), points, faces, color=colour[:3], side='double'
            )
            mesh.vertices, mesh.faces, mesh.scale = points + LIFT, faces, self._scale

    def _draw_particles(
        self, ground: Ground, frame: Frame, particles: WatchedParticles, counted: str
    ) -> None:
        points, time = particles
        if not len(points):
            self.legend.content = _box(f'No {counted} to show at this time.')
            return
        points = points[:: -(-len(points) // MAX_PARTICLES)]
        xy, celsius = points[:, :2], points[:, 2]
        scale = scale_of('temperature', celsius)
        # a bag has fewer checkpoints than maps
        title = counted.capitalize() + ('' if time is None else f' at {duration(time)}')
        shades = scale.colours(np.linspace(0.0, 1.0, COLOURS), bytes=True)[:, :3]
        self.legend.content = _legend(title, scale, shades)
        z = ground.terrain.elevations_at(xy)
        if 'thickness' in frame.layers:
            thickness = frame.layers['thickness'].values
            z += np.nan_to_num(ground.terrain.values_at(thickness, xy))
        self._lava['particles'] = self._client.scene.add_point_cloud(
            '/lava/particles', ground.placed(xy, z) + LIFT,
            scale.colours(scale.norm(celsius), bytes=True)[:, :3], point_size=0.7 * ground.cell,
            point_shape='circle', precision='float32', scale=self._scale,
        )

    def _draw_labels(self, ground: Ground, frame: Frame) -> None:
        labels = [*_vents(frame), *self._frames.places.items()][:MAX_LABELS]
        labels += [] if self._place is None else [('●', self._place.tolist())]
        labels = [(text, place) for text, place in labels if ground.terrain.covers(*place)]
        ends = [pair for crest in barriers_of(frame) for pair in pairwise(crest.tolist())]
        # a label that is created again blinks
        wanted = (ground, labels, ends, self._scale)
        if wanted == self._labelled:
            return
        self._labelled, scene = wanted, self._client.scene
        scene.remove_by_name('/labels')
        for number, (text, place) in enumerate(labels):
            at = ground.placed(np.array([place]))[0] * self._scale
            scene.add_label(f'/labels/{number}', text, position=at, anchor='bottom-center')
        for name, (path, text) in ground.scale_and_north().items():
            lines = np.repeat(path, 2, axis=0)[1:-1]
            self._draw_lines(f'/labels/{name}', ground, lines, '#ffffff')
            at = ground.placed(path[-1:])[0] * self._scale
            scene.add_label(f'/labels/{name} text', text, position=at, anchor='bottom-center')
        if ends:
            crests = np.reshape(ends, (-1, 2))
            self._draw_lines('/labels/barriers', ground, crests, BARRIER['color'])

    def _draw_lines(self, name: str, ground: Ground, ends: np.ndarray, colour: str) -> None:
        """Draw segments between pairs of map positions [m], shape [2 segments, 2]."""
        at = (ground.placed(ends) + 2.0 * LIFT).reshape(-1, 2, 3)
        self._client.scene.add_line_segments(
            name, at, scale=self._scale, colors=to_rgb(colour), thickness=3.0,
            thickness_units='screen',
        )

    def _click(self, event: Any) -> None:
        ray = np.array([event.ray_origin, event.ray_direction]) / self._scale
        place = None if self._ground is None else self._ground.hit(*ray)
        if place is not None:
            self._place, self._drawn = place, ()
            if self.opens is not None and self.opens.value:
                self._frames.open_vent(*place.tolist())

    def _look(self, view: str) -> None:
        """Show the ground around the lava from one of ``_VIEWS``."""
        if self._ground is not None:
            middle, size = self._ground.middle * self._scale, self._ground.extent
            self._client.camera.position = middle + 0.8 * size * np.array(_VIEWS[view])
            self._client.camera.look_at = middle

    @property
    def _scale(self) -> tuple[float, float, float]:
        return (1.0, 1.0, float(self.stretch.value))


def _values(
    ground: Ground, maps: Mapping[str, np.ndarray], place: np.ndarray, scene: Mapping[str, Any]
) -> dict[str, str]:
    """Return the elevation and the values of maps at a map position [m] as texts by title."""
    rows = {
        **_coordinates(place, scene),
        'Elevation': f'{ground.terrain.elevations_at(place):.0f} m',
    }
    for source, (title, style) in SHOWN.items():
        if source in maps:
            value = float(ground.terrain.values_at(maps[source], place))
            text = f'{value:.4g} {STYLES[style].label}' if math.isfinite(value) else 'none'
            rows[title] = duration(value) if style == 'arrival' and text != 'none' else text
    return rows


def _coordinates(place: np.ndarray, scene: Mapping[str, Any]) -> dict[str, str]:
    """Return a map position [m] in the coordinate system of a scene and in degrees, as texts."""
    known = georeference_of(scene)
    if not known.system:
        return {'x, y': f'{place[0]:.0f} m, {place[1]:.0f} m'}
    east, north = np.add(place, known.offset)
    rows = {'Easting, northing': f'{east:.0f} m, {north:.0f} m'}
    # without rasterio, and outside the projection
    with suppress(LavaError, ValueError):
        (longitude,), (latitude,) = transformed(known.system, DEGREES, [east], [north])
        rows['Longitude, latitude'] = f'{longitude:.5f}°, {latitude:.5f}°'
    return rows


def _box(markup: str, style: str = '') -> str:
    look = 'padding: 2px 12px; font: 13px/1.45 system-ui, sans-serif; overflow-wrap: anywhere;'
    return f'<div style="{look} {style}">{markup}</div>'


def _table(rows: Mapping[str, str]) -> str:
    """Return two columns of texts, which are untrusted."""
    cells = (f'<tr><td>{escape(a)}</td><td>{escape(b)}</td></tr>' for a, b in rows.items())
    return _box(f'<table>{"".join(cells)}</table>')


def _legend(title: str, scale: Scale, palette: np.ndarray) -> str:
    """Return a legend with the colours of a palette, uint8, shape [count, 3]."""
    colours = ['#{:02x}{:02x}{:02x}'.format(*colour) for colour in palette.tolist()]
    if scale.names:
        pairs = zip(colours, scale.names, strict=True)
        return _box('<br>'.join(f'<span style="color: {a}">■</span> {b}' for a, b in pairs))
    bar = f'height: 12px; background: linear-gradient(90deg, {", ".join(colours)})'
    ticks = np.linspace(scale.norm.vmin, scale.norm.vmax, 5)
    text = ''.join(f'<span>{tick:.4g}</span>' for tick in ticks)
    unit = f'{title} [{scale.label}]' if scale.label else title
    row = f'<div style="display: flex; justify-content: space-between">{text}</div>'
    return _box(f'{unit}<div style="{bar}"></div>{row}')


def _vents(frame: Frame) -> list[tuple[str, list[float]]]:
    """Return the label and the map position [m] of each vent."""
    labels = []
    for place in frame.vents.tolist():
        name = ''
        # the description in a foreign bag is untrusted
        with suppress(LookupError, StopIteration, TypeError, ValueError):
            name = next(
                vent['name'] for vent in frame.scene['vents']
                if np.allclose(vent['position'], place, atol=0.01)
            )
        labels.append((f'▲ {name or "vent"}', place))
    return labels
