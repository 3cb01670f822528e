# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The page: maps over shaded relief with a slider of time, served by Bokeh."""

from collections.abc import Callable
from dataclasses import replace
import errno
import html
import math
from typing import Any

from bokeh.application import Application
from bokeh.application.handlers.function import FunctionHandler
from bokeh.document import Document
from bokeh.layouts import column, row
from bokeh.models import (
    ColorBar,
    DataRange1d,
    Div,
    GlobalInlineStyleSheet,
    HoverTool,
    InlineStyleSheet,
    LinearColorMapper,
    NumeralTickFormatter,
    PrintfTickFormatter,
    RadioButtonGroup,
    Slider,
)
from bokeh.palettes import interp_palette
from bokeh.plotting import figure
from bokeh.server.server import BaseServer
from bokeh.server.tornado import BokehTornado
from bokeh.server.util import bind_sockets
import numpy as np
from tornado.httpserver import HTTPServer
from tornado.ioloop import IOLoop, PeriodicCallback

from lava_ros.errors import LavaError
from lava_ros.maps.frames import Frame
from lava_ros.maps.layers import ARRIVAL, ARRIVED, PROBABILITY
from lava_ros.maps.plot import (
    BARRIER,
    barriers_of,
    bounds_of,
    duration,
    extent_of,
    LEAST_CELLS,
    scale_of,
    shaded_ground,
    STYLES,
    titles,
    window_of,
)
from lava_ros.pages.report.survey import View
from lava_ros.watch.frames import Frames, Level, Status
from lava_ros.watch.hosts import only_own, own_hosts

#: Most cells of a map that is sent; of a larger one several are shown as their largest.
MOST_CELLS = 600_000

#: How often what is new is taken, and how often it is shown [ms].
POLL, SHOW = 100, 500

#: How maps are drawn, in the order in which they are offered.
SHOWN = {
    'thickness': ('Lava thickness', 'thickness'),
    'hazard': ('Hazard', 'hazard'),
    'temperature': ('Temperature', 'temperature'),
    ARRIVED: ('Arrival', 'arrival'),
    ARRIVAL: ('Arrival forecast', 'arrival'),
    PROBABILITY: ('Probability', 'probability'),
}

_LIGHTS = {Level.WELL: '#7bd88f', Level.WAITING: '#f5c451', Level.BAD: '#ff6b5e'}

_INK, _DIM = '#e8e6e1', '#b7b3ab'

_PAGE = 'html, body {background: #15191c; height: 100%; margin: 0}'

_STYLE = f"""
:host {{color: {_INK}; font: 16px/1.4 system-ui, sans-serif}}
.bk-clearfix {{width: 100%}} small {{color: {_DIM}; font-size: 20px; font-weight: 400}}
h1 {{font-size: 30px; font-weight: 600; margin: 0}} p {{margin: 0; color: {_DIM}}}
.bk-btn-default {{background: #262b30; color: {_INK}; border-color: #434a51; font-size: 15px}}
.bk-btn-default.bk-active {{background: #c9541f; border-color: #c9541f}}
"""


