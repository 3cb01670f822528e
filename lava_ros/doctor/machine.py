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

"""The machine: Python, packages, GPU, kernel cache, disk and clock."""

from collections.abc import Iterator
import ctypes
import importlib.metadata
from pathlib import Path
import shutil
import sys
import tempfile
from typing import Any

from lava_ros.doctor import FAIL, OK, Said, WARN
from lava_ros.simulation.backend.threads import usable_cores

#: Oldest Python that works, and the first that was not tried.
PYTHONS = ((3, 10), (3, 14))

#: Distribution, lowest version, first version that was not tried, extra that brings it (or none).
PACKAGES = (
    ('lz4', '4', '5', ''),
    ('mcap', '1.5', '2', ''),
    ('numpy', '1.26', '3', ''),
    ('pyyaml', '6', '7', ''),
    ('rich', '13.7', '16', ''),
    ('warp-lang', '1.19', '2', ''),
    ('zstandard', '0.22', '1', ''),
    ('rasterio', '1.3.10', '2', 'terrain'),
    ('matplotlib', '3.8', '4', 'plot'),
    ('mcap-ros2-support', '0.5.5', '1', 'plot'),
)

#: Free space below which a recording soon ends, and below which it may [bytes].
SCARCE, LITTLE = 10**9, 10**10

#: Error of the clock from which stamps of several machines no longer agree [s].
CLOCK_ERROR = 0.5

# adjtimex: the kernel's own state of the clock. See adjtimex(2).
_TIMEX_SIZE = 208
_TIMEX_MAXERROR = 24
_TIMEX_STATUS = 40
_UNSYNCHRONISED = 0x40


def check_python() -> Iterator[Said]:
    """Whether the package was tried with this Python."""
    oldest, untried = PYTHONS
    version = '.'.join(str(part) for part in sys.version_info[:3])
    if sys.version_info < oldest:
        yield FAIL, version, 'install Python 3.10 to 3.13'
    elif sys.version_info >= untried:
        yield WARN, f'{version}, not tried', 'use Python 3.10 to 3.13'
    else:
        yield OK, f'{version} ({sys.prefix})'


def check_packages() -> Iterator[Said]:
    """Whether what the package needs is there, in versions that were tried."""
    found = []
    for name, lowest, untried, extra in PACKAGES:
        try:
            version = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            if extra:
                yield WARN, f'{name} is missing', f"pip install 'lava_ros[{extra}]'"
            else:
                yield FAIL, f'{name} is missing', f'pip install {name}'
            continue
        if not _parts(lowest) <= _parts(version) < _parts(untried):
            yield (
                WARN, f'{name} {version} was not tried',
                f"pip install '{name}>={lowest},<{untried}'",
            )
            continue
        found.append(f'{name} {version}')
    yield OK, ', '.join(found)


def _parts(version: str) -> tuple[int, ...]:
    """The numbers at the start of a version."""
    result = []
    for part in version.split('.'):
        if not part.isdigit():
            break
        result.append(int(part))
    return tuple(result)


def _warp() -> Any:
    """Warp, started; that there is no GPU is for the report to say."""
    import warp as wp

    wp.config.log_level = wp.LOG_ERROR
    wp.init()
    return wp


def check_gpu() -> Iterator[Said]:
    """Which devices Warp has, and why there is no GPU among them."""
    try:
        wp = _warp()
        devices = wp.get_cuda_devices()
    except Exception as error:
        # Whatever breaks while a driver is loaded is the finding.
        yield FAIL, f'Warp does not start: {error}', "pip install 'warp-lang>=1.19,<2'"
        return
    for device in devices:
        driver = '.'.join(str(part) for part in wp.get_cuda_driver_version())
        yield (
            OK, f'{device.alias}: {device.name}, sm_{device.arch}, '
            f'{device.free_memory / 1e9:.1f} of {device.total_memory / 1e9:.1f} GB free, '
            f'driver for CUDA {driver}',
        )
    if devices:
        return
    has_hardware = Path('/dev/nvidia0').exists() or shutil.which('nvidia-smi') is not None
    text = f'none: the CPU does the work, on {usable_cores()} cores'
    yield (
        WARN, 'there is an NVIDIA GPU that Warp does not see' if has_hardware else text,
        "install NVIDIA's driver, or give the container its GPU (docker run --gpus all); "
        'small scenes run without',
    )


def check_kernel_cache() -> Iterator[Said]:
    """Whether compiled kernels can be kept, and how much there is of them."""
    try:
        folder = Path(_warp().config.kernel_cache_dir)
    except Exception as error:
        yield FAIL, f'Warp does not start: {error}', 'see gpu'
        return
    problem = _problem_of_writing(folder)
    if problem:
        yield (
            FAIL, f'{folder} cannot be written ({problem})',
            'set WARP_CACHE_PATH to a folder that can: kernels are compiled at every start',
        )
        return
    size = sum(path.stat().st_size for path in folder.rglob('*') if path.is_file())
    yield OK, f'{folder}, {size / 1e6:.0f} MB'


def check_disk(folder: str | Path) -> Iterator[Said]:
    """Check whether bags can be written to a folder, and how much space there is.

    The folder need not exist yet.
    """
    folder = Path(folder).absolute()
    problem = _problem_of_writing(folder)
    if problem:
        yield (
            FAIL, f'{folder} cannot be written ({problem})',
            'set the parameter bag_root (here --bags) to a folder that can',
        )
        return
    free = shutil.disk_usage(_nearest(folder)).free
    text = f'{free / 1e9:.1f} GB free for bags in {folder}'
    if free < SCARCE:
        yield FAIL, text, 'make room, or set bag_root to another disk'
    elif free < LITTLE:
        yield WARN, text, 'make room before a long recording'
    else:
        yield OK, text


def _nearest(folder: Path) -> Path:
    """The folder, or the one above it that exists."""
    return next(item for item in (folder, *folder.parents) if item.exists())


def _problem_of_writing(folder: Path) -> str:
    """Why a file cannot be written there, empty when it can."""
    try:
        with tempfile.TemporaryFile(dir=_nearest(folder)) as file:
            file.write(b'lava')
    except OSError as error:
        return error.strerror or str(error)
    return ''


def check_clock() -> Iterator[Said]:
    """Whether the clock is kept in step with others', as stamps of several machines need it."""
    state = ctypes.create_string_buffer(_TIMEX_SIZE)
    libc = ctypes.CDLL(None, use_errno=True)
    if not hasattr(libc, 'adjtimex') or libc.adjtimex(state) < 0:
        yield WARN, 'its state is unknown', 'compare it with another machine'
        return
    status = ctypes.c_int.from_buffer(state, _TIMEX_STATUS).value
    error = ctypes.c_long.from_buffer(state, _TIMEX_MAXERROR).value / 1e6
    if status & _UNSYNCHRONISED or error > CLOCK_ERROR:
        yield (
            WARN, 'not synchronised',
            'run chrony or systemd-timesyncd when several machines share the graph',
        )
    else:
        yield OK, f'synchronised within {error * 1e3:.0f} ms'
