# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The start of a command, which Ctrl+C ends without a traceback, and its end."""

from importlib.machinery import EXTENSION_SUFFIXES
import os
from pathlib import Path
import subprocess
import sys

import pytest

import lava_ros
from project import PROJECT

ROOT = Path(__file__).parents[2]

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
    (['lava', 'bag', 'info', 'none'], 'mcap'),
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
    (['lava', 'bag', 'info', 'none'], 'mcap'),
    (['lava', 'ros', 'demo'], 'numpy'),
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


#: Starts a program as its script does, with a module that cannot be loaded.
BROKEN = """
import sys

class Loader:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            raise {error}

sys.meta_path.insert(0, Loader())
sys.argv = {argv!r}
from {start} import {function}
sys.exit({function}())
"""

NO_FILE = 'libnone.so.7: cannot open shared object file: No such file or directory'

#: Of rclpy, which adds further lines to the message.
OF_RCLPY = f'{NO_FILE}\nThe C extension was present'

#: Messages of the loader of shared libraries.
LOADER = [
    NO_FILE, '/opt/ros/libnone.so: undefined symbol: rcl_init',
    "/lib/libnone.so.6: version `GLIBC_2.99' not found (required by /opt/ros/lib/librcl.so)",
]


def started(module: str, error: str, *words: str) -> subprocess.CompletedProcess[str]:
    """Run a program in which the import of a module raises an error."""
    start, function = PROGRAMS[words[0]]
    code = BROKEN.format(
        module=module, error=error, argv=list(words), start=start, function=function
    )
    return subprocess.run(
        [sys.executable, '-c', code], capture_output=True, text=True, check=False
    )


@pytest.mark.parametrize(('words', 'module', 'error'), [
    (['lava_node'], 'rclpy._rclpy_pybind11', f'ImportError({OF_RCLPY!r})'),
    *((['lava_node'], 'rclpy', f'ImportError({text!r})') for text in LOADER),
    # the messages of the node's base class
    (['lava_node'], 'lifecycle_msgs.lifecycle_msgs_s__rosidl_typesupport_c',
     f'ImportError({NO_FILE!r})'),
    # of ctypes
    (['lava_node'], 'warp', f'OSError({NO_FILE!r})'),
    (['lava', 'ros', 'replay', str(ROOT / 'bags/sample')], 'rclpy._rclpy_pybind11',
     f'ImportError({OF_RCLPY!r})'),
    (['lava', 'bag', 'info', 'none'], 'zstandard', f'ImportError({NO_FILE!r})'),
])
def test_program_names_a_shared_library_that_cannot_be_loaded(
    words: list[str], module: str, error: str
) -> None:
    done = started(module, error, *words)
    (sentence,) = done.stderr.splitlines()
    library, _, reason = error.partition('(')[2][1:-2].partition('\\n')[0].partition(': ')
    about = f'{words[0]}: the shared library {library} cannot be loaded for {sys.executable}'
    assert sentence.startswith(f'{about} ({reason})')
    assert 'source the setup file of ROS 2 in this shell; docs/install.md' in sentence
    assert (done.stdout, done.returncode) == ('', 2)


def test_node_names_a_library_of_messages_that_cannot_be_loaded() -> None:
    done = started(
        'nav_msgs.nav_msgs_s__rosidl_typesupport_c', f'ImportError({NO_FILE!r})', 'lava_node'
    )
    last = done.stderr.splitlines()[-1]
    assert 'Traceback' not in done.stderr and done.returncode == 1
    assert last.startswith('lava_node cannot start: the shared library libnone.so.7 cannot be ')


@pytest.mark.parametrize('error', [
    'ImportError("cannot import name x from rclpy")', 'OSError(5, "Input/output error")',
    'ValueError("libnone.so: cannot open")',
])
def test_program_raises_for_other_errors_of_an_import(error: str) -> None:
    done = started('rclpy', error, 'lava_node')
    assert 'Traceback' in done.stderr and done.returncode == 1


def test_library_that_is_no_library_is_named(tmp_path: Path) -> None:
    suffix = EXTENSION_SUFFIXES[0]
    (tmp_path / 'rclpy').mkdir()
    (tmp_path / 'rclpy/__init__.py').write_text('from rclpy import _own')
    (tmp_path / f'rclpy/_own{suffix}').touch()
    done = subprocess.run(
        [sys.executable, '-c', 'import sys; from lava_ros.cli.start import lava_node as run; '
         'sys.exit(run())'],
        env={**os.environ, 'PYTHONPATH': f'{tmp_path}:{os.environ.get("PYTHONPATH", "")}'},
        capture_output=True, text=True, check=False,
    )
    (sentence,) = done.stderr.splitlines()
    assert f'library {tmp_path}/rclpy/_own{suffix} cannot be loaded' in sentence
    assert '(file too short)' in sentence and done.returncode == 2


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
