# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava check install`: check the installation."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import asdict
from typing import TYPE_CHECKING

from lava_ros.cli.console import terminal, write_json
from lava_ros.cli.options import argument, command
from lava_ros.errors import LavaError, printable

if TYPE_CHECKING:
    from lava_ros.doctor import Finding, Results


@command(
    argument('--bags', 'DIR', 'folder for bags', 'bags'),
    argument(
        '--msg-config', 'FILE', 'layers to check: a path, or the name of a file in msg_configs/',
        'default.yaml',
    ),
    '--json',
)
def install(args: argparse.Namespace) -> int:
    """Check Python, ROS, DDS, GPU, disk and clock, and print what to correct.

    The command checks what the package needs: Python, packages, ROS, discovery, a message that
    goes out over the middleware and comes back, QoS of the layers, GPU, kernel cache, disk and
    clock. The exit status is 1 if something does not work.
    """
    from lava_ros.doctor import FAIL

    findings = []
    for finding in _findings(args):
        findings.append(finding)
        if args.json is None:
            _print(finding)
    fails = any(finding.level == FAIL for finding in findings)
    write_json(
        {'works': not fails, 'checks': [asdict(finding) for finding in findings]}, args.json
    )
    return int(fails)


def _findings(args: argparse.Namespace) -> Iterator[Finding]:
    from lava_ros import doctor as checks

    for name, check in {
        'python': checks.check_python,
        'packages': checks.check_packages,
        'ros': checks.check_ros,
        'discovery': checks.check_discovery,
        'dds': checks.check_round_trip,
        'qos': lambda: _check_layers(args.msg_config),
        'gpu': checks.check_gpu,
        'kernel cache': checks.check_kernel_cache,
        'disk': lambda: checks.check_disk(args.bags),
        'clock': checks.check_clock,
    }.items():
        yield from (checks.Finding(name, *result) for result in check())


def _check_layers(name: str) -> Results:
    from lava_ros import doctor as checks
    from lava_ros.layers.layer_files import find_config, load_layers

    try:
        layers = load_layers(find_config(name, field='--msg-config'))
    except LavaError as error:
        return [(checks.FAIL, str(error), 'correct the file, or name another: --msg-config')]
    return checks.check_qos(layers)


def _print(finding: Finding) -> None:
    """Print a finding as soon as it is known, with its level in colour."""
    from rich.text import Text

    style = {'OK': 'green', 'WARN': 'yellow'}.get(finding.level, 'bold red')
    lines = [Text.assemble(
        (f'{finding.level:6}', style), f'{finding.check:13} {printable(finding.text)}'
    )]
    if finding.remedy:
        lines.append(Text(f'{"":20}-> {printable(finding.remedy)}', style='dim'))
    terminal(soft_wrap=True, highlight=False).print(*lines, sep='\n')
