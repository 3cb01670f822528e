# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Runs what the Dockerfile runs, as far as it can be without Docker; with a daemon, builds it.

Run by ``make nightly``; takes some minutes, most of them pip's. Steps that call apt-get need the
image's own system and are left out without a daemon; ROS then is that of the wheels.
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

#: What the image has to answer, and what is in the answer.
QUESTIONS = ((['--version'], 'lava_ros '), (['demo', '--help'], 'usage: lava demo'))


def instructions(path=ROOT / 'Dockerfile'):
    """The instructions of a Dockerfile in order: (RUN, its words), continued lines joined."""
    lines = [line for line in path.read_text(encoding='utf-8').splitlines() if line[:1] != '#']
    joined = '\n'.join(lines).replace('\\\n', ' ')
    return [tuple(line.split(None, 1)) for line in joined.splitlines() if line.strip()]


def copy_context(folder):
    """Copy what Docker would be sent: the checkout without what .dockerignore names."""
    lines = (ROOT / '.dockerignore').read_text(encoding='utf-8').split()
    patterns = [line.removeprefix('**/') for line in lines]
    shutil.copytree(ROOT, folder, ignore=shutil.ignore_patterns(*patterns))


def run_here(folder):
    """Run the steps with their paths inside a folder; return the command that it starts."""
    copy_context(folder / 'src')
    found = instructions()
    for step in (text for kind, text in found if kind == 'RUN' and 'apt-get' not in text):
        here = re.sub(r'(?<=[\s\'])(/src|/opt)', rf'{folder}\1', step.replace('rm -rf', 'ls'))
        subprocess.run(['bash', '-euc', here], check=True, stdout=subprocess.DEVNULL)
    (entry,) = (json.loads(text) for kind, text in found if kind == 'ENTRYPOINT')
    return [str(folder / 'opt/lava/bin' / entry[-1])]


def main():
    """Build or install, ask, say so."""
    has_docker = shutil.which('docker') and subprocess.run(['docker', 'info'], capture_output=True)
    with tempfile.TemporaryDirectory() as name:
        if has_docker and has_docker.returncode == 0:
            subprocess.run(['docker', 'build', '--tag', 'lava_ros:nightly', ROOT], check=True)
            command, what = ['docker', 'run', '--rm', 'lava_ros:nightly'], 'image built'
        else:
            command, what = run_here(Path(name)), 'no Docker daemon: its pip step ran here'
        environment = {key: text for key, text in os.environ.items() if key != 'PYTHONPATH'}
        for words, expected in QUESTIONS:
            answer = subprocess.run(
                [*command, *words], check=True, capture_output=True, text=True, env=environment
            )
            assert expected in answer.stdout, answer.stdout
    print(f'{what}; lava answers')


if __name__ == '__main__':
    sys.exit(main())
