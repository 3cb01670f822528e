# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The server of the pages, for browsers on this machine alone.

Another site can let its name resolve to this machine (DNS rebinding). The requests of its page
then reach the server, but their ``Host`` is the name of the other site.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from http import HTTPStatus
from io import StringIO
import logging
import socket
from threading import Event
from typing import Any
from urllib.parse import urlsplit
import warnings

import viser
from websockets.asyncio import server as websocket_server
from websockets.datastructures import Headers

from lava_ros.errors import LavaError
from lava_ros.watch.frames import Frames
from lava_ros.watch.page import Page

#: The only address at which the server listens, and the names of it that requests may use.
ADDRESS, HOSTS = '127.0.0.1', {'127.0.0.1', 'localhost', '::1'}

#: Wall time between updates of the pages [s].
TICK = 0.1

#: Maximum number of pages at a time.
MAX_PAGES = 16

#: Limits of a connection: time for the request and for an answer to a ping [s], and size of
#: a message [bytes].
LIMITS: dict[str, Any] = {'open_timeout': 10.0, 'max_size': 2**18, 'ping_timeout': 120.0}

#: Headers of every answer: the page uses nothing from elsewhere, and no other page can frame it.
_HEADERS = {
    'Content-Security-Policy': "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; "
    "form-action 'none'; frame-ancestors 'none'",
    'X-Content-Type-Options': 'nosniff',
}


def is_own(headers: Headers) -> bool:
    """Return True for a request to this machine by its own page, or by no page."""
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

    def __init__(self, frames: Frames, port: int, **options: Any) -> None:
        """Listen at a port; 0 selects a free one.

        Args:
            frames: The frames to show.
            port: The port.
            options: Keyword arguments of ``Page``.

        Raises:
            LavaError: The port is in use.
        """
        self._frames, self._options = frames, options
        self.pages: dict[int, Page] = {}
        # viser prints its own address, and would take the next free port
        try:
            listener = socket.create_server((ADDRESS, port))
        except OSError as error:
            raise LavaError('--port', port, f'a port that is free ({error})') from error
        self.port: int = listener.getsockname()[1]
        # a browser may leave while its page is drawn
        warnings.filterwarnings('ignore', 'Queued a .* on a closed connection')
        with _guarded(listener), redirect_stdout(StringIO()):
            self._server = viser.ViserServer(ADDRESS, self.port, verbose=False)
        # its light would change the colours of the legend
        self._server.scene.configure_environment_map(None)
        for message in (viser._messages.ShareUrlRequest, viser._messages.ShareUrlDisconnect):
            self._server._websock_server.unregister_handler(message)

    def update(self) -> None:
        """Read new frames, and update the pages of the browsers that are there."""
        self._frames.poll()
        clients = self._server.get_clients()
        self.pages = {
            number: self.pages.get(number) or Page(client, self._frames, **self._options)
            for number, client in clients.items()
        }
        for page in self.pages.values():
            page.update()

    def run(self, ended: Event, on_update: Callable[[], None]) -> None:
        """Update the pages until an event, and call a function after each update."""
        while not ended.wait(TICK):
            self.update()
            on_update()
        self.close()

    def close(self) -> None:
        """Stop serving."""
        with redirect_stdout(StringIO()):
            self._server.stop()


@contextmanager
def _guarded(listener: socket.socket) -> Iterator[None]:
    """Let viser serve at a socket, with limits, and only requests that are ``is_own``."""
    serve = websocket_server.serve
    log = logging.getLogger('lava_ros.watch.requests')
    # a refused or malformed request is not an error of this program
    log.disabled = True

    def serve_own(
        handler: Any, host: str, port: int, *, process_request: Callable[..., Any], **options: Any
    ) -> Any:
        def answer(connection: Any, request: Any) -> Any:
            if not is_own(request.headers):
                response = connection.respond(HTTPStatus.FORBIDDEN, 'not for this page\n')
            elif len(connection.server.connections) >= MAX_PAGES:
                response = connection.respond(HTTPStatus.SERVICE_UNAVAILABLE, 'too many pages\n')
            else:
                response = process_request(connection, request)
            if response is not None:
                response.headers.update(_HEADERS)
            return response

        options |= {'logger': log, **LIMITS}
        return serve(handler, sock=listener, process_request=answer, **options)

    websocket_server.serve = serve_own
    try:
        yield
    finally:
        websocket_server.serve = serve
