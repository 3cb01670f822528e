# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""ROS domains for one process, and its own network, so that tests can run side by side."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
import ctypes
import fcntl
from functools import cache
import os
import socket
import struct
import sys
from typing import Any

#: Domains whose ports are free everywhere.
_DOMAINS = range(1, 102)

#: Number of participants whose ports must be free.
_PARTICIPANTS = 10

#: Linux: a new network for ``unshare``, the request that sets an interface's flags, and its flag
#: for an interface that is up.
_NEW_NETWORK, _SET_FLAGS, _IS_UP = 0x40000000, 0x8914, 1

_kept = []

#: An item once this process has its own network.
_has_left: list[bool] = []

#: A thread that stays in the network of the machine.
_outside = ThreadPoolExecutor(max_workers=1)


def own_domain(name: str = 'graph') -> int:
    """Return a domain that only this process uses, one for each name.

    The port of its first participant stays bound, so that other searches for a free domain, such
    as that of `lava ros demo`, take another one. Participants take the next ports. A domain with a
    used port has participants left over from an earlier run.
    """
    return _claim(name)


@cache
def _claim(name: str) -> int:
    domain = outside(_bind_ports, name)
    if _has_left:
        _keep(domain)
    return domain


def outside(function: Callable[..., Any], *arguments: Any) -> Any:
    """Call a function in the network of the machine."""
    return _outside.submit(function, *arguments).result()


def _keep(domain: int) -> None:
    """Bind the port of a domain's first participant in this thread's own network."""
    kept = socket.socket(type=socket.SOCK_DGRAM)
    kept.bind(('', 7410 + 250 * domain))
    _kept.append(kept)


def _bind_ports(name: str) -> int:
    first = os.getpid() % len(_DOMAINS)
    for domain in (*_DOMAINS[first:], *_DOMAINS[:first]):
        kept, *others = ports = [
            socket.socket(type=socket.SOCK_DGRAM) for _ in range(_PARTICIPANTS)
        ]
        try:
            for index, port in enumerate(ports):
                port.bind(('', 7410 + 250 * domain + 2 * index))
        except OSError:
            kept.close()
        else:
            _kept.append(kept)
            return domain
        finally:
            for port in others:
                port.close()
    raise RuntimeError(f'no domain for {name}: all are in use')


def leave_network() -> bool:
    """Move this thread, and all threads and processes that it starts, to a network of its own.

    Nodes of other programs on the machine cannot reach it, whatever their domain. Linux allows it
    to the superuser only; elsewhere only the domain separates the graph.

    Returns:
        True if the thread has its own network.
    """
    # the thread that stays must have started
    domain = own_domain()
    if not sys.platform.startswith('linux'):
        return False
    if ctypes.CDLL(None, use_errno=True).unshare(_NEW_NETWORK):
        return False
    with socket.socket(type=socket.SOCK_DGRAM) as one:
        fcntl.ioctl(one, _SET_FLAGS, struct.pack('16sh14x', b'lo', _IS_UP))
    _has_left.append(True)
    _keep(domain)
    return True
