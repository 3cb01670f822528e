# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Builds the image of the Dockerfile; without a Docker daemon, runs its steps in a folder.

Run by ``make nightly``; takes some minutes, most of them for pip. Without a daemon the steps that
call apt-get are left out, and ROS comes from the wheels.
"""

import json
import os
from pathlib import Path
import re
import shutil
import subprocess
import sys
import tempfile

ROOT = Path(__file__).parents[2]

#: Arguments for the program of the image, and text that its output contains.
QUESTIONS = ((['--version'], 'lava_ros '), (['ros', 'demo', '--help'], 'usage: lava ros demo'))


def instructions(path=ROOT / 'Dockerfile'):
    """Return the instructions of a Dockerfile as (RUN, words), with continued lines joined."""
    lines = [line for line in path.read_text(encoding='utf-8').splitlines() if line[:1] != '#']
    joined = '\n'.join(lines).replace('\\\n', ' ')
    return [tuple(line.split(None, 1)) for line in joined.splitlines() if line.strip()]


def copy_context(folder):
    """Copy the build context: the checkout without the files that .dockerignore names."""
    lines = (ROOT / '.dockerignore').read_text(encoding='utf-8').split()
    patterns = [line.removeprefix('**/') for line in lines]
    shutil.copytree(ROOT, folder, ignore=shutil.ignore_patterns(*patterns))


def run_here(folder):
    """Run the steps with their paths inside a folder; return the command of the image."""
    copy_context(folder / 'src')
    found = instructions()
    for step in (text for kind, text in found if kind == 'RUN' and 'apt-get' not in text):
        here = re.sub(r'(?<=[\s\'])(/src|/opt)', rf'{folder}\1', step.replace('rm -rf', 'ls'))
        subprocess.run(['bash', '-euc', here], check=True, stdout=subprocess.DEVNULL)
    (entry,) = (json.loads(text) for kind, text in found if kind == 'ENTRYPOINT')
    return [str(folder / 'opt/lava/bin' / entry[-1])]


def main():
    """Build or install, then call the program."""
    has_docker = shutil.which('docker') and subprocess.run(['docker', 'info'], capture_output=True)
    with tempfile.TemporaryDirectory() as name:
        if has_docker and has_docker.returncode == 0:
            subprocess.run(['docker', 'build', '--tag', 'lava_ros:nightly', ROOT], check=True)
            command, outcome = ['docker', 'run', '--rm', 'lava_ros:nightly'], 'image built'
        else:
            command, outcome = run_here(Path(name)), 'no Docker daemon: its pip step ran here'
        environment = {key: text for key, text in os.environ.items() if key != 'PYTHONPATH'}
        for words, expected in QUESTIONS:
            answer = subprocess.run(
                [*command, *words], check=True, capture_output=True, text=True, env=environment
            )
            assert expected in answer.stdout, answer.stdout
    print(f'{outcome}; lava answers')


if __name__ == '__main__':
    sys.exit(main())
