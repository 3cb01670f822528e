# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

# PYTHON_ARGCOMPLETE_OK
"""Entry points `lava` and `lava_node`, which Ctrl+C during start-up ends quietly."""

import atexit
import gc
from importlib import import_module
import os
from pathlib import Path
import signal
import sys
from types import FrameType

#: New objects between two collections of garbage. Imported modules are some 500,000 that stay:
#: with Python's 700 they are visited again and again, for a third of the time of the imports.
_NEW_OBJECTS = 10_000

#: Exit status after Ctrl+C, as in shells.
INTERRUPTED = 128 + signal.SIGINT

#: Exit status if a required package or library is missing, as for other errors of usage.
USAGE_ERROR = 2


def lava() -> int:
    """Run the command line, and return its exit status."""
    return _run('lava_ros.cli.main')


def lava_node() -> int:
    """Run the node, and return its exit status."""
    return _run('lava_ros.ros.node')


def end_start() -> None:
    """Let Ctrl+C raise KeyboardInterrupt from now on; until now it ends the process quietly."""
    if signal.getsignal(signal.SIGINT) is _leave:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _run(module: str) -> int:
    # leave the signal ignored under nohup
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _leave)
    gc.set_threshold(_NEW_OBJECTS)
    # otherwise the end of the process searches all objects for garbage, for half a second
    atexit.register(gc.freeze)
    try:
        return int(import_module(module).main())
    except Exception as error:
        # this may be the first import of the package
        from lava_ros.errors import import_failure

        sentence = import_failure(error)
        if sentence is None:
            raise
        print(f'{Path(sys.argv[0]).name}: {sentence}', file=sys.stderr)
        return USAGE_ERROR


def _leave(number: int, _: FrameType | None) -> None:
    # libraries turn a KeyboardInterrupt during their import into errors, or print it
    os._exit(INTERRUPTED)
