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

"""Which requests a server answers: those that name it, and that its own page makes.

A page of another site can have its name resolve to this machine (DNS rebinding). Its requests
then reach the server, but they carry the name of the other site.
"""

from collections.abc import Callable, Iterable
from ipaddress import ip_address
import socket
from typing import Any
from urllib.parse import urlsplit

from tornado.httputil import HTTPServerRequest
from tornado.routing import AnyMatches, Router, Rule, RuleRouter
from tornado.web import Application, ErrorHandler

#: Names of this machine that are not those of a network.
_LOOPBACK = ('localhost', '127.0.0.1', '::1')


def own_hosts(address: str, sockets: Iterable[socket.socket]) -> Callable[[str], bool]:
    """Say which hosts a server is asked for by.

    A server of one address is asked for by that, and one of this machine alone by any name of the
    machine for itself. A server of every network is asked for by IP addresses, of which it cannot
    tell its own, and by the machine's name. A page of another site has neither.

    Args:
        address: Where the server listens, as given.
        sockets: The sockets that it listens at.

    Returns:
        Whether a ``Host``, with its port, is one of the server's.
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
    """Route requests to what is served, and refuse those of other hosts or pages with 403."""
    refusing = Application([('.*', ErrorHandler, {'status_code': 403})])
    return RuleRouter([Rule(_Own(is_own), served), Rule(AnyMatches(), refusing)])


class _Own:
    """A matcher of Tornado: requests for this server, from no page or from its own."""

    def __init__(self, is_own: Callable[[str], bool]) -> None:
        self._is_own = is_own

    def match(self, request: HTTPServerRequest) -> dict[str, Any] | None:
        """Return arguments for the handler, of which there are none; None for no match."""
        host, origin = request.host.lower(), request.headers.get('Origin')
        is_same = origin is None or urlsplit(origin.lower()).netloc == host
        return {} if is_same and self._is_own(host) else None


def _is_ip_address(name: str) -> bool:
    try:
        ip_address(name)
    except ValueError:
        return False
    return True
