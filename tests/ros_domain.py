# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""ROS domains that nobody else on this machine has: tests side by side hear only their own."""

from functools import cache
import os
import socket

#: Domains whose ports are free everywhere.
_DOMAINS = range(1, 102)

#: Participants of a domain whose ports are looked at.
_PARTICIPANTS = 10

_kept = []


def own_domain(name: str = 'graph') -> int:
    """A domain of this process, one for each name, that is its own until it ends.

    The port of a domain's first participant is kept, so that whoever looks for a free domain,
    `lava demo` too, takes another; participants take the next ports. A domain where one of those
    is in use has participants left over from an earlier run.
    """
    return _claim(name)


@cache
def _claim(name: str) -> int:
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
