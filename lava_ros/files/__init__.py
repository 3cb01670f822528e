# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Files of the user: safe opening of input, and atomic replacement of output."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
import errno
import logging
import os
from pathlib import Path
import stat
from typing import BinaryIO

from lava_ros.errors import LavaError, refusing

_LOG = logging.getLogger(__name__)

#: Maximum number of cells of a grid in a file: 10,000 x 10,000.
MAX_CELLS = 10**8

#: Suffixes of pictures.
PICTURES = ('.png', '.pdf', '.svg')


def warn_of_unknown(path: object, parts: str, names: Iterable[str], known: str = '') -> None:
    """Warn of unknown parts of a file by name; ``known`` lists the known parts."""
    if others := ', '.join(dict.fromkeys(names)):
        _LOG.warning(f'{path}: unknown {parts} are ignored: {others}{known}')


def open_input(path: str | Path) -> BinaryIO:
    """Open a file for reading bytes.

    Raises:
        OSError: If it cannot be read or is not a regular file: opening a pipe waits for a writer,
            and a device may never end.
    """
    try:
        _check_regular(os.stat(path), path)
        # the path may have changed since then: open without waiting, and check again
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except ValueError as error:
        raise OSError(errno.EINVAL, str(error), str(path)) from error
    try:
        _check_regular(os.fstat(descriptor), path)
        return os.fdopen(descriptor, 'rb')
    except OSError:
        os.close(descriptor)
        raise


def check_exists(field: str, path: Path) -> None:
    """Raise LavaError, which names ``field``, if a file does not exist or is a folder."""
    if os.path.isdir(path):
        raise LavaError(field, str(path), 'a file; this is a folder')
    if not os.path.exists(path):
        raise LavaError(field, str(path), f'a file that exists{similar_file(path)}')


def similar_file(path: Path) -> str:
    """Return a remark about the file with the most similar name in the folder; may be empty."""
    # imported here, because the reader process does not need it
    from lava_ros.validation import meant

    try:
        names = [item.name for item in os.scandir(path.parent)]
    except OSError:
        return f'; there is no folder {path.parent}'
    return meant(path.name, names)


def file_to_write(field: str, value: str | Path, endings: Sequence[str] = ()) -> Path:
    """Check an output as ``writable_file``, and log that an existing file will be replaced."""
    path = writable_file(field, value, endings)
    if os.path.lexists(os.path.realpath(path)):
        _LOG.info('%s exists and will be replaced', path)
    return path


def writable_file(field: str, value: str | Path, endings: Sequence[str] = ()) -> Path:
    """Check and return the path of an output.

    Args:
        field: Name of the field in errors.
        value: Path to check.
        endings: Allowed suffixes, such as ``.json``, so that output does not replace a file of
            another kind.

    Raises:
        LavaError: If the suffix is not allowed, the path is not a regular file, its folder does
            not exist, or it cannot be written.
    """
    path = Path(value)
    if endings and path.suffix.lower() not in endings:
        raise LavaError(field, str(value), f'a file whose name ends with {" or ".join(endings)}')
    with refusing(field, str(value), 'a writable file', OSError, ValueError):
        place = Path(os.path.realpath(path))
        is_there = os.path.lexists(place)
        if is_there:
            _check_regular(os.stat(place), place)
        if not place.parent.is_dir():
            raise LavaError(field, str(value), f'a file in a folder that exists: {place.parent}')
        for item in (place, place.parent) if is_there else (place.parent,):
            if not os.access(item, os.W_OK):
                raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(item))
    return path


@contextmanager
def replacing(path: Path, *, is_durable: bool = True) -> Iterator[Path]:
    """Yield a new, empty file in the folder of ``path``, which replaces it at the end.

    The new file has the same suffix. An exception removes it and leaves the old file. A file that
    is not ``is_durable`` survives the end of the process, but not a loss of power.

    Raises:
        OSError: If the file cannot be created, or cannot replace the old one.
    """
    path = Path(os.path.realpath(path))
    partial = path.with_name(f'.{path.stem}.{os.urandom(4).hex()}.partial{path.suffix}')
    mode = stat.S_IMODE(path.stat().st_mode) if path.exists() else 0o666
    # never write into an existing file or through a link
    os.close(os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, mode))
    try:
        yield partial
        if is_durable:
            with partial.open('rb') as written:
                # some file systems report only here that they are full
                os.fsync(written.fileno())
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)


@contextmanager
def writing(field: str, path: str | Path) -> Iterator[Path]:
    """Yield a file like ``replacing``; an OSError becomes a LavaError that names ``field``."""
    expected = 'a writable file'
    with refusing(field, str(path), expected, OSError, ValueError), replacing(Path(path)) as file:
        yield file


def write_output(field: str, path: str | Path, data: str | bytes) -> None:
    """Write a complete file, text in UTF-8, or leave the old one; errors as in ``writing``."""
    with writing(field, path) as partial:
        partial.write_bytes(data.encode() if isinstance(data, str) else data)


def _check_regular(status: os.stat_result, path: str | Path) -> None:
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not stat.S_ISREG(status.st_mode):
        raise OSError(errno.EINVAL, 'not a regular file but a pipe, socket or device', str(path))
