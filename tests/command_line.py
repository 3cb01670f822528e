# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The command line, called by tests of several rooms."""

import argparse
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO

from lava_ros.cli.main import main
from lava_ros.cli.parser import command_line_parser, COMMANDS


def lava(*words: object) -> tuple[int, str, str]:
    """Call the command line; return its exit status, stdout and stderr.

    The first argument may be a command of two words.
    """
    arguments = [str(word) for word in words]
    if arguments and arguments[0] in COMMANDS:
        arguments[:1] = arguments[0].split()
    with redirect_stdout(StringIO()) as out, redirect_stderr(StringIO()) as err:
        try:
            status = main(arguments)
        except SystemExit as end:
            status = int(str(end.code))
    return status, out.getvalue(), err.getvalue()


def done(*words: object) -> str:
    """Return the output of a command that must succeed."""
    status, out, err = lava(*words)
    assert status == 0, err
    return out


def refused(*words: object) -> str:
    """Return the error message of a command with unusable input, its only output."""
    status, out, err = lava(*words)
    assert (status, out) == (2, ''), out + err
    return err


def parser_of(command: str) -> argparse.ArgumentParser:
    """Return the parser of a command."""
    return command_line_parser().commands[command]
