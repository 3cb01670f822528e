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

"""Arguments for ROS on a command line: what is wrong with them is said in one sentence."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
import os
import re
from typing import Any

import rclpy
from rclpy.logging import LoggingSeverity, set_logger_level
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from lava_ros import validation
from lava_ros.errors import LavaError

#: Largest domain that has ports.
MAX_DOMAIN = 232

#: What would be right behind a flag, by what rcl calls its value.
_RIGHT = {
    'params file': 'a file of parameters, NODE: {ros__parameters: {NAME: VALUE}}',
    'parameter override rule': "NAME:=VALUE; an empty text is written NAME:=\"''\"",
    'remap rule': 'FROM:=TO, __ns:=/NAMESPACE or __node:=NAME, of letters, digits and _',
    'log level': 'debug, info, warn, error or fatal, or one of them as LOGGER:=LEVEL',
}

#: How rcl puts an argument that it cannot read, and a flag with nothing behind it.
_REFUSED = re.compile(r"Couldn't parse ([a-z ]+): '(-\S+) (.*)'\. Error: (.*)")
_TRAILING = re.compile(r"Couldn't parse trailing .*?(-[\w-]+)")

#: Where in its own source rcl has met an error.
_PLACE = re.compile(r', at \S+:\d+')


def start_ros(args: Sequence[str] | None = None, **options: Any) -> None:
    """Initialise rclpy without its signal handlers.

    Args:
        args: Arguments for ROS, ``--ros-args`` and what follows; None: those of the process.
        **options: As for ``rclpy.init``.

    Raises:
        LavaError: An argument, or a variable of the environment, cannot be used.
    """
    words = None if args is None else list(args)
    domain = os.environ.get('ROS_DOMAIN_ID', '')
    if domain:
        number = int(domain) if domain.isdecimal() else domain
        # Fast DDS ends the process where there is no port for a domain
        validation.whole('ROS_DOMAIN_ID', number, at_least=0, at_most=MAX_DOMAIN)
    try:
        with _rcl_is_quiet():
            rclpy.init(args=words, signal_handler_options=SignalHandlerOptions.NO, **options)
    except RuntimeError as error:
        raise _refusal(error) from None


def check_words(args: Sequence[str]) -> None:
    """Refuse words that are not for ROS by LavaError; ``args`` has no name of a program."""
    rest = remove_ros_args(['lava_node', *args])[1:]
    if rest:
        right = '--ros-args and what follows it; lava node --help says more'
        raise LavaError('an argument', rest[0], right)


@contextmanager
def _rcl_is_quiet() -> Iterator[None]:
    """Have rcl log nothing of an error that is raised as well."""
    set_logger_level('rcl', LoggingSeverity.FATAL)
    try:
        yield
    finally:
        set_logger_level('rcl', LoggingSeverity.UNSET)


def _refusal(error: RuntimeError) -> LavaError:
    """What rclpy says of arguments that it cannot use, as an error of this package."""
    text = _PLACE.sub('', str(error)).removeprefix('failed to initialize rcl: ')
    if type(error).__name__ == 'UnknownROSArgsError':
        return LavaError('--ros-args', text.strip("[]'"), 'flags of ROS, such as -p or -r')
    if match := _TRAILING.match(text):
        return LavaError(match[1], None, 'a value behind it')
    if match := _REFUSED.match(text):
        what, flag, value, reason = match.groups()
        # rcl names its lexemes by number, which says nothing to anybody
        is_clear = not re.search('lexeme|not set|token', reason)
        return LavaError(flag, value, _RIGHT.get(what, what) + f' ({reason})' * is_clear)
    return LavaError('ROS', text, 'arguments and an environment that ROS can use')
