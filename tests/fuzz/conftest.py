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

"""How much is tried: a little in every test run, a lot in `make nightly`."""

from collections.abc import Mapping
import fcntl
import json
import os
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck, settings
import pytest

from ros.conftest import graph  # noqa: F401

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


@pytest.fixture(scope='session')
def figures():
    """What was tried and what came of it; goes to the JSON file LAVA_FUZZ_FIGURES names.

    Several processes share the tests of ``make nightly``: each adds its own to the file.
    """
    result = {}
    yield result
    path = os.environ.get('LAVA_FUZZ_FIGURES')
    if path:
        with Path(path).open('a+', encoding='utf-8') as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            file.seek(0)
            known = json.loads(file.read() or '{}')
            file.truncate(0)
            file.write(json.dumps(_added(known, result), indent=2) + '\n')


def _added(known: Mapping[str, Any], more: Mapping[str, Any]) -> dict[str, Any]:
    """Both, with the sums of what both count in parts."""
    result = dict(known)
    for name, value in more.items():
        if isinstance(value, Mapping):
            value = _added(result.get(name, {}), value)
        elif isinstance(value, int):
            value += result.get(name, 0)
        result[name] = value
    return result
