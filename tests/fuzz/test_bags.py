# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Hostile bags give a result or one error, soon and in bounded memory."""

from collections.abc import Callable, Iterator
from pathlib import Path
import random
import re
from typing import Any
import warnings

from hypothesis import Phase, settings
from hypothesis import strategies as st
import pytest

from command_line import lava
from fuzz.bags import hostile_bag
from fuzz.limits import bounded
from lava_ros.bag.replay import schedule
from recording import record

#: Bags are slow: 2 in a test run, 500 in `make nightly`.
BAGS = settings(
    max_examples=2 if settings.default.derandomize else 500, phases=[Phase.generate]
)


def call(*words: object) -> tuple[int, str]:
    """Call `lava` within limits; return its exit status and all output."""
    with bounded(), warnings.catch_warnings():
        # numpy warns of a number that was not checked
        warnings.simplefilter('error', RuntimeWarning)
        status, *output = lava(*words)
    output = ''.join(output)
    assert status in (0, 1, 2), output
    assert 'no memory is left' not in output
    assert output.replace('\n', '').replace('\t', '').isprintable()
    assert status == 0 or re.search('expected|damaged|cut off', output), output
    return status, output


@pytest.fixture(scope='module')
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Record a small bag."""
    return record(tmp_path_factory.mktemp('sound') / 'bag', (200.0, 400.0))


@pytest.fixture(scope='module', autouse=True)
def unpublished() -> Iterator[None]:
    """Let a replay read the bag without publishing it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            'lava_ros.clients.player.play', lambda bag, **_: sum(1 for _ in schedule(bag))
        )
        yield


def test_hostile_bags(in_part: Any, sound: Path, folder: Callable[[], Path], trial: Any) -> None:
    def is_read_or_refused(number: int) -> None:
        chance = random.Random(number)
        path = folder()
        hostile_bag(chance, sound, path / 'bag')
        commands = [
            ('bag info', path / 'bag'),
            ('bag info', path / 'bag', '--json', path / 'out.json'),
            ('ros replay', path / 'bag'),
            ('map', path / 'bag', '-o', path / 'out.png'),
            ('map', path / 'bag', '-o', path / 'out.html'),
            ('export', path / 'bag', '-o', path / 'out', '--every'),
            ('bag recover', path / 'bag', '-o', path / 'new'),
        ]
        with trial('bags') as row:
            statuses = [call(*words)[0] for words in chance.sample(commands, 2)]
            row['refused'] += any(statuses)
            if (path / 'new').exists():
                status, output = call('bag', 'info', path / 'new')
                assert (status, 'damaged (' in output) == (0, False), output

    in_part(is_read_or_refused, BAGS, number=st.integers(0, 2**63))
