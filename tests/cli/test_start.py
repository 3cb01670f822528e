# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Ctrl+C while a command starts: no traceback, whatever is being imported."""

from pathlib import Path
import re
import subprocess
import sys

import pytest

from lava_ros.cli.manual import COMMANDS

#: Starts a program as its script does, and interrupts it as it begins to import a module.
SCRIPT = """
import importlib, os, signal, sys

class Interrupter:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            print('interrupted')
            sys.stdout.flush()
            os.kill(os.getpid(), signal.SIGINT)

signal.signal(signal.SIGINT, signal.{handler})
sys.meta_path.insert(0, Interrupter())
sys.argv = {argv!r}
from {start} import {function}
sys.exit({function}())
"""

#: Module and function of each program that pip installs.
PROGRAMS = {
    name: (f'lava_ros.{module}', function)
    for name, module, function in re.findall(
        r"f'(\w+) = \{NAME\}\.([\w.]+):(\w+)'",
        (Path(__file__).parents[2] / 'setup.py').read_text(encoding='utf-8'),
    )
}


def interrupted(
    program: str, *words: str, module: str, handler: str = 'default_int_handler'
) -> subprocess.CompletedProcess[str]:
    """Run an installed program that gets a SIGINT when it imports a module."""
    start, function = PROGRAMS[program]
    code = SCRIPT.format(
        module=module, argv=[program, *words], start=start, function=function,
        handler=handler,
    )
    return subprocess.run(
        [sys.executable, '-c', code], capture_output=True, text=True, check=False
    )


@pytest.mark.parametrize(
    ('words', 'module'),
    [
        (['lava', '--help'], 'lava_ros.cli.main'),
        (['lava', '--help'], 'argparse'),
        *((['lava', name], f'lava_ros.cli.{module}') for name, module in COMMANDS.items()),
        # its own imports, when the command has begun
        (['lava', 'completion', 'bash'], 'shtab'),
        (['lava_node'], 'lava_ros.ros.node'),
        (['lava_node'], 'rclpy'),
        (['lava_node'], 'numpy'),
    ],
)
def test_a_program_that_is_interrupted_as_it_starts_says_nothing(
    words: list[str], module: str
) -> None:
    """It ends with the status of Ctrl+C."""
    done = interrupted(*words, module=module)
    assert (done.stdout, done.stderr, done.returncode) == ('interrupted\n', '', 130)


def test_an_ignored_signal_stays_ignored() -> None:
    """Nohup, and shells in the background, make programs ignore Ctrl+C."""
    done = interrupted('lava', '--version', module='lava_ros.cli.main', handler='SIG_IGN')
    assert done.returncode == 0
    assert done.stdout.startswith('interrupted\nlava_ros ')


def test_both_programs_are_looked_at() -> None:
    """The package installs no other."""
    assert set(PROGRAMS) == {'lava', 'lava_node'}
