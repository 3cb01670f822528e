# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Builds the package with colcon in an empty workspace, and runs its node from there.

Run by ``make colcon`` with colcon in the Python path; takes half a minute. The node is started as
``ros2 run`` starts it. Where ros2 is installed, ``ros2 run`` and ``ros2 launch`` start it as well.
"""

from pathlib import Path
import shutil
import subprocess
import sys
import tempfile

from install.installed_node import ARGUMENTS, check, copy_checkout, outside, PARAMETERS


def build(workspace, *options):
    """Build the package in a workspace; return the variables of a shell that sources it."""
    copy_checkout(workspace / 'src' / 'lava_ros')
    done = subprocess.run(
        [sys.executable, '-m', 'colcon', 'build', *options], cwd=workspace, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False,
    )
    assert done.returncode == 0 and '1 package finished' in done.stdout, done.stdout
    sourced = subprocess.run(
        ['bash', '-c', 'source install/setup.bash && env -0'], cwd=workspace, env=outside(),
        stdout=subprocess.PIPE, text=True, check=True,
    )
    variables = dict(item.split('=', 1) for item in sourced.stdout.split('\0') if item)
    place = subprocess.run(
        [sys.executable, '-c', 'import lava_ros; print(lava_ros.__file__)'], cwd='/',
        env=variables, stdout=subprocess.PIPE, text=True, check=True,
    )
    assert Path(place.stdout.strip()).is_relative_to(workspace), place.stdout
    return variables


def commands(workspace):
    """Return the commands that start the node of a workspace."""
    program = workspace / 'install/lava_ros/lib/lava_ros/lava_node'
    found = [[str(program), *ARGUMENTS]]
    if shutil.which('ros2'):
        found.append(['ros2', 'run', 'lava_ros', 'lava_node', *ARGUMENTS])
        found.append(['ros2', 'launch', 'lava_ros', 'lava.launch.py', *PARAMETERS])
    return found


def main():
    """Build with and without links, and run the node."""
    for options in ([], ['--symlink-install']):
        with tempfile.TemporaryDirectory() as name:
            workspace = Path(name).resolve() / 'workspace'
            variables = build(workspace, *options)
            for number, command in enumerate(commands(workspace)):
                check(command, sys.executable, Path(name) / str(number), variables)
                words = ' '.join(command[:4])
                print(f'colcon build {" ".join(options)}: {words}: published and recorded')


if __name__ == '__main__':
    sys.exit(main())
