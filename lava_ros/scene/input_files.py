# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Provenance of a scene: the files that its inputs name, with their sizes and digests."""

from collections.abc import Iterable, Iterator, Mapping
import hashlib
from pathlib import Path
from typing import Any

from lava_ros.errors import refusing
from lava_ros.files import open_input

#: Keys of scene and case files whose values are names of files.
KEYS = ('file', 'terrain', 'barriers')


def files_in(data: Any, folder: Path) -> Iterator[tuple[str, Path]]:
    """Yield the files that a scene file names, as written there and as paths.

    Args:
        data: Content of the scene file.
        folder: Folder to which its names are relative.
    """
    items: Iterable[Any] = ()
    if isinstance(data, Mapping):
        for key in KEYS:
            if isinstance(name := data.get(key), str | Path) and (folder / name).is_file():
                yield str(name), folder / name
        items = data.values()
    elif isinstance(data, list | tuple):
        items = data
    for item in items:
        yield from files_in(item, folder)


def digests(files: Iterable[tuple[str, Path]]) -> list[dict[str, Any]]:
    """Return the path as given, the size and the SHA-256 digest of each file, each file once.

    Raises:
        LavaError: If a file cannot be read.
    """
    found: dict[Path, dict[str, Any]] = {}
    for name, path in files:
        if path not in found:
            digest, size = hashlib.sha256(), 0
            with refusing('file', name, 'a readable file', OSError), open_input(path) as stream:
                while block := stream.read(2**20):
                    digest.update(block)
                    size += len(block)
            found[path] = {'path': name, 'bytes': size, 'sha256': digest.hexdigest()}
    return list(found.values())
