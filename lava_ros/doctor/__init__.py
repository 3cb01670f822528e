# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Checks of `lava check install`: machine and ROS graph, with a remedy for each problem."""

from collections.abc import Iterable, Mapping
from contextlib import suppress
import ctypes
from dataclasses import dataclass
import importlib.metadata
from importlib.util import find_spec
import json
import os
from pathlib import Path
import shutil
import subprocess
import sys
import tempfile
from typing import Any

from lava_ros.bag.qos import LATCHED
from lava_ros.files.optional import INSTALL_ROS
from lava_ros.layers.layer import Layer, OCCUPANCY_GRID
from lava_ros.simulation.backend.threads import usable_cores

#: Levels: nothing to do; works with limitations; does not work.
OK, WARN, FAIL = 'OK', 'WARN', 'FAIL'

#: First version of Python that was not tested.
UNTESTED_PYTHON = (3, 14)

#: Free space below which a recording soon fails, and below which a long one may fail [bytes].
SCARCE, LITTLE = 10**9, 10**10

#: Maximum error of the clock at which stamps of several machines agree [s].
CLOCK_ERROR = 0.5

# adjtimex(2): the kernel's state of the clock.
_TIMEX_SIZE = 208
_TIMEX_MAXERROR = 24
_TIMEX_STATUS = 40
_UNSYNCHRONISED = 0x40

#: The supported ROS distribution.
DISTRO = 'jazzy'

#: Domains with ports below Linux's ephemeral range, and all valid domains.
SAFE_DOMAINS, DOMAINS = range(0, 102), range(0, 233)

#: Values of ROS_AUTOMATIC_DISCOVERY_RANGE and their meanings.
DISCOVERY_RANGES = {
    'SUBNET': 'every machine in the subnet',
    'LOCALHOST': 'only this machine',
    'SYSTEM_DEFAULT': 'as the middleware is configured',
    'OFF': 'no machine',
}

#: Subscribers in robots and viewers that require latched grids.
CONSUMERS = (
    "RViz's map display (rviz/lava.rviz)", "Nav2's keepout filter, speed filter and static layer",
)

#: Maximum duration of a round trip, including discovery [s].
PROBE_TIMEOUT = 30.0

#: A round trip on one machine is slow above this time [ms].
SLOW = 50.0

_ROS_REMEDY = f'source the setup file of ROS 2 Jazzy, or run {INSTALL_ROS}'

_DDS_REMEDY = (
    'let the firewall pass UDP 7400 to 7500 and multicast, check that /dev/shm is writable, '
    'and try ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST'
)


@dataclass(frozen=True)
class Finding:
    """One line of the report: subject, level, text and an optional remedy."""

    check: str
    level: str
    text: str
    remedy: str = ''


#: Results of a check: level, text and an optional remedy for each.
Results = list[tuple[str, str] | tuple[str, str, str]]


def check_python() -> Results:
    """Check whether the package was tested with this Python."""
    version = '.'.join(str(part) for part in sys.version_info[:3])
    if sys.version_info >= UNTESTED_PYTHON:
        return [(WARN, f'{version}, not tested', 'use Python 3.10 to 3.13')]
    return [(OK, f'{version} ({sys.prefix})')]


def check_packages() -> Results:
    """Check whether required packages are installed, and those that read GIS files."""
    from packaging.requirements import Requirement

    try:
        requirements = importlib.metadata.requires('lava_ros') or []
    except importlib.metadata.PackageNotFoundError:
        return [(WARN, 'lava_ros is not installed', 'pip install . in the folder of the source')]
    results: Results = []
    found = []
    for requirement in map(Requirement, requirements):
        marker, name = requirement.marker, requirement.name
        is_needed = marker is None or marker.evaluate({'extra': ''})
        if marker is not None and not (is_needed or marker.evaluate({'extra': 'gis'})):
            continue
        version = _version(name)
        if not version:
            level = FAIL if is_needed else WARN
            results.append((level, f'{name} is missing', f'pip install {name}'))
        elif requirement.specifier.contains(version, prereleases=True):
            found.append(f'{name} {version}')
        else:
            text = f'{name} is {version}, and lava_ros needs {requirement.specifier}'
            results.append((FAIL, text, f'pip install --upgrade {name}'))
    return [*results, (OK, ', '.join(found))]


def _version(distribution: str) -> str:
    try:
        return importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        return ''


