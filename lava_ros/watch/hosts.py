# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Filter of HTTP requests by the host that they name and the page that makes them.

Another site can let its name resolve to this machine (DNS rebinding). The requests of its page
then reach the server, but their ``Host`` is the name of the other site.
"""

from collections.abc import Callable, Iterable
from ipaddress import ip_address
import socket
from typing import Any
from urllib.parse import urlsplit

from tornado.httputil import HTTPServerRequest
from tornado.routing import AnyMatches, Router, Rule, RuleRouter
from tornado.web import Application, ErrorHandler

#: Names of the loopback interface.
_LOOPBACK = ('localhost', '127.0.0.1', '::1')


def own_hosts(address: str, sockets: Iterable[socket.socket]) -> Callable[[str], bool]:
    """Return a function that checks if a ``Host`` is one of a server's own.

    A server that listens at one address accepts that address, and on the loopback interface also
    the other names of the interface. A server that listens on all networks accepts the name of the
    machine and any IP address, because it cannot determine all of its own. A page of another site
    is reached by neither.

    Args:
        address: Address at which the server listens, as given.
        sockets: Sockets at which it listens.

    Returns:
        Function of a ``Host`` with its port: True if it is one of the server's.
    """
    bound = [sock.getsockname() for sock in sockets]
    port = bound[0][1]
    names = {address.lower(), *(name for name, *_ in bound)}
    places = [ip_address(name.partition('%')[0]) for name, *_ in bound]
    is_everywhere = any(place.is_unspecified for place in places)
    if is_everywhere:
        name = socket.gethostname().lower()
        names |= {*_LOOPBACK, name, f'{name}.local'}
    elif any(place.is_loopback for place in places):
        names |= {*_LOOPBACK}

    def is_own(host: str) -> bool:
        try:
            split = urlsplit(f'//{host}')
            name, asked = split.hostname or '', split.port or 80
        except ValueError:
            return False
        if '@' in host or asked != port:
            return False
        return name in names or (is_everywhere and _is_ip_address(name))

    return is_own


def only_own(served: Router, is_own: Callable[[str], bool]) -> RuleRouter:
    """Route requests to ``served``; answer 403 to those for other hosts or from other pages."""
    refusing = Application([('.*', ErrorHandler, {'status_code': 403})])
    return RuleRouter([Rule(_Own(is_own), served), Rule(AnyMatches(), refusing)])


class _Own:
    """Matcher of Tornado for requests to this server, from its own page or from no page."""

    def __init__(self, is_own: Callable[[str], bool]) -> None:
        self._is_own = is_own

    def match(self, request: HTTPServerRequest) -> dict[str, Any] | None:
        """Return the arguments for the handler (an empty dict), None for no match."""
        host, origin = request.host.lower(), request.headers.get('Origin')
        is_same = origin is None or urlsplit(origin.lower()).netloc == host
        return {} if is_same and self._is_own(host) else None


def _is_ip_address(name: str) -> bool:
    try:
        ip_address(name)
    except ValueError:
        return False
    return True