class Page:
    """The page of one browser session, with its own slider and choice of map."""

    def __init__(self, frames: Frames) -> None:
        """Create an empty page that shows ``frames``."""
        self._frames = frames
        self._version, self._problem = -1, ''
        self._time: float | None = None
        self._elevation: np.ndarray | None = None
        style = {'stylesheets': [InlineStyleSheet(css=_STYLE)], 'sizing_mode': 'stretch_width'}
        # a $$ in the name of a bag does not begin a formula
        self.title, self.status = (Div(disable_math=True, **style) for _ in range(2))
        self.choice = RadioButtonGroup(labels=[], active=None, height=38, **style)
        self.slider = Slider(start=0, end=1, value=0, step=1, show_value=False, title='', **style)
        self._names: list[str] = []
        self._mapper = LinearColorMapper(['#000000'], nan_color='#00000000')
        self.figure = self._draw_figure()
        self.choice.on_change('active', lambda attr, old, new: self._show())
        self.slider.on_change('value', lambda attr, old, new: self._show())

    def open(self, document: Document) -> None:
        """Add the page to a document, and update it periodically."""
        document.title, document.theme = 'lava watch', 'dark_minimal'
        document.add_root(
            column(
                row(self.title, self.status, sizing_mode='stretch_width'),
                self.choice,
                self.figure,
                self.slider,
                sizing_mode='stretch_both',
                margin=(12, 18, 12, 18),
                stylesheets=[GlobalInlineStyleSheet(css=_PAGE)],
            )
        )
        document.add_periodic_callback(self.update, SHOW)
        self.update()

    def update(self) -> None:
        """Show new frames; a slider at its end follows them."""
        problem = self._problem and Status(Level.BAD, self._problem)
        level, words = problem or self._frames.status
        # what nodes and files say may hold anything
        words = f'<p style="text-align: right; color: {_LIGHTS[level]}">{html.escape(words)}'
        self.status.text = words
        times = self._frames.times
        if self._version == self._frames.version or not times:
            return
        is_first = self._version < 0
        self._version = self._frames.version
        last = len(times) - 1
        is_at_end = is_first or self.slider.value >= self.slider.end
        known = [math.nan if item is None else item for item in times]
        before = int(np.searchsorted(known, self._time)) if self._time is not None else last
        value = last if is_at_end else min(before, last)
        is_moved = value != self.slider.value
        self.slider.update(end=max(last, 1), value=value, disabled=last == 0)
        if not is_moved:
            self._show()

    def _show(self) -> None:
        """Show the map that is chosen at the time of the slider."""
        if not self._frames.times:
            return
        index = min(int(self.slider.value), len(self._frames.times) - 1)
        try:
            frame = self._frames.frame(index)
        except LavaError as error:
            self._problem = str(error)
            return
        self._problem, self._time = '', frame.time
        maps = {source: item.values for source, item in frame.layers.items()}
        maps |= {} if frame.arrived is None else {ARRIVED: frame.arrived}
        title, facts = (html.escape(item) for item in titles(frame))
        last = self._frames.times[-1]
        of = '' if last is None else f' <small>of {duration(last)} so far</small>'
        self._draw_ground(frame)
        if maps:
            self._offer([source for source in SHOWN if source in maps])
            source = self._names[self.choice.active]
            self._draw_map(frame, source, maps[source])
            # a forecast that is withdrawn is a map of nothing
            if not np.isfinite(maps[source]).any():
                facts += '  ·  <b>nothing on this map now</b>'
        self.title.text = f'<h1>{title}{of}</h1><p>{facts}'

    def _offer(self, names: list[str]) -> None:
        """Offer maps to choose from; the one that was chosen stays so while it is there."""
        if names != self._names:
            chosen = self._names[self.choice.active] if self._names else names[0]
            self._names = names
            active = names.index(chosen) if chosen in names else 0
            self.choice.update(labels=[SHOWN[name][0] for name in names], active=active)

    def _draw_ground(self, frame: Frame) -> None:
        least = LEAST_CELLS * frame.resolution
        left, bottom, right, top = window_of(
            bounds_of(frame, frame.lava), extent_of(frame), 1.5, least
        )
        self._window.data = {'left': [left], 'right': [right], 'bottom': [bottom], 'top': [top]}
        self.vents.data = {'x': frame.vents[:, 0], 'y': frame.vents[:, 1]}
        crests = barriers_of(frame)
        self.barriers.data = {
            name: [crest[:, axis] for crest in crests] for axis, name in enumerate(('xs', 'ys'))
        }
        if self._elevation is None or not np.array_equal(
            self._elevation, frame.elevation, equal_nan=True
        ):
            self._elevation = frame.elevation
            size = frame.resolution * _coarseness(frame)
            coarse = replace(frame, elevation=_coarse(frame, frame.elevation), resolution=size)
            pixels = (255.0 * shaded_ground(coarse)).astype(np.uint8)
            self.relief.data = _placed(frame, pixels.view(np.uint32)[..., 0])

    def _draw_map(self, frame: Frame, source: str, values: np.ndarray) -> None:
        title, style = SHOWN[source]
        scale = scale_of(style, values)
        unit = '' if style == 'hazard' else scale.label
        self._mapper.update(
            palette=interp_palette(STYLES[style].colours, 256),
            low=scale.norm.vmin,
            high=scale.norm.vmax,
        )
        self._bar.formatter.format = f'%g {unit}'.replace(' %', ' %%')
        self._hover.tooltips = [(title, f'@image{{0.[0]}} {unit}'), ('x, y', '$x{0} m, $y{0} m')]
        self.map.data = _placed(frame, _coarse(frame, values / scale.unit))

    def _draw_figure(self) -> Any:
        box = {'range_padding': 0.0, 'renderers': []}
        plot = figure(
            x_range=DataRange1d(**box),
            y_range=DataRange1d(**box),
            match_aspect=True,
            sizing_mode='stretch_both',
            tools='pan,wheel_zoom,box_zoom,reset,save',
            active_scroll='wheel_zoom',
            x_axis_label='x [m], map frame',
            y_axis_label='y [m]',
        )
        plot.toolbar.logo = None
        plot.grid.visible = False
        plot.axis.formatter = NumeralTickFormatter(format='0')
        image: dict[str, Any] = {name: [] for name in ('image', 'x', 'y', 'dw', 'dh')}
        self.relief = plot.image_rgba(**image).data_source
        lava = plot.image(**image, color_mapper=self._mapper, alpha=0.85)
        self.map = lava.data_source
        look = {'line_color': BARRIER['color'], 'line_width': BARRIER['linewidth']}
        self.barriers = plot.multi_line(xs=[], ys=[], **look).data_source
        self.vents = plot.scatter(
            x=[], y=[], marker='triangle', size=13, fill_color='white', line_color='black'
        ).data_source
        window = plot.quad(left=[], right=[], top=[], bottom=[], fill_alpha=0, line_alpha=0)
        self._window = window.data_source
        plot.x_range.renderers = plot.y_range.renderers = [window]
        self._hover = HoverTool(renderers=[lava], tooltips=[])
        plot.add_tools(self._hover)
        self._bar = ColorBar(
            color_mapper=self._mapper, formatter=PrintfTickFormatter(), width=18
        )
        plot.add_layout(self._bar, 'right')
        return plot


