# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Start of rclpy with checked arguments, and execution of callbacks."""

from collections.abc import Callable, Sequence
import os
import re
import time
from typing import Any

import rclpy
from rclpy.executors import Executor
from rclpy.logging import LoggingSeverity, set_logger_level
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.ros import middleware

#: Maximum domain ID for which there are UDP ports.
MAX_DOMAIN = 232

#: Descriptions of valid values of a flag, by rcl's name of the value.
_EXPECTED = {
    'params file': 'a file of parameters, NODE: {ros__parameters: {NAME: VALUE}}',
    'parameter override rule': "NAME:=VALUE; an empty text is written NAME:=\"''\"",
    'remap rule': 'FROM:=TO, __ns:=/NAMESPACE or __node:=NAME, of letters, digits and _',
    'log level': 'debug, info, warn, error or fatal, or one of them as LOGGER:=LEVEL',
}

#: rcl's error messages for an argument that it cannot parse, and for a flag without a value.
_REFUSED = re.compile(r"Couldn't parse ([a-z ]+): '(-\S+) (.*)'\. Error: (.*)")
_TRAILING = re.compile(r"Couldn't parse trailing .*?(-[\w-]+)")

#: Source position at the end of rcl's error messages.
_PLACE = re.compile(r', at \S+:\d+')


def start_ros(args: Sequence[str] | None = None, **options: Any) -> None:
    """Initialise rclpy without its signal handlers, and with params/fast_dds.xml for Fast DDS.

    Profiles that the user has chosen take precedence.

    Args:
        args: ROS arguments, beginning with ``--ros-args``; None: the arguments of the process.
        **options: Further arguments of ``rclpy.init``.

    Raises:
        LavaError: If an argument or an environment variable is not valid.
    """
    words = None if args is None else list(args)
    domain = os.environ.get('ROS_DOMAIN_ID', '')
    if domain:
        number = int(domain) if domain.isdecimal() else domain
        # Fast DDS terminates the process if a domain has no port
        validation.whole('ROS_DOMAIN_ID', number, at_least=0, at_most=MAX_DOMAIN)
    middleware.set_profiles()
    # rcl also logs an error that it raises
    set_logger_level('rcl', LoggingSeverity.FATAL)
    try:
        rclpy.init(args=words, signal_handler_options=SignalHandlerOptions.NO, **options)
    except RuntimeError as error:
        raise _refusal(error) from None
    finally:
        set_logger_level('rcl', LoggingSeverity.UNSET)


def _refusal(error: RuntimeError) -> LavaError:
    """Convert an error of rclpy about its arguments to a LavaError."""
    text = _PLACE.sub('', str(error)).removeprefix('failed to initialize rcl: ')
    if type(error).__name__ == 'UnknownROSArgsError':
        return LavaError('--ros-args', text.strip("[]'"), 'ROS flags, such as -p or -r')
    if match := _TRAILING.match(text):
        return LavaError(match[1], None, 'a value after it')
    if match := _REFUSED.match(text):
        kind, flag, value, reason = match.groups()
        # rcl prints the numbers of its lexemes, which do not help a user
        is_clear = not re.search('lexeme|not set|token', reason)
        return LavaError(flag, value, _EXPECTED.get(kind, kind) + f' ({reason})' * is_clear)
    return LavaError('ROS', text, 'arguments and an environment that ROS accepts')


#: Pause after a failed callback, so that one that always fails does not occupy the CPU [s].
PAUSE = 0.01


def now_ns(node: Node) -> int:
    """Return the time of a node's clock [ns]."""
    return int(node.get_clock().now().nanoseconds)


def spin(
    executor: Executor, *, until: Callable[[], bool], on_error: Callable[[Exception], None]
) -> None:
    """Run callbacks until ``until``, called at least ten times a second, returns True.

    Errors go to ``on_error``, and the node continues. They include errors of the middleware
    itself, such as a time on /clock outside the range of a clock.
    """
    while not until():
        try:
            executor.spin_once(timeout_sec=0.1)
        except Exception as error:
            on_error(error)
            time.sleep(PAUSE)
