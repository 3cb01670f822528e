# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The ROS graph of a test run is closed to other programs, where the machine allows it."""

from collections.abc import Callable
import os
import socket
import sys
from typing import Any

import pytest

from ros_domain import outside


def here(function: Callable[..., Any], *arguments: Any) -> Any:
    return function(*arguments)


def is_received(receiving: Callable[..., Any], sending: Callable[..., Any]) -> bool:
    """Return True if a message from one network arrives in the other."""
    with receiving(socket.socket, socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(('127.0.0.1', 0))
        receiver.settimeout(0.5)
        with sending(socket.socket, socket.AF_INET, socket.SOCK_DGRAM) as sender:
            try:
                sender.sendto(b'a message', receiver.getsockname())
                return bool(receiver.recv(16))
            except OSError:
                return False


@pytest.mark.skipif(
    not sys.platform.startswith('linux') or os.geteuid() != 0,
    reason='only the superuser of Linux may create a network',
)
def test_other_programs_on_the_machine_do_not_reach_the_graph() -> None:
    assert is_received(outside, outside) and is_received(here, here)
    assert not is_received(outside, here) and not is_received(here, outside)
