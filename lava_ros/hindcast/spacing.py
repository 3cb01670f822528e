# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The spacing of a preset for a case, from pilot runs (forecast/preset_spacing.py)."""

from dataclasses import replace
import json
from pathlib import Path

from lava_ros.errors import refusing
from lava_ros.files import write_output
from lava_ros.forecast.preset_spacing import choose_spacing, SpacingChoice
from lava_ros.hindcast.case import Case
from lava_ros.hindcast.run import FORCED, identity_of, Settings, simulated_scene
from lava_ros.simulation.selection import effects_for

#: File with the spacing of an unfinished run, in its folder.
FILE = 'spacing.json'


def settings_with_spacing(
    case: Case, settings: Settings, *, runs: int = 1, folder: Path | None = None
) -> tuple[Settings, SpacingChoice | None]:
    """Return settings with the spacing of their preset, and the choice.

    The pilots have the cells of a run with the first guess.

    Args:
        case: The case.
        settings: Settings of the runs. A spacing that is given remains, without a choice.
        runs: Number of runs.
        folder: Folder of the run, which keeps the spacing; None keeps nothing.

    Raises:
        LavaError: If a pilot fails, or the folder has a damaged file.
    """
    if settings.spacing is not None:
        return settings, None
    identity, path = identity_of(case, settings), None if folder is None else folder / FILE
    if path is not None and path.is_file():
        expected = 'a complete unfinished run; --fresh starts again from time 0'
        with refusing('output', str(path), expected, OSError, KeyError, ValueError):
            plain = json.loads(path.read_text(encoding='utf-8'))
            if plain['identity'] == identity:
                return replace(settings, spacing=float(plain['spacing_m'])), None
    accuracy, switches = settings.accuracy(case), {**FORCED, **settings.forced}
    scene = simulated_scene(case, settings.coarseness(case))
    choice = choose_spacing(
        scene, settings.preset, accuracy,
        effects=effects_for(scene, switches, accuracy=accuracy, horizon=case.duration),
        horizon=case.duration, runs=runs, device=settings.device,
    )
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        plain = {'identity': identity, 'spacing_m': choice.spacing}
        write_output('output', path, json.dumps(plain))
    return replace(settings, spacing=choice.spacing), choice
