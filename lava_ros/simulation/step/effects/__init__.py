# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Parts of effects that run on the device and depend on the solver, one file an effect."""

from functools import lru_cache
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from lava_ros.effects import Effects, load


@lru_cache
def _module(name: str) -> Any:
    path = f'{__name__}.{name}'
    return load(name) if find_spec(path) is None else import_module(path)


def device_parts(effects: Effects, hook: str) -> dict[str, Any]:
    """Return what the effects that are on define by a name, such as ``AfterStep``, by effect.

    An effect without a module in this folder may define it in its declaration.
    """
    return {name: getattr(part, hook) for name in effects if hasattr(part := _module(name), hook)}
