# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Installs the package into an empty environment, and runs its node outside the checkout.

Run by ``make nightly``; takes a minute or two, most of it for pip.
"""

import json
import os
from pathlib import Path
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import venv

from ros_domain import own_domain

ROOT = Path(__file__).parents[2]
ASIDE = ('.git', '.venv', 'build', 'install', 'log', '*.egg-info', '__pycache__', 'bags')

#: Maximum time until the first map: the solver is compiled, on a busy machine [s].
PATIENCE = 300.0

TERRAIN = """
import numpy as np
_, x = np.mgrid[0:20, 0:30]
np.savez('slope.npz', elevation=(300.0 - x).astype(np.float32), resolution=10.0)
"""


def install(folder):
    """Make an environment with the package and its ROS requirements; return its programs."""
    source, home = folder / 'source', folder / 'venv'
    shutil.copytree(ROOT, source, ignore=shutil.ignore_patterns(*ASIDE))
    venv.create(home, with_pip=True)
    options = ['--quiet', '--disable-pip-version-check', '--constraint', 'constraints.txt']
    pip = [str(home / 'bin' / 'python'), '-m', 'pip', 'install', *options]
    subprocess.run([*pip, '.[ros]'], cwd=source, check=True)
    shutil.rmtree(source)
    return home / 'bin'


def check(programs, folder):
    """Run the node in a folder: it must publish, record, and end on SIGINT with status 0."""
    environment = {key: text for key, text in os.environ.items() if key != 'PYTHONPATH'}
    environment['ROS_DOMAIN_ID'] = str(own_domain())
    environment['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    python = str(programs / 'python')
    subprocess.run([python, '-c', TERRAIN], cwd=folder, check=True)
    words = ('terrain_file:=slope.npz', 'device:=cpu', 'record:=true', 'bag_directory:=bag')
    parameters = [word for text in words for word in ('-p', text)]
    node = subprocess.Popen(
        [str(programs / 'lava_node'), '--ros-args', *parameters], cwd=folder, env=environment
    )
    listener = subprocess.Popen(
        [python, str(ROOT / 'tests/ros/graph_listener.py'), 'height'], cwd=folder, env=environment,
        stdout=subprocess.PIPE, text=True,
    )
    timer = threading.Timer(PATIENCE, listener.kill)
    timer.start()
    try:
        # the timer ends a listener that takes too long
        maps = (item for item in map(json.loads, listener.stdout) if item['topic'] == 'height')
        assert next(maps)['shape'] == [20, 30]
        node.send_signal(signal.SIGINT)
        assert node.wait(30.0) == 0
        assert (folder / 'bag' / 'metadata.yaml').exists()
    finally:
        timer.cancel()
        for process in (listener, node):
            process.kill()
            process.wait()


def main():
    """Install the package and run its node."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        programs = install(folder)
        (folder / 'elsewhere').mkdir()
        check(programs, folder / 'elsewhere')
    print('installed, published, recorded and ended on SIGINT')


if __name__ == '__main__':
    sys.exit(main())
