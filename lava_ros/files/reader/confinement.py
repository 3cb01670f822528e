# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Limits of the process that reads untrusted files: no network, no programs, no other files.

A system call filter (seccomp) permanently denies sockets and programs, on Linux. While a file is
read, the process may have no new file descriptor (``RLIMIT_NOFILE``), which also denies files and
sockets on every other system.
"""

from collections.abc import Iterator
from contextlib import contextmanager
import ctypes
import os
import resource
import struct
import sys

#: Time for a file [s of CPU], and the rate at which a larger one is read [bytes/s].
CPU_TIME, CPU_RATE = 30, 10_000_000

#: Memory for the contents of a file, in addition to its size [bytes].
MEMORY = 4 << 30

#: Descriptions of files within these limits, for errors.
TIME_LIMIT = (
    f'a file that is read in {CPU_TIME} s of CPU time, and 1 s more for each '
    f'{CPU_RATE / 1e6:g} MB'
)
MEMORY_LIMIT = f'a file that is read with {MEMORY >> 30} GiB of memory in addition to its size'

#: Options of GDAL and PROJ in the environment of the process. The proxy is a closed port.
SWITCHES = {
    'CPL_VSIL_CURL_ALLOWED_FILENAME': 'none',
    'GDAL_HTTP_PROXY': 'http://127.0.0.1:1',
    'GDAL_VRT_ENABLE_PYTHON': 'NO',
    'OPENBLAS_NUM_THREADS': '1',
    'PROJ_NETWORK': 'OFF',
}

#: Numbers of the denied system calls, and of the architecture in a filter: socket, connect, bind,
#: execve, execveat, ptrace, process_vm_writev, kill, io_uring_setup.
_DENIED = {
    'x86_64': (0xC000003E, (41, 42, 49, 59, 322, 101, 311, 62, 425)),
    'aarch64': (0xC00000B7, (198, 203, 200, 221, 281, 117, 271, 129, 425)),
}

# from linux/filter.h, linux/seccomp.h and linux/prctl.h
_LOAD, _IF_EQUAL, _IF_AT_LEAST, _RETURN = 0x20, 0x15, 0x35, 0x06
_ALLOW, _REFUSE, _X32 = 0x7FFF0000, 0x0005000D, 0x40000000
_SET_NO_NEW_PRIVILEGES, _SET_SECCOMP, _FILTER = 38, 22, 2


def deny_network_and_programs() -> bool:
    """Permanently deny sockets and programs to this process; return False if the system cannot."""
    arch, denied = _DENIED.get(os.uname().machine, (0, ()))
    if not sys.platform.startswith('linux') or not denied:
        return False
    count = len(denied)
    lines = [
        # other architectures have other numbers
        (_LOAD, 0, 0, 4), (_IF_EQUAL, 0, count + 3, arch), (_LOAD, 0, 0, 0),
        (_IF_AT_LEAST, count + 1, 0, _X32),
        *((_IF_EQUAL, count - index, 0, number) for index, number in enumerate(denied)),
        (_RETURN, 0, 0, _ALLOW), (_RETURN, 0, 0, _REFUSE),
    ]
    code = ctypes.create_string_buffer(b''.join(struct.pack('HBBI', *line) for line in lines))
    program = struct.pack('HP', len(lines), ctypes.addressof(code))
    control = ctypes.CDLL(None).prctl
    zero = ctypes.c_ulong(0)
    return bool(
        control(_SET_NO_NEW_PRIVILEGES, ctypes.c_ulong(1), zero, zero, zero) == 0
        and control(_SET_SECCOMP, ctypes.c_ulong(_FILTER), program, zero, zero) == 0
    )


@contextmanager
def limited(size: int) -> Iterator[None]:
    """Limit the time and memory for files of a size [bytes], and deny new file descriptors."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    time = used.ru_utime + used.ru_stime + CPU_TIME + size / CPU_RATE
    try:
        with open('/proc/self/statm', encoding='ascii') as file:
            pages = int(file.read().split()[0])
    except OSError:
        pages = 0
    wanted = {
        resource.RLIMIT_CPU: int(time) + 1,
        resource.RLIMIT_AS: pages * resource.getpagesize() + size + MEMORY,
        resource.RLIMIT_CORE: 0,
        resource.RLIMIT_NOFILE: 0,
    }
    before = {kind: resource.getrlimit(kind) for kind in wanted}
    _set({kind: (_least(limit, *before[kind]), before[kind][1]) for kind, limit in wanted.items()})
    try:
        yield
    finally:
        _set(before)


@contextmanager
def opening() -> Iterator[None]:
    """Allow new file descriptors inside ``limited``."""
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (before[1], before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, before)


def _least(*limits: int) -> int:
    return min(item for item in limits if item != resource.RLIM_INFINITY)


def _set(limits: dict[int, tuple[int, int]]) -> None:
    for kind, pair in limits.items():
        resource.setrlimit(kind, pair)
