# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The server of the pages, for browsers on this machine only.

Another site can make its name resolve to this machine (DNS rebinding). The requests of its page
then reach the server, but their ``Host`` is the name of the other site.
"""

from collections.abc import Callable
from contextlib import redirect_stdout, suppress
from functools import partial
from http import HTTPStatus
from io import StringIO
import logging
import socket
import sys
from threading import Event
import time
from typing import Any
from urllib.parse import urlsplit
import warnings

import viser
from websockets.asyncio import server as websocket_server
from websockets.datastructures import Headers

from lava_ros.errors import Guard, LavaError, refusing
from lava_ros.layers.frame import Frame
from lava_ros.scene.on_terrain import PlacedPicture
from lava_ros.watch.frames import Frames, Level
from lava_ros.watch.page import ground_picture, Page
from lava_ros.watch.surface import Ground
from lava_ros.watch.tone import AMBIENT

#: The only address at which the server listens, and the names of it that requests may use.
ADDRESS, HOSTS = '127.0.0.1', {'127.0.0.1', 'localhost', '::1'}

#: Wall time between updates of the pages [s].
TICK = 0.1

#: Maximum number of pages at a time.
MAX_PAGES = 16

#: Limits of a connection: time for the request and for an answer to a ping [s], and size of
#: a message [bytes].
LIMITS: dict[str, Any] = {'open_timeout': 10.0, 'max_size': 2**18, 'ping_timeout': 120.0}

#: Headers of every answer: the page loads nothing from other servers, and no other page can frame
#: it. Without ``data:`` in connect-src, it does not load viser's picture of the sky, which has no
#: effect here and takes a second without a GPU.
_HEADERS = {
    'Content-Security-Policy': "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; "
    "connect-src 'self' blob:; form-action 'none'; frame-ancestors 'none'",
    'X-Content-Type-Options': 'nosniff',
}


def is_own(headers: Headers) -> bool:
    """Return True for a request to this machine from its own page, or from no page."""
    try:
        host, origin = headers['Host'].lower(), headers.get('Origin')
        own = urlsplit(f'//{host}')
        is_here = own.hostname in HOSTS and '@' not in host and (own.port or 80) > 0
        return is_here and (origin is None or origin.lower() == f'http://{host}')
    except (LookupError, ValueError):
        return False


class Server:
    """A server with a page for each browser.

    Attributes:
        port: Port at which it listens.
        pages: The page of each browser, by number.
    """

    def __init__(
        self, frames: Frames, port: int, drape: PlacedPicture | None = None, control: bool = False
    ) -> None:
        """Listen at a port, 0 for a free one; ``drape`` covers the relief of the ground.

        Raises:
            LavaError: If the port is taken.
        """
        self._frames, self._drape, self._control = frames, drape, control
        self._ground: Ground | None = None
        self._tried = -1
        self.pages: dict[int, Page] = {}
        with refusing('--port', port, 'a free port', OSError):
            listener = socket.create_server((ADDRESS, port))
        self.port: int = listener.getsockname()[1]
        # a browser may leave while its page is drawn
        warnings.filterwarnings('ignore', 'Queued a .* on a closed connection')
        # a refused or malformed request is not an error of this program
        logging.getLogger('lava_ros.watch.requests').disabled = True
        serve = websocket_server.serve
        websocket_server.serve = partial(_serve_own, serve, listener)
        try:
            with redirect_stdout(StringIO()):
                self._server = viser.ViserServer(ADDRESS, self.port, verbose=False)
        finally:
            websocket_server.serve = serve
        # with equal light from all sides, colours match the legend (tone.py)
        self._server.scene.configure_environment_map(None)
        self._server.scene.configure_default_lights(enabled=False)
        self._server.scene.add_light_ambient('/light', intensity=AMBIENT)
        for message in (viser._messages.ShareUrlRequest, viser._messages.ShareUrlDisconnect):
            self._server._websock_server.unregister_handler(message)

    def update(self) -> None:
        """Read new frames, and update the pages of the connected browsers."""
        self._frames.poll()
        if self._ground is None and self._frames.times and self._tried != self._frames.version:
            # ready before the first browser has loaded its page, which reports any error
            self._tried = self._frames.version
            with suppress(LavaError):
                frame = self._frames.frame(len(self._frames.times) - 1)
                self._ground_of(frame).fit(frame, frame.lava)
        self.pages = {
            number: self.pages.get(number)
            or Page(client, self._frames, self._ground_of, control=self._control)
            for number, client in self._server.get_clients().items()
        }
        for page in self.pages.values():
            page.update()

    def run(self, ended: Event) -> None:
        """Update the pages until an event, and report when their source fails or is back."""
        was_bad, due, guard = False, 0.0, Guard('live view')
        while not ended.wait(due - time.monotonic()):
            # a long update must not delay the next one, or maps are left out
            due = time.monotonic() + TICK
            guard.run(self.update)
            level, words = self._frames.status
            if was_bad != (level is Level.ERROR):
                was_bad = not was_bad
                print(f'lava watch: {words}', file=sys.stderr, flush=True)
        self.close()

    def close(self) -> None:
        """Stop serving."""
        with redirect_stdout(StringIO()):
            self._server.stop()

    def _ground_of(self, frame: Frame) -> Ground:
        """Return the ground of a frame, which pages share."""
        if self._ground is None or not self._ground.is_of(frame):
            self._ground = Ground(frame, ground_picture(frame, self._drape))
        return self._ground


def _serve_own(
    serve: Any, listener: socket.socket, handler: Any, host: str, port: int, *,
    process_request: Callable[..., Any], **options: Any,
) -> Any:
    """Serve at a socket, with limits, and only requests that are ``is_own``."""

    def answer(connection: Any, request: Any) -> Any:
        if not is_own(request.headers):
            text = 'requests from other pages are refused\n'
            response = connection.respond(HTTPStatus.FORBIDDEN, text)
        elif len(connection.server.connections) >= MAX_PAGES:
            text = 'too many pages are open\n'
            response = connection.respond(HTTPStatus.SERVICE_UNAVAILABLE, text)
        else:
            response = process_request(connection, request)
        if response is not None:
            response.headers.update(_HEADERS)
        return response

    options |= {'logger': logging.getLogger('lava_ros.watch.requests'), **LIMITS}
    return serve(handler, sock=listener, process_request=answer, **options)
