# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Fixtures for processes in the ROS graph of a test run, and for nodes in the test's process."""

from contextlib import contextmanager
import json
import logging
import os
from pathlib import Path
import queue
import signal
import subprocess
import sys
import threading
import time

import pytest

from ros.graph_publisher import Publisher
from ros.hearing import Hearing
from ros_domain import own_domain
from waiting import PATIENCE

HERE = Path(__file__).parent
ROOT = HERE.parents[1]

#: Runs the node, or the module's ``main``, with five heartbeats per second to shorten waits.
QUICK_MODULE = """
from lava_ros.ros import runtime
from lava_ros.{} import main
runtime.HEARTBEAT = 0.2
raise SystemExit(main())
"""
QUICK = QUICK_MODULE.format('ros.node')

#: Maximum wait for a process to end before it is killed [s].
GRACE = 5.0


class Process:
    """A child process whose output is read line by line."""

    def __init__(self, directory, arguments):
        path = [str(ROOT), *filter(None, [os.environ.get('PYTHONPATH')])]
        self.environment = {
            **os.environ, 'ROS_DOMAIN_ID': str(own_domain()), 'PYTHONUNBUFFERED': '1',
            'PYTHONPATH': os.pathsep.join(path),
        }
        self.child = subprocess.Popen(
            [sys.executable, *arguments], cwd=directory, env=self.environment,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )
        self.errors = []
        self._lines = queue.Queue()
        self._readers = []
        for stream, keep in (
            (self.child.stdout, self._lines.put),
            (self.child.stderr, self.errors.append),
        ):
            reader = threading.Thread(target=self._read, args=(stream, keep), daemon=True)
            reader.start()
            self._readers.append(reader)

    @staticmethod
    def _read(stream, keep):
        for line in stream:
            keep(line.rstrip('\n'))

    @property
    def log(self):
        return '\n'.join(self.errors)

    def line(self, timeout):
        end = time.monotonic() + timeout
        while True:
            ended = self.child.poll() is not None
            try:
                return self._lines.get(timeout=min(1.0, max(0.0, end - time.monotonic())))
            except queue.Empty:
                if ended or time.monotonic() >= end:
                    what = f'silent for {timeout} s, exit code {self.child.returncode}'
                    raise AssertionError(f'{what}; stderr:\n{self.log}') from None

    def wait_for_log(self, text, timeout=PATIENCE, *, after=0):
        """Wait until a text is in the log after position ``after``; the pipe may lag."""
        end = time.monotonic() + timeout
        while text not in self.log[after:]:
            assert self.child.poll() is None and time.monotonic() < end, self.log
            time.sleep(0.05)

    def wait_for_end(self, timeout=PATIENCE):
        """Return the exit code, once the process has ended and its output has been read."""
        code = self.child.wait(timeout)
        for reader in self._readers:
            reader.join(timeout)
        return code

    def end(self, number=signal.SIGTERM, timeout=PATIENCE):
        if self.child.poll() is None:
            self.child.send_signal(number)
        try:
            return self.wait_for_end(timeout)
        except subprocess.TimeoutExpired:
            self.child.kill()
            self.child.wait()
            raise


class Listener(Process, Hearing):
    """A process that reports what the node publishes."""

    def __init__(self, directory, *topics, program='graph_listener.py'):
        super().__init__(directory, [str(HERE / program), *topics])
        self.seen = []

    def next(self, timeout):
        return json.loads(self.line(timeout))

    def hear(self):
        while not self._lines.empty():
            self.seen.append(json.loads(self.line(1.0)))
        return len(self.seen)


