# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava`: everything this package does, from a terminal."""

from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout
import errno
import logging
import os
import re
import sys

from lava_ros.cli.manual import Manual, parsed, ROS_COMMANDS
from lava_ros.cli.output import check_outputs, Printable
from lava_ros.cli.start import end_start, INTERRUPTED
from lava_ros.errors import LavaError, printable

#: Exit status for input that cannot be used, as argparse has it.
USAGE_ERROR = 2

#: Exit status of a command that did its work, but not with all of a damaged or incomplete bag.
DAMAGED = 1

#: What a disk, a quota and a limit of the shell say where nothing more can be written.
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)

_ROS_ARGS = '--ros-args'


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command that the arguments name, without the program's name, or the process's.

    Returns:
        The exit status: 0 when it went well, 1 when part of a bag was damaged or missing and
        --incomplete does not accept that, 2 for input that cannot be used.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    for word in arguments:
        try:
            word.encode()
        except UnicodeEncodeError:
            # bytes of a terminal: neither messages, files nor libraries take them
            Manual().error(str(LavaError('an argument', word, 'text in UTF-8')))
    # argparse takes a place that begins with a minus for an option, unless it has a space in it
    arguments = [f' {word}' if re.match(r'-[\d.]+,', word) else word for word in arguments]
    # What follows is ROS's to read, options that argparse would take for its own included.
    end = len(arguments)
    if arguments and arguments[0] in ROS_COMMANDS and _ROS_ARGS in arguments:
        end = arguments.index(_ROS_ARGS)
    args = parsed(arguments[:end])
    args.ros_args = arguments[end:]
    said = _Said(args.command)
    log = logging.getLogger('lava_ros')
    log.addHandler(said)
    level = log.level
    log.setLevel(logging.INFO)
    try:
        with redirect_stdout(Printable(sys.stdout)), redirect_stderr(Printable(sys.stderr)):
            end_start()
            check_outputs(args)
            status = int(args.run(args))
            is_accepted = getattr(args, 'incomplete', False)
            return status or (DAMAGED if said.has_warned and not is_accepted else 0)
    except LavaError as error:
        problem = str(error)
    except MemoryError as error:
        problem = f'no memory is left: {printable(str(error))}'
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:
        # The reader of our output has gone: there is nobody to tell, and Python would try at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except OSError as error:
        if error.errno not in _FULL:
            raise
        problem = f'no room is left: {printable(str(error))}'
    finally:
        log.removeHandler(said)
        log.setLevel(level)
    print(f'lava {args.command}: {problem}', file=sys.stderr)
    return USAGE_ERROR


class _Said(logging.Handler):
    """Prints what the package logs, once, and remembers whether a bag was found damaged."""

    def __init__(self, command: str) -> None:
        super().__init__()
        self.has_warned = False
        self._command = command
        self._known: set[str] = set()

    def emit(self, record: logging.LogRecord) -> None:
        # past a bar that is being drawn there is nothing in between
        text = printable(' '.join(record.getMessage().split()))
        if text not in self._known:
            print(f'lava {self._command}: {text}', file=sys.stderr)
        self._known.add(text)
        is_damage = record.name.startswith('lava_ros.bag') and record.levelno >= logging.WARNING
        self.has_warned = self.has_warned or is_damage


if __name__ == '__main__':
    sys.exit(main())
