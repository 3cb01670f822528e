# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The command line `lava`."""

from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout
import errno
import logging
import os
import re
import sys

from lava_ros.cli.console import check_outputs, Printable
from lava_ros.cli.parser import (
    as_typed,
    command_line_parser,
    command_of,
    parse_command_line,
    ROS_COMMANDS,
)
from lava_ros.cli.start import end_start, INTERRUPTED
from lava_ros.errors import LavaError, printable

#: Exit status for invalid input, as in argparse.
USAGE_ERROR = 2

#: Exit status of a command that has read a damaged or incomplete bag.
DAMAGED = 1

#: Error numbers of a full disk, an exhausted quota and a file beyond the limit of the shell.
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)

_ROS_ARGS = '--ros-args'


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command of arguments without the program's name; None for those of the process.

    Returns:
        The exit status: 0 for success, 1 if part of a bag was damaged or missing without
        --incomplete, 2 for invalid input.
    """
    if '_ARGCOMPLETE' in os.environ:
        _complete()
    arguments = list(sys.argv[1:] if argv is None else argv)
    # a space keeps argparse from reading a value that begins with a minus as an option
    arguments = [f' {word}' if re.match(r'-\.?\d', word) else word for word in arguments]
    # ROS reads everything after --ros-args
    end = len(arguments)
    if command_of(arguments) in ROS_COMMANDS and _ROS_ARGS in arguments:
        end = arguments.index(_ROS_ARGS)
    with redirect_stderr(Printable(sys.stderr)):
        _check_encoding(arguments)
        args = parse_command_line(arguments[:end])
    args.ros_args = arguments[end:]
    handler = _StderrLogHandler(args.command)
    log = logging.getLogger('lava_ros')
    log.addHandler(handler)
    level = log.level
    log.setLevel(logging.INFO)
    try:
        out = Printable(sys.stdout)
        if getattr(args, 'json', None) == '-':
            # a program that reads JSON from stdout must find nothing else there
            out = Printable(sys.stderr, data=out)  # type: ignore[arg-type]
        with redirect_stdout(out), redirect_stderr(Printable(sys.stderr)):
            end_start()
            check_outputs(args)
            status = int(args.run(args))
            is_accepted = getattr(args, 'incomplete', False)
            return status or (DAMAGED if handler.has_warned and not is_accepted else 0)
    except LavaError as error:
        problem = str(as_typed(error, args))
    except MemoryError as error:
        problem = f'no memory is left: {printable(str(error))}'
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:
        # the reader of stdout has ended: keep Python from flushing to it at exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except OSError as error:
        if error.errno not in _FULL:
            raise
        problem = f'no room is left: {printable(str(error))}'
    finally:
        log.removeHandler(handler)
        log.setLevel(level)
    print(f'lava {args.command}: {problem}', file=sys.stderr)
    return USAGE_ERROR


def _complete() -> None:
    import argcomplete

    argcomplete.autocomplete(command_line_parser())


def _check_encoding(words: Sequence[str]) -> None:
    """Exit with status 2 if an argument is not valid UTF-8."""
    for word in words:
        try:
            word.encode()
        except UnicodeEncodeError:
            wrong = LavaError('an argument', word, 'text in UTF-8')
            command_line_parser().error(str(wrong))


class _StderrLogHandler(logging.Handler):
    """Prints each log message of the package once; ``has_warned`` is True after bag damage."""

    def __init__(self, command: str) -> None:
        super().__init__()
        self.has_warned = False
        self._command = command
        self._known: set[str] = set()

    def emit(self, record: logging.LogRecord) -> None:
        # one line, so that it fits above a progress bar
        text = printable(' '.join(record.getMessage().split()))
        if text not in self._known:
            print(f'lava {self._command}: {text}', file=sys.stderr)
        self._known.add(text)
        is_damage = record.name.startswith('lava_ros.bag') and record.levelno >= logging.WARNING
        self.has_warned = self.has_warned or is_damage


if __name__ == '__main__':
    sys.exit(main())
