# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The command line, called by tests of several rooms."""

from contextlib import redirect_stderr, redirect_stdout
from io import StringIO

from lava_ros.cli.main import main


def lava(*words: object) -> tuple[int, str, str]:
    """Call the command line: its exit status, what it prints, what it says on stderr."""
    with redirect_stdout(StringIO()) as out, redirect_stderr(StringIO()) as err:
        try:
            status = main([str(word) for word in words])
        except SystemExit as end:
            status = int(str(end.code))
    return status, out.getvalue(), err.getvalue()
