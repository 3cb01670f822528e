# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Parts of effects that run on the device and depend on the solver, one file an effect."""

from functools import lru_cache
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from lava_ros.effects import load


@lru_cache
def device_part(name: str) -> Any:
    """Return the module with the device part of an effect: of this folder, or its declaration."""
    path = f'{__name__}.{name}'
    return load(name) if find_spec(path) is None else import_module(path)
