# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Installs the package into an empty environment, and runs its node outside the checkout.

Run by ``make nightly``; takes a minute or two, most of it for pip.
"""

from contextlib import suppress
from functools import partial
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

import ros_domain

ROOT = Path(__file__).parents[2]
ASIDE = ('.git', '.venv', 'build', 'install', 'log', '*.egg-info', '__pycache__', 'bags')

#: Maximum time until the first map, and from SIGINT to the end: the solver is compiled, on a busy
#: machine [s].
PATIENCE = 300.0

TERRAIN = """
import numpy as np
_, x = np.mgrid[0:20, 0:30]
np.savez('slope.npz', elevation=(300.0 - x).astype(np.float32), resolution=10.0)
"""

#: Parameters of the node.
PARAMETERS = (
    'terrain_file:=slope.npz', 'device:=cpu', 'record:=true', 'bag_directory:=bag',
)

#: Arguments of ``lava_node`` with these parameters.
ARGUMENTS = ['--ros-args', *(word for text in PARAMETERS for word in ('-p', text))]


def copy_checkout(folder):
    """Copy the files of the checkout without built files, as a clone has them."""
    shutil.copytree(ROOT, folder, ignore=shutil.ignore_patterns(*ASIDE))


def install(folder, *requirements):
    """Make an environment with the package as pip's requirements name it; return its programs."""
    source, home = folder / 'source', folder / 'venv'
    copy_checkout(source)
    venv.create(home, with_pip=True)
    options = ['--quiet', '--disable-pip-version-check', '--constraint', 'constraints.txt']
    pip = [str(home / 'bin' / 'python'), '-m', 'pip', 'install', *options]
    # a network of the tests has no registry
    ros_domain.outside(partial(subprocess.run, [*pip, *requirements], cwd=source, check=True))
    shutil.rmtree(source)
    return home / 'bin'


def outside():
    """Return the variables of a shell that does not know the checkout, in a ROS domain."""
    path = filter(None, os.environ.get('PYTHONPATH', '').split(os.pathsep))
    others = [item for item in path if not Path(item).resolve().is_relative_to(ROOT)]
    return os.environ | {
        'PYTHONPATH': os.pathsep.join(others), 'ROS_DOMAIN_ID': str(ros_domain.own_domain()),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
    }


def check(command, python, folder, environment):
    """Run a node in a folder: it must publish, record, and end on Ctrl+C with status 0.

    ``command`` starts the node, by itself or as its child, with ``PARAMETERS``.
    """
    folder.mkdir()
    subprocess.run([python, '-c', TERRAIN], cwd=folder, check=True)
    node = subprocess.Popen(command, cwd=folder, env=environment, start_new_session=True)
    listener = subprocess.Popen(
        [python, str(ROOT / 'tests/ros/graph_listener.py'), 'height'], cwd=folder, env=environment,
        stdout=subprocess.PIPE, text=True,
    )
    timer = threading.Timer(PATIENCE, listener.kill)
    timer.start()
    threading.Thread(target=lambda: (node.wait(), listener.kill()), daemon=True).start()
    try:
        # a listener that takes too long is ended, and so is that of a node that has ended
        maps = (item for item in map(json.loads, listener.stdout) if item['topic'] == 'height')
        assert next(maps)['shape'] == [20, 30]
        # a terminal sends Ctrl+C to all processes of a command
        os.killpg(node.pid, signal.SIGINT)
        assert node.wait(PATIENCE) == 0
        assert (folder / 'bag' / 'metadata.yaml').exists()
    finally:
        timer.cancel()
        listener.kill()
        listener.wait()
        with suppress(ProcessLookupError):
            os.killpg(node.pid, signal.SIGKILL)
        node.wait()


def main():
    """Install the package and run its node."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        programs = install(folder, '.[ros]')
        command = [str(programs / 'lava_node'), *ARGUMENTS]
        check(command, str(programs / 'python'), folder / 'elsewhere', outside())
    print('installed, published, recorded and ended on SIGINT')


if __name__ == '__main__':
    sys.exit(main())
