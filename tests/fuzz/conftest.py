# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Fixtures of the fuzzers: few examples in a test run, many in `make nightly`.

Do not import this file: that would load the profile of a test run a second time.
"""

from collections.abc import Callable
from pathlib import Path
import shutil
from typing import Any

from hypothesis import given, HealthCheck, seed, settings
from hypothesis.internal.conjecture import providers
import pytest

from ros.conftest import graph, local  # noqa: F401

#: Runs a check on a part of the examples: takes the check and the strategies of its arguments.
RunPart = Callable[..., None]

#: Parts of a long kind in `make nightly`: a failed part does not end the others, and processors
#: take part after part.
PARTS = 40

# Every test run tries the same scenes and messages, whichever modules are loaded: Hypothesis draws
# some numbers from the source of the modules that are not installed.
providers.is_local_module_file = lambda path: False  # type: ignore[attr-defined]
settings.register_profile(
    'ci', max_examples=40, derandomize=True, deadline=None, database=None,
    suppress_health_check=list(HealthCheck), print_blob=True,
)
settings.register_profile(
    'nightly', settings.get_profile('ci'), max_examples=2000, derandomize=False
)
settings.load_profile('ci')


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Run a test that uses ``in_part`` once for each part."""
    if 'in_part' in metafunc.fixturenames:
        count = 1 if settings().derandomize else PARTS
        metafunc.parametrize('in_part', [(part, count) for part in range(count)], indirect=True,
                             ids=lambda part: str(part[0]))


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Callable[[], Path]:
    """Return a function that makes an empty folder in place of the previous one."""
    path = tmp_path_factory.mktemp('fuzz') / 'folder'

    def fresh() -> Path:
        shutil.rmtree(path, ignore_errors=True)
        path.mkdir()
        return path

    return fresh


@pytest.fixture
def in_part(request: pytest.FixtureRequest) -> RunPart:
    """Return a function that runs a check on the examples of one part, each with its own seed."""
    part, count = request.param
    chosen = request.config.getoption('--hypothesis-seed')

    def run(check: Callable[..., None], profile: Any = None, **strategies: Any) -> None:
        profile = profile or settings()
        part_of_it = settings(profile, max_examples=-(-profile.max_examples // count))
        tried = part_of_it(given(**strategies)(check))
        (tried if chosen is None else seed(f'{chosen} {part}')(tried))()

    return run
