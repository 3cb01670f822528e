# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""ROS domains for one process, so that tests can run side by side."""

from functools import cache
import os
import socket

#: Domains whose ports are free everywhere.
_DOMAINS = range(1, 102)

#: Number of participants whose ports must be free.
_PARTICIPANTS = 10

_kept = []


def own_domain(name: str = 'graph') -> int:
    """Return a domain that only this process uses, one for each name.

    The port of its first participant stays bound, so that other searches for a free domain, such
    as that of `lava ros demo`, take another one. Participants take the next ports. A domain with a
    used port has participants left over from an earlier run.
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
