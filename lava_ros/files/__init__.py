# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Files that users name: which are opened, and how new ones take the place of what was there."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
import errno
import logging
import os
from pathlib import Path
import secrets
import stat
from typing import BinaryIO

from lava_ros.errors import LavaError

_LOG = logging.getLogger(__name__)

#: Most cells of a grid that is read from a file: 10,000 x 10,000.
MOST_CELLS = 10**8

#: Suffixes of pictures.
PICTURES = ('.png', '.pdf', '.svg')


def open_input(path: str | Path) -> BinaryIO:
    """Open a file for reading bytes.

    OSError where it cannot be read, or is no regular file: who opens a pipe waits for its writer,
    and a device may never end.
    """
    try:
        _check_regular(os.stat(path), path)
        # what is there by now may be another thing: it is not waited for, and looked at again
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except ValueError as error:
        raise OSError(errno.EINVAL, str(error), str(path)) from error
    try:
        _check_regular(os.fstat(descriptor), path)
        return os.fdopen(descriptor, 'rb')
    except OSError:
        os.close(descriptor)
        raise


def file_to_write(field: str, value: str | Path, endings: Sequence[str] = ()) -> Path:
    """Check a path that is to be written, and return it; an existing file is announced in the log.

    The existing file stays until ``replacing`` has finished. ``endings`` are the suffixes that the
    name may have, such as ``.json``; they keep output from replacing a file of another kind.
    LavaError, which names ``field``, where the name has another suffix; the path is a folder, a
    pipe or a device; its folder does not exist; or it cannot be written.
    """
    path = Path(value)
    if endings and path.suffix.lower() not in endings:
        raise LavaError(field, str(value), f'a file whose name ends with {" or ".join(endings)}')
    try:
        place = _target(path)
        is_there = os.path.lexists(place)
        if is_there:
            _check_regular(os.stat(place), place)
        # a folder that is no folder has nothing in it
        os.stat(os.path.join(place.parent, ''))
        for item in (place, place.parent) if is_there else (place.parent,):
            if not os.access(item, os.W_OK):
                raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(item))
    except (OSError, ValueError) as error:
        raise LavaError(field, str(value), f'a file to write ({error})') from error
    if is_there:
        _LOG.info('%s is there and will be replaced', path)
    return path


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a new, empty file beside ``path``, with the same suffix, which replaces it at the end.

    If an exception is raised meanwhile, the new file is removed and the old one stays. OSError
    where it cannot be created, or cannot replace the old one.
    """
    path = _target(path)
    partial = path.with_name(f'.{path.stem}.{secrets.token_hex(4)}.partial{path.suffix}')
    mode = stat.S_IMODE(path.stat().st_mode) if path.exists() else 0o666
    # nothing that somebody has put there is written to
    os.close(os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, mode))
    try:
        yield partial
        with partial.open('rb') as written:
            # some file systems say only now that they are full
            os.fsync(written.fileno())
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)


@contextmanager
def writing(field: str, path: str | Path) -> Iterator[Path]:
    """``replacing``, whose errors are LavaErrors that name ``field``."""
    try:
        with replacing(Path(path)) as partial:
            yield partial
    except LavaError:
        raise
    except (OSError, ValueError) as error:
        raise LavaError(field, str(path), f'a file to write ({error})') from error


def write_output(field: str, path: str | Path, data: str | bytes) -> None:
    """Write a file completely, text in UTF-8, or leave it as it was; errors as in ``writing``."""
    with writing(field, path) as partial:
        partial.write_bytes(data.encode() if isinstance(data, str) else data)


def _target(path: Path) -> Path:
    """The file itself, also where the path is a link to it."""
    return Path(os.path.realpath(path))


def _check_regular(status: os.stat_result, path: str | Path) -> None:
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not stat.S_ISREG(status.st_mode):
        raise OSError(errno.EINVAL, 'no regular file but a pipe, socket or device', str(path))
