# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Files of which one part is changed: the change has its effect, or an error or a warning."""

from collections.abc import Callable
from functools import cache
from pathlib import Path
import random
import re
import shutil
from typing import Any
import warnings

from hypothesis import given, Phase, settings
from hypothesis import strategies as st
import pytest

from fuzz.limits import bounded
from fuzz.mutations import change, damaged, Document, DOCUMENTS, KINDS
from lava_ros.errors import LavaError

#: Most that reading a file may take beside what is there [bytes].
MEMORY = 3 << 30

#: Files of each kind: 25 in every test run, 500 in `make nightly`.
FILES = max(1, settings.default.max_examples // 4)

files = settings(max_examples=FILES, phases=[Phase.generate])

#: A number that is none, in a result; text is in quotes there.
NAN = re.compile(r'\bnan(?=[,)\]}])')


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Callable[[], Path]:
    """Makes an empty folder, in the place of the one before."""
    path = tmp_path_factory.mktemp('mutations') / 'folder'

    def fresh() -> Path:
        shutil.rmtree(path, ignore_errors=True)
        path.mkdir()
        return path

    return fresh


@pytest.fixture(scope='module')
def whole(folder: Callable[[], Path]) -> Callable[[int], str]:
    """Results of the valid files."""

    @cache
    def read(number: int) -> str:
        document = DOCUMENTS[number]
        return repr(document.read(document.write(folder(), document.tree)))

    return read


def outcome(document: Document, path: Path, caplog: Any) -> tuple[str | None, str]:
    """The result of a file, None where it is refused, and what is said."""
    caplog.clear()
    try:
        with bounded(MEMORY), warnings.catch_warnings():
            # what numpy warns of is a number that was not looked at
            warnings.simplefilter('error', RuntimeWarning)
            result = repr(document.read(path))
    except LavaError as error:
        assert error.field and error.expected
        return None, str(error)
    return result, caplog.text


def written(document: Document, folder: Path, tree: Any) -> Path | None:
    """Write a changed document; None if it cannot be written as such a file."""
    try:
        return document.write(folder, tree)
    # what GDAL, numpy, JSON and YAML cannot write is not read either
    except Exception:
        return None


@pytest.mark.parametrize('kind', KINDS)
@files
@given(seed=st.integers(0, 2**63))
def test_a_changed_part_is_understood_or_named(
    kind: str, seed: int, folder: Any, whole: Any, trial: Any, caplog: Any
) -> None:
    """No change makes a file read as if the part were absent without a word that names it."""
    chance = random.Random(seed)
    number = chance.choice([at for at, item in enumerate(DOCUMENTS) if item.kind == kind])
    document = DOCUMENTS[number]
    expected = whole(number)
    changed = change(chance, document)
    path = written(document, folder(), changed.tree)
    if path is None:
        return
    with trial(kind) as row:
        result, said = outcome(document, path, caplog)
        row['refused'] += result is None
        if result is None:
            return
        assert not changed.is_refused, changed.what
        assert kind == 'rasters' or not NAN.search(result), changed.what
        if changed.same is not None:
            assert (result == expected) == changed.same, changed.what
        is_added = changed.without is document.tree
        if changed.without is None or (result == expected and not is_added):
            return
        path = written(document, folder(), changed.without)
        without = None if path is None else outcome(document, path, caplog)[0]
        if result == without:
            named = [text for text in changed.named if text in said]
            assert named and said, f'{changed.what}: read as if it were not there'


@pytest.mark.parametrize('kind', KINDS)
@files
@given(seed=st.integers(0, 2**63))
def test_damaged_bytes_are_read_or_refused(
    kind: str, seed: int, folder: Any, trial: Any, caplog: Any
) -> None:
    """A result, or an error with a name: no other exception."""
    chance = random.Random(seed)
    document = chance.choice([item for item in DOCUMENTS if item.kind == kind])
    path = document.write(folder(), document.tree)
    # headers and the other parts of a Shapefile are damaged too
    parts = sorted(path.parent.glob(f'{path.stem}.*'))
    damaged(chance, chance.choice(parts))
    with trial(kind) as row:
        result, _ = outcome(document, path, caplog)
        row['refused'] += result is None
        assert result is None or kind == 'rasters' or not NAN.search(result)
