# Copyright 2026 lava_ros contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Check Python, ROS, DDS, GPU, disk and clock, and print what to correct.

The command checks what the package needs: Python, packages, ROS, discovery, a message that goes
out over the middleware and comes back, security, QoS of the layers, GPU, kernel cache, disk and
clock. The exit status is 1 if something does not work.
"""

import argparse
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path

from lava_ros.cli.options import add_options
from lava_ros.cli.output import terminal, write_json
from lava_ros.doctor import FAIL, Finding, OK, WARN
from lava_ros.errors import LavaError, printable

_STYLES = {OK: 'green', WARN: 'yellow', FAIL: 'bold red'}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument(
        '--bags', metavar='DIR', default='bags', help='folder for bags (default: %(default)s)'
    )
    parser.add_argument(
        '--msg-config', metavar='FILE', default='default.yaml',
        help='layers to check: a path, or the name of a file in msg_configs/ '
        '(default: %(default)s)',
    )
    add_options(parser, '--json')


def run(args: argparse.Namespace) -> int:
    """Look at everything and print each finding as it comes.

    Returns:
        0, or 1 when something does not work.
    """
    findings = []
    show = _printer() if args.json is None else None
    for finding in _findings(args):
        findings.append(finding)
        if show is not None:
            show(finding)
    if show is None:
        write_json([asdict(finding) for finding in findings], args.json)
    return 1 if any(finding.level == FAIL for finding in findings) else 0


def _findings(args: argparse.Namespace) -> Iterator[Finding]:
    from lava_ros.doctor import graph, machine

    yield from machine.check_python()
    yield from machine.check_packages()
    yield from graph.check_ros()
    yield from graph.check_discovery()
    yield from graph.check_round_trip()
    yield from graph.check_security()
    try:
        yield from _check_layers(args.msg_config)
    except ImportError as error:
        yield Finding('qos', FAIL, f'not checked: {error}', 'install the missing packages')
    yield from machine.check_gpu()
    yield from machine.check_kernel_cache()
    yield from machine.check_disk(args.bags)
    yield from machine.check_clock()


def _check_layers(name: str) -> Iterator[Finding]:
    from lava_ros.doctor.graph import check_qos
    from lava_ros.files.resources import share_path
    from lava_ros.maps.layer_files import load_layers

    path = Path(name)
    try:
        layers = load_layers(path if path.is_file() else share_path(f'msg_configs/{name}'))
    except LavaError as error:
        yield Finding('qos', FAIL, str(error), 'correct the file, or name another: --msg-config')
        return
    yield from check_qos(layers)


def _printer() -> Callable[[Finding], None]:
    """What prints a finding: in colours in a terminal, where rich is installed."""
    try:
        from rich.text import Text

        console = terminal(soft_wrap=True, highlight=False)
    except ImportError:
        return lambda finding: print('\n'.join(_lines(finding)), flush=True)

    def show(finding: Finding) -> None:
        first, *rest = _lines(finding)
        line = Text(first)
        line.stylize(_STYLES[finding.level], 0, len(finding.level))
        console.print(line, *(Text(words, style='dim') for words in rest), sep='\n')

    return show


def _lines(finding: Finding) -> list[str]:
    lines = [f'{finding.level:6}{finding.check:13} {printable(finding.text)}']
    return [*lines, f'{"":20}-> {printable(finding.way_out)}'] if finding.way_out else lines