def _warp() -> Any:
    """Initialise Warp without its list of devices."""
    import warp as wp

    wp.config.log_level = wp.LOG_ERROR
    wp.init()
    return wp


def check_gpu() -> Results:
    """Check which devices Warp has, and why there is no GPU."""
    try:
        wp = _warp()
        devices = wp.get_cuda_devices()
    except Exception as error:
        # an error while a driver is loaded is a result of the check
        return [(FAIL, f'Warp does not start: {error}', "pip install 'warp-lang>=1.19,<2'")]
    if devices:
        driver = '.'.join(str(part) for part in wp.get_cuda_driver_version())
        return [
            (
                OK, f'{device.alias}: {device.name}, sm_{device.arch}, '
                f'{device.free_memory / 1e9:.1f} of {device.total_memory / 1e9:.1f} GB free, '
                f'driver for CUDA {driver}',
            )
            for device in devices
        ]
    has_hardware = Path('/dev/nvidia0').exists() or shutil.which('nvidia-smi') is not None
    text = f'none: the simulation runs on the CPU, with {usable_cores()} cores'
    return [(
        WARN, 'Warp cannot use the NVIDIA GPU' if has_hardware else text,
        "install NVIDIA's driver, or give the container its GPU (docker run --gpus all); "
        'small scenes do not need one',
    )]


def check_kernel_cache() -> Results:
    """Check whether compiled kernels can be cached, and the size of the cache."""
    try:
        folder = Path(_warp().config.kernel_cache_dir)
    except Exception as error:
        return [(FAIL, f'Warp does not start: {error}', 'see gpu')]
    if problem := _problem_of_writing(folder):
        return [(
            FAIL, f'{folder} cannot be written ({problem})',
            'set WARP_CACHE_PATH to a writable folder, or kernels are compiled at every start',
        )]
    size = 0
    for place, _, names in os.walk(folder):
        for name in names:
            # another process may remove what it has compiled
            with suppress(OSError):
                size += os.stat(os.path.join(place, name)).st_size
    return [(OK, f'{folder}, {size / 1e6:.0f} MB')]


def check_disk(folder: str | Path) -> Results:
    """Check whether bags can be written to a folder, and the free space.

    The folder need not exist yet.
    """
    folder = Path(folder).absolute()
    if problem := _problem_of_writing(folder):
        return [(
            FAIL, f'{folder} cannot be written ({problem})',
            'set the parameter bag_root (here --bags) to a writable folder',
        )]
    free = shutil.disk_usage(_nearest(folder)).free
    text = f'{free / 1e9:.1f} GB free for bags in {folder}'
    if free < SCARCE:
        return [(FAIL, text, 'free space, or set bag_root to another disk')]
    return [(WARN, text, 'free space before a long recording') if free < LITTLE else (OK, text)]


def _nearest(folder: Path) -> Path:
    """Return the folder, or its nearest existing parent."""
    return next(item for item in (folder, *folder.parents) if item.exists())


def _problem_of_writing(folder: Path) -> str:
    """Return the reason why a file cannot be written there, empty if it can."""
    try:
        with tempfile.TemporaryFile(dir=_nearest(folder)) as file:
            file.write(b'lava')
    except OSError as error:
        return error.strerror or str(error)
    return ''


def check_clock() -> Results:
    """Check whether the clock is synchronised, so that stamps of several machines agree."""
    state = ctypes.create_string_buffer(_TIMEX_SIZE)
    libc = ctypes.CDLL(None, use_errno=True)
    if not hasattr(libc, 'adjtimex') or libc.adjtimex(state) < 0:
        return [(WARN, 'its state is unknown', 'compare it with another machine')]
    status = ctypes.c_int.from_buffer(state, _TIMEX_STATUS).value
    error = ctypes.c_long.from_buffer(state, _TIMEX_MAXERROR).value / 1e6
    if status & _UNSYNCHRONISED or error > CLOCK_ERROR:
        remedy = 'run chrony or systemd-timesyncd when several machines share the graph'
        return [(WARN, 'not synchronised', remedy)]
    return [(OK, f'synchronised within {error * 1e3:.0f} ms')]


