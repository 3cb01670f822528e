# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A change of one part of a file has its effect, or gives an error or a warning."""

from collections.abc import Callable
from functools import cache
from pathlib import Path
import random
import re
from typing import Any
import warnings

from hypothesis import given, Phase, settings
from hypothesis import strategies as st
import pytest

from fuzz.limits import bounded
from fuzz.mutations import change, damaged, Document, DOCUMENTS, insane, KINDS
from lava_ros.errors import LavaError

#: Files of each kind: 10 in every test run, 500 in `make nightly`.
FILES = max(1, settings.default.max_examples // 4)

files = settings(max_examples=FILES, phases=[Phase.generate])

#: Text in quotes, or NaN, in a result.
TEXT_OR_NAN = re.compile(r'"[^"]*"|\'[^\']*\'|\b(nan)(?=[,)\]}])')


def has_nan(result: str) -> bool:
    """Return True if a number of a result is NaN."""
    return any(found[1] for found in TEXT_OR_NAN.finditer(result))


@pytest.fixture(scope='module')
def whole(folder: Callable[[], Path]) -> Callable[[int], str]:
    """Return a function that reads valid files by number."""

    @cache
    def read(number: int) -> str:
        document = DOCUMENTS[number]
        return repr(document.read(document.write(folder(), document.tree)))

    return read


def outcome(document: Document, path: Path, caplog: Any) -> tuple[str | None, str]:
    """Return the result of a file, None if it is refused, and the error or log."""
    caplog.clear()
    try:
        with bounded(), warnings.catch_warnings():
            # numpy warns of a number that was not checked
            warnings.simplefilter('error', RuntimeWarning)
            result = repr(document.read(path))
    except LavaError as error:
        assert error.field and error.expected
        return None, str(error)
    return result, caplog.text


def written(document: Document, folder: Path, tree: Any) -> Path | None:
    """Write a changed document; return None if its format cannot contain the change."""
    try:
        return document.write(folder, tree)
    # GDAL, numpy, JSON or YAML cannot write it
    except Exception:
        return None


@pytest.mark.parametrize('kind', KINDS)
@files
@given(seed=st.integers(0, 2**63))
def test_a_changed_part_is_understood_or_named(
    kind: str, seed: int, folder: Any, whole: Any, trial: Any, caplog: Any
) -> None:
    chance = random.Random(seed)
    suitable = [at for at, item in enumerate(DOCUMENTS) if item.kind == kind and item.tree]
    number = chance.choice(suitable)
    document = DOCUMENTS[number]
    expected = whole(number)
    changed = change(chance, document)
    path = written(document, folder(), changed.tree)
    if path is None:
        return
    with trial(kind) as row:
        result, message = outcome(document, path, caplog)
        row['refused'] += result is None
        if result is None:
            return
        assert not changed.is_refused, changed.action
        assert kind == 'rasters' or not has_nan(result), changed.action
        if changed.same is not None:
            assert (result == expected) == changed.same, changed.action
        is_added = changed.without is document.tree
        if changed.without is None or (result == expected and not is_added):
            return
        path = written(document, folder(), changed.without)
        without = None if path is None else outcome(document, path, caplog)[0]
        if result == without:
            named = [text for text in changed.named if text in message]
            assert named and message, f'{changed.action}: read as if it were absent'


@pytest.mark.parametrize('kind', KINDS)
@files
@given(seed=st.integers(0, 2**63))
def test_extreme_values_and_damaged_bytes_are_read_or_refused(
    kind: str, seed: int, folder: Any, trial: Any, caplog: Any
) -> None:
    chance = random.Random(seed)
    document = chance.choice([item for item in DOCUMENTS if item.kind == kind])
    is_damaged = not document.tree or chance.random() < 0.5
    tree = document.tree if is_damaged else insane(chance, document)
    path = written(document, folder(), tree)
    if path is None:
        return
    if is_damaged:
        # headers and other parts of a Shapefile are damaged too
        part = chance.choice(sorted(path.parent.glob(f'{path.stem}.*')))
        part.write_bytes(damaged(chance, part.read_bytes()))
    with trial(kind) as row:
        result, _ = outcome(document, path, caplog)
        row['refused'] += result is None
        assert result is None or kind == 'rasters' or not has_nan(result)


#: Documents that GDAL reads, in the reader process.
OF_GDAL = [
    number for number, item in enumerate(DOCUMENTS)
    if item.kind == 'vectors' or (item.kind == 'rasters' and item.write is not DOCUMENTS[0].write)
]


@pytest.mark.parametrize('number', OF_GDAL)
@settings(max_examples=max(1, settings.default.max_examples // 10), phases=[Phase.generate])
@given(seed=st.integers(0, 2**63))
def test_damaged_files_of_each_format_leave_the_reader_usable(
    number: int, seed: int, folder: Any, whole: Any, trial: Any, caplog: Any
) -> None:
    chance, document = random.Random(seed), DOCUMENTS[number]
    expected = whole(number)
    path = document.write(folder(), document.tree)
    part = chance.choice(sorted(path.parent.glob(f'{path.stem}.*')))
    content = part.read_bytes()
    part.write_bytes(damaged(chance, content))
    with trial(document.kind) as row:
        result, _ = outcome(document, path, caplog)
        row['refused'] += result is None
        part.write_bytes(content)
        assert outcome(document, path, caplog)[0] == expected
