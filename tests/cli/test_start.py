# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The start of a command, which Ctrl+C ends without a traceback, and its end."""

import subprocess
import sys

import pytest

import lava_ros
from project import PROJECT

#: Starts a program as its script does, and interrupts it at the import of a module.
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
PROGRAMS = {name: script.split(':') for name, script in PROJECT['scripts'].items()}


def interrupted(
    program: str, *words: str, module: str, handler: str = 'default_int_handler'
) -> subprocess.CompletedProcess[str]:
    """Run an installed program that gets a SIGINT when it imports a module."""
    start, function = PROGRAMS[program]
    code = SCRIPT.format(
        module=module, argv=[program, *words], start=start, function=function, handler=handler,
    )
    return subprocess.run(
        [sys.executable, '-c', code], capture_output=True, text=True, check=False
    )


@pytest.mark.parametrize(('words', 'module'), [
    (['lava', '--help'], 'lava_ros.cli.main'),
    (['lava', '--help'], 'argparse'),
    # imports of the command itself
    (['lava', 'info', 'none'], 'mcap'),
    (['lava_node'], 'rclpy'),
])
def test_program_interrupted_at_its_start_prints_nothing(words: list[str], module: str) -> None:
    done = interrupted(*words, module=module)
    assert (done.stdout, done.stderr, done.returncode) == ('interrupted\n', '', 130)


def test_signal_ignored_by_nohup_stays_ignored() -> None:
    done = interrupted('lava', '--version', module='lava_ros.cli.main', handler='SIG_IGN')
    assert done.returncode == 0
    assert done.stdout.startswith('interrupted\nlava_ros ')


#: Starts a program as its script does, without a package.
WITHOUT = """
import sys
sys.modules[{package!r}] = None
sys.argv = {argv!r}
from {start} import {function}
sys.exit({function}())
"""


@pytest.mark.parametrize(('words', 'package'), [
    (['lava_node'], 'warp'),
    (['lava_node'], 'rclpy'),
    (['lava_node'], 'yaml'),
    (['lava_node'], 'nav_msgs'),
    (['lava', 'info', 'none'], 'mcap'),
    (['lava', 'demo'], 'numpy'),
])
def test_program_names_a_missing_package_in_one_sentence(words: list[str], package: str) -> None:
    start, function = PROGRAMS[words[0]]
    code = WITHOUT.format(package=package, argv=words, start=start, function=function)
    done = subprocess.run(
        [sys.executable, '-c', code], capture_output=True, text=True, check=False
    )
    (sentence,) = done.stderr.splitlines()
    assert sentence.startswith(f'{words[0]}: the Python package {package}')
    assert f'is not installed for {sys.executable}; docs/install.md' in sentence
    assert (done.stdout, done.returncode) == ('', 2)


def test_program_raises_for_a_missing_module_of_its_own() -> None:
    code = WITHOUT.format(
        package='lava_ros.cli.main', argv=['lava'], start='lava_ros.cli.start', function='lava'
    )
    done = subprocess.run(
        [sys.executable, '-c', code], capture_output=True, text=True, check=False
    )
    assert 'Traceback' in done.stderr and done.returncode == 1


#: Leaves an object that only a search for garbage finds.
GARBAGE = """
import sys
from lava_ros.cli.start import lava

class Cycle:
    def __init__(self):
        self.own = self
    def __del__(self):
        print('found')

sys.argv = ['lava', '--version']
try:
    lava()
finally:
    Cycle()
"""


def test_end_of_a_program_does_not_search_for_garbage() -> None:
    run = [sys.executable, '-c', GARBAGE]
    done = subprocess.run(run, capture_output=True, text=True, check=True)
    assert done.stdout == f'lava_ros {lava_ros.__version__}\n'