def check_ros(environment: Mapping[str, str] = os.environ) -> Results:
    """Check whether ROS 2 Jazzy can be imported, and with which middleware."""
    missing = [name for name in ('rclpy', 'nav_msgs', 'diagnostic_msgs') if not find_spec(name)]
    if missing:
        return [(FAIL, f'no Python package {", ".join(missing)}', _ROS_REMEDY)]
    distro = environment.get('ROS_DISTRO', '')
    if distro and distro != DISTRO:
        return [(WARN, f'ROS_DISTRO is {distro}', f'source ROS 2 {DISTRO}')]
    source = 'an installation' if environment.get('AMENT_PREFIX_PATH') else 'wheels'
    version = _version('ros-rclpy') or _version('rclpy')
    middleware = environment.get('RMW_IMPLEMENTATION', 'rmw_fastrtps_cpp (default)')
    return [(OK, f'{DISTRO} from {source}, rclpy {version}, {middleware}')]


def check_discovery(environment: Mapping[str, str] = os.environ) -> Results:
    """Check which graph the node joins, and which machines can join it."""
    domain = environment.get('ROS_DOMAIN_ID', '') or '0'
    if not domain.isdigit() or int(domain) not in DOMAINS:
        return [(FAIL, f'ROS_DOMAIN_ID is {domain!r}', 'set it to a number from 0 to 101')]
    results: Results = []
    if int(domain) not in SAFE_DOMAINS:
        results.append((
            WARN, f'the ports of domain {domain} are in the ephemeral range of Linux',
            'set ROS_DOMAIN_ID to a number from 0 to 101',
        ))
    reach = environment.get('ROS_AUTOMATIC_DISCOVERY_RANGE', '') or 'SUBNET'
    text = f'domain {domain}, range {reach}: {DISCOVERY_RANGES.get(reach, "no such range")}'
    peers = environment.get('ROS_STATIC_PEERS', '')
    text += f', and {peers}' if peers else ''
    if reach not in DISCOVERY_RANGES:
        return [*results, (FAIL, text, f'set it to one of {", ".join(DISCOVERY_RANGES)}')]
    if reach == 'OFF' and not peers:
        return [*results, (FAIL, text, 'set ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET')]
    remedy = 'any machine in the subnet can command the node; LOCALHOST prevents that'
    return [*results, (OK, text, remedy) if reach == 'SUBNET' else (OK, text)]


def check_qos(layers: Iterable[Layer]) -> Results:
    """Check whether RViz and Nav2 can receive the layers with their QoS."""
    enabled = [layer for layer in layers if layer.enabled]
    results: Results = [
        (
            WARN, f'{consumer} cannot receive {layer.topic}: it is {getattr(layer.qos, policy)}',
            f'set layers.{layer.name}.qos.{policy} to {getattr(LATCHED, policy)}',
        )
        for consumer in CONSUMERS
        for layer in enabled
        if layer.message == OCCUPANCY_GRID
        for policy in ('reliability', 'durability')
        if getattr(layer.qos, policy) != getattr(LATCHED, policy)
    ]
    names = ', '.join(layer.topic for layer in enabled)
    return results or [(OK, f'{names}: the QoS matches what RViz and Nav2 request')]


def check_round_trip(timeout: float = PROBE_TIMEOUT) -> Results:
    """Check whether a message returns through the middleware within ``timeout`` [s], and how fast.

    The check runs in a separate process, because the middleware may hang or crash.
    """
    if find_spec('rclpy') is None:
        return [(FAIL, 'not tested: rclpy is not installed', _ROS_REMEDY)]
    words = [sys.executable, '-m', 'lava_ros.clients.dds_probe']
    try:
        probe = subprocess.run(
            words, capture_output=True, text=True, timeout=timeout, check=False
        )
    except subprocess.TimeoutExpired:
        return [(FAIL, f'no message returned within {timeout:g} s', _DDS_REMEDY)]
    try:
        seen = json.loads(probe.stdout.splitlines()[-1])
    except (IndexError, ValueError):
        last = (probe.stderr.strip().splitlines() or ['nothing'])[-1]
        text = f'the probe ended with status {probe.returncode}: {last}'
        return [(FAIL, text, _DDS_REMEDY)]
    if 'error' in seen:
        return [(FAIL, seen['error'], _DDS_REMEDY)]
    text = (
        f'{seen["middleware"]}: found after {seen["discovery_ms"]:.0f} ms, '
        f'there in {seen["trip_ms"]:.2f} ms, {seen["nodes"]} other nodes in the graph'
    )
    if seen['trip_ms'] > SLOW:
        return [(WARN, text, 'the round trip is slow: check whether the machine is busy')]
    return [(OK, text)]