def _coarseness(frame: Frame) -> int:
    """Cells along a side of one that is sent."""
    return math.ceil(math.sqrt(frame.elevation.size / MOST_CELLS))


def _coarse(frame: Frame, values: np.ndarray) -> np.ndarray:
    """The cells that are sent, each the largest of its parts, float32."""
    rows, columns = values.shape
    view = View((0, rows), (0, columns), _coarseness(frame))
    return view.cut(values, np.fmax).astype(np.float32)


def _placed(frame: Frame, image: np.ndarray) -> dict[str, Any]:
    """An image of the cells that are sent, at its place as a source of Bokeh has it."""
    (x, y), size = frame.origin, frame.resolution * _coarseness(frame)
    height, width = (size * count for count in image.shape)
    return {'image': [image], 'x': [x], 'y': [y], 'dw': [width], 'dh': [height]}


def serve(
    frames: Frames, address: str, port: int, *, on_poll: Callable[[], None] = lambda: None
) -> BaseServer:
    """Serve the page at an address, ``0.0.0.0`` for every network, and return the server.

    Requests for another host than the address are answered with 403 (``hosts.only_own``).

    Port 0 chooses a free port. The page includes all that it needs. It is served while the
    server's ``io_loop`` runs; ``on_poll`` is called after each check for new frames.

    Raises:
        LavaError: The address is not this machine's, or the port is taken.
    """
    if not address:
        # to Python, that is every network
        raise LavaError('--address', address, 'an address of this machine, such as 127.0.0.1')
    try:
        sockets, port = bind_sockets(address, port)
    except (OSError, ValueError) as error:
        is_taken = isinstance(error, OSError) and error.errno == errno.EADDRINUSE
        field, value = ('--port', port) if is_taken else ('--address', address)
        right = f'a port and an address that this machine can listen at ({error})'
        raise LavaError(field, value, right) from error

    def poll() -> None:
        frames.poll()
        on_poll()

    page = Application(FunctionHandler(lambda document: Page(frames).open(document)))
    # Requests of other pages are refused before Bokeh checks their origin.
    tornado = BokehTornado(page, extra_websocket_origins=[f'*:{port}'])
    http = HTTPServer(only_own(tornado, own_hosts(address, sockets)))
    http.add_sockets(sockets)
    server = BaseServer(IOLoop.current(), tornado, http)
    looks = PeriodicCallback(poll, POLL)
    server.io_loop.add_callback(looks.start)
    server.start()
    return server