class Graph:
    """Starts processes in one graph.

    Attributes:
        directory: Working directory of the processes.
    """

    def __init__(self, directory):
        self.directory = directory
        self._started, self._publishers = [], []

    def _start(self, kind, *arguments, **options):
        process = kind(self.directory, *arguments, **options)
        self._started.append(process)
        return process

    def node(self, *, program=('-c', QUICK), remap=(), **parameters):
        """Start a node with parameters and five maps a second; ``program`` replaces the node."""
        often = self.directory / 'often.yaml'
        default = (ROOT / 'msg_configs/default.yaml').read_text(encoding='utf-8')
        often.write_text(default.replace('rate: 1.0 ', 'rate: 5.0 '), encoding='utf-8')
        words = [word for rule in remap for word in ('-r', rule)]
        for name, value in {'msg_config': str(often), **parameters}.items():
            words += ['-p', f'{name}:={json.dumps(value)}']
        return self.process(*program, '--ros-args', *words)

    def publisher(self):
        self._publishers.append(Publisher(own_domain()))
        return self._publishers[-1]

    def listener(self, *topics):
        return self._start(Listener, *topics)

    def comparison(self, mask, *costmaps):
        """Start a robot that compares its costmaps with its map and with a mask."""
        return self._start(Listener, mask, *costmaps, program='graph_costmap.py')

    def process(self, *arguments):
        return self._start(Process, arguments)

    @property
    def logs(self):
        """Return the command and the end of stderr of each process."""
        for process in self._started:
            yield ' '.join(process.child.args[1:3]), process.log[-5000:]

    def close(self):
        for process in self._started:
            process.child.stdin.close()
            process.child.terminate()
        while self._started:
            process = self._started.pop()
            try:
                process.wait_for_end(GRACE)
            except subprocess.TimeoutExpired:
                process.end(signal.SIGKILL)
        while self._publishers:
            self._publishers.pop().close()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item):
    """Add the logs of the graph's processes to a failure."""
    report = yield
    for value in getattr(item, 'funcargs', {}).values():
        graph = getattr(value, 'graph', value)
        if report.failed and hasattr(graph, 'logs'):
            report.sections += [(f'stderr of {name}', log) for name, log in graph.logs if log]
    return report


@pytest.fixture
def graph(tmp_path_factory):
    result = Graph(tmp_path_factory.mktemp('graph'))
    yield result
    result.close()


@contextmanager
def local_nodes(directory, domain):
    """Give a function that starts nodes in the process of the test."""
    from ros.local_node import LocalNode

    nodes = []
    with pytest.MonkeyPatch.context() as patch:

        def start(**options):
            nodes.append(LocalNode(directory, patch, domain=domain, **options))
            return nodes[-1]

        yield start
        for node in nodes:
            node.close()


@pytest.fixture
def local(tmp_path):
    with local_nodes(tmp_path, 'local') as start:
        yield start


@pytest.fixture(scope='module')
def module_local(tmp_path_factory):
    """Do as ``local`` for nodes that all tests of a module share."""
    with local_nodes(tmp_path_factory.mktemp('local'), 'module') as start:
        yield start


def start_flow(local, **parameters):
    """Start an active node with a slope, a vent and lava."""
    node = local(**parameters)
    assert node.change('configure') and node.change('activate'), node.log
    # the vents come first: they wait for the terrain
    node.publish('vents', 'terrain_info', 'terrain')
    node.status_now('inputs', lambda item: item['accepted'] == '3')
    node.status_now('simulation', lambda item: item['state'] == 'running')
    node.run(2.0)
    node.newest('height', condition=lambda newest: newest['height']['wet'] > 0)
    return node


@pytest.fixture(scope='module')
def running(module_local):
    """An active node with a slope, a vent and lava, which the tests of a module share."""
    return start_flow(module_local)


@pytest.fixture
def run_program(monkeypatch, tmp_path, capfd):
    """Return a function that runs the node's program in the test: exit status and stderr."""
    from lava_ros.ros import node, runtime

    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv('ROS_DOMAIN_ID', str(own_domain()))
    # a thread that is still in the solver would end the test's process
    monkeypatch.setattr(runtime, 'STOP_TIMEOUT', PATIENCE)
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    package = logging.getLogger('lava_ros')
    kept, level = package.handlers[:], package.level

    def run(*words):
        status = node.main([str(word) for word in words])
        return status, capfd.readouterr().err

    yield run
    package.handlers[:] = kept
    package.setLevel(level)
    for number, handler in handlers.items():
        signal.signal(number, handler)
