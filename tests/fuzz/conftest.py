# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""How much is tried: a little in every test run, a lot in `make nightly`.

Nothing may import this file: the profile of every test run would be loaded once more.
"""

from collections.abc import Callable
from typing import Any

from hypothesis import given, HealthCheck, seed, settings
import pytest

from ros.conftest import graph  # noqa: F401

#: Runs a check on a part of a night's examples: takes it and the strategies of its arguments.
Share = Callable[..., None]

#: Parts that `make nightly` splits long kinds into: one that fails does not end the others, and
#: each processor takes one after the other.
SHARES = 40

# Scenes, and messages over DDS, of a run; every test run tries the same ones.
settings.register_profile(
    'ci',
    max_examples=100,
    derandomize=True,
    deadline=None,
    database=None,
    suppress_health_check=list(HealthCheck),
    print_blob=True,
)
settings.register_profile(
    'nightly', settings.get_profile('ci'), max_examples=2000, derandomize=False
)
settings.load_profile('ci')


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Run a test that asks for ``in_share`` once for each part."""
    if 'in_share' in metafunc.fixturenames:
        count = 1 if settings().derandomize else SHARES
        metafunc.parametrize('in_share', [(part, count) for part in range(count)], indirect=True,
                             ids=lambda part: str(part[0]))


@pytest.fixture
def in_share(request: pytest.FixtureRequest) -> Share:
    """Runs a check on this part's examples; a seed that was chosen gives each part its own."""
    part, count = request.param
    chosen = request.config.getoption('--hypothesis-seed')

    def run(check: Callable[..., None], profile: Any = None, **strategies: Any) -> None:
        profile = profile or settings()
        part_of_it = settings(profile, max_examples=-(-profile.max_examples // count))
        tried = part_of_it(given(**strategies)(check))
        (tried if chosen is None else seed(f'{chosen} {part}')(tried))()

    return run
