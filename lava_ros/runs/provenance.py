# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Provenance of a run: program, inputs, scene, and a digest of all that decides its result."""

from collections.abc import Mapping, Sequence
from datetime import datetime, timezone
import hashlib
import json
from pathlib import Path
import subprocess
from typing import Any

import lava_ros
from lava_ros.scene import date_text, Scene, scene_to_dict
from lava_ros.scene.erupting_lava import EruptingLava
from lava_ros.simulation import MODEL

#: Maximum wait for git [s].
_GIT_TIMEOUT = 5.0


def description(
    scene: Scene, identity: str, settings: Mapping[str, Any],
    inputs: Sequence[Mapping[str, Any]] = (),
) -> dict[str, Any]:
    """Return the part of ``run.json`` that is known at the start, and that all runs have.

    Args:
        scene: The scene, with all values resolved.
        identity: Digest of the scene and the settings.
        settings: Everything else that the user has chosen, as plain data.
        inputs: Path, size and digest of each input file.
    """
    begun = datetime.now(timezone.utc).replace(microsecond=0)
    return {
        'program': program(), 'identity': identity, 'begun': date_text(begun),
        'onset': None if scene.onset is None else date_text(scene.onset),
        'settings': dict(settings), 'inputs': list(inputs), 'scene': scene_to_dict(scene),
        'erupting_lava': EruptingLava.of(scene).as_dict(),
    }


def program() -> dict[str, Any]:
    """Return the version, the model number and the commit of this program."""
    return {'lava_ros': lava_ros.__version__, 'model': MODEL, 'commit': _commit()}


def _commit() -> str | None:
    """Return the commit of the checkout from which the package runs, None without one."""
    root = Path(lava_ros.__file__).resolve().parents[1]
    if not (root / '.git').exists():
        return None
    words = ['git', '-C', str(root), 'describe', '--always', '--dirty', '--abbrev=40',
             '--exclude', '*']
    try:
        done = subprocess.run(
            words, capture_output=True, text=True, timeout=_GIT_TIMEOUT, check=True
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip() or None


def identity_of(scene: Scene, settings: Mapping[str, Any]) -> str:
    """Return a digest that identifies the scene and the settings of a run.

    Args:
        scene: The scene, with all values resolved.
        settings: Everything else that determines the result, as plain data.
    """
    digest = hashlib.sha256()
    grids = [scene.terrain.elevation, *(flow.thickness for flow in scene.emplaced_flows)]
    grids += [event.terrain.elevation for event in scene.events if event.terrain is not None]
    for grid in grids:
        digest.update(grid.tobytes())
    plain = {'scene': scene_to_dict(scene), **settings}
    digest.update(json.dumps(plain, sort_keys=True, default=str).encode())
    return digest.hexdigest()
