# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Scripts of docs/ and examples/, which no package contains."""

from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
import sys
from typing import Any


def load_script(path: Path) -> Any:
    """Import a script by its path, and the scripts beside it that it uses; return the module."""
    spec = spec_from_file_location(path.stem, path)
    assert spec is not None and spec.loader is not None
    module = module_from_spec(spec)
    sys.path.insert(0, str(path.parent))
    try:
        spec.loader.exec_module(module)
    finally:
        sys.path.remove(str(path.parent))
    return module
