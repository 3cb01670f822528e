# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Initial scene, terrain or checkpoint of a node, and the simulation of it."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
import math
from pathlib import Path
from typing import Any, TYPE_CHECKING

from rclpy.node import Node

from lava_ros import validation
from lava_ros.bag import BagReader
from lava_ros.bag.checkpoints import newest_checkpoint
from lava_ros.bag.description import described
from lava_ros.errors import LavaError
from lava_ros.live.catch_up import Published
from lava_ros.live.recorder import BagFolder
from lava_ros.live.restart import check_token, differing, digests, Progress, RestartFile
from lava_ros.live.session import Origin
from lava_ros.ros import node_parameters, parameters
from lava_ros.ros.parameters import constant_values, Settings
from lava_ros.scene import (
    constants_of,
    date_text,
    Scene,
    SceneSource,
    Terrain,
    Vent,
    vents_from_list,
)
from lava_ros.scene.onset import recorded_onset
from lava_ros.simulation.carriers import AUTO, COUNTED
from lava_ros.simulation.method import MethodChoice, settled_method
from lava_ros.simulation.output.checkpoint import Checkpoint
from lava_ros.simulation.presets import preset_accuracy, PRESETS
from lava_ros.simulation.resolution import resolved_accuracy

if TYPE_CHECKING:
    from lava_ros.simulation import Simulation


#: Parameters of the run, which are read before the parameters of the scene are declared.
_RESTART = tuple(
    spec for spec in parameters.PARAMETERS
    if spec.name in ('restart_token', 'bag_root', 'bag_directory', 'frame_id', 'sea_level')
)


@dataclass(frozen=True)
class StartupInputs:
    """Initial inputs of a node; without any, it waits for the topics.

    Attributes:
        scene: Initial scene; with a checkpoint, its scene.
        terrain: Terrain without a scene.
        checkpoint: Checkpoint to resume from.
        origin: Origin of the checkpoint.
        before: Vents up to the checkpoint with their discharges, as its bag describes them.
        onset: Date of simulated time 0 in its bag or in the scene, empty without one.
        frame_id: Frame of the messages of its bag, empty without one.
        given: Digests of the given inputs (``live.restart.digests``).
        bag_folder: Folder of the bags.
        restart_file: File with the progress of the run, None without a ``restart_token``.
        is_restart: True if a killed node is restarted. Its checkpoint takes precedence over
            parameters.
        progress: Progress of the killed node, None for the first start of a run.
        vents_taken: Publications on ``vents`` that the checkpoint includes.
    """

    scene: Scene | None = None
    terrain: Terrain | None = None
    checkpoint: Checkpoint | None = None
    origin: Origin | None = None
    before: tuple[Vent, ...] = ()
    onset: str = ''
    frame_id: str = ''
    given: Mapping[str, str] = field(default_factory=dict)
    bag_folder: BagFolder = field(default_factory=partial(BagFolder, '', ''))
    restart_file: RestartFile | None = None
    is_restart: bool = False
    progress: Progress | None = None
    vents_taken: tuple[tuple[int, int], ...] = ()

    @property
    def published(self) -> Published | None:
        """The newest maps of the killed node, None for the first start of a run."""
        progress = self.progress
        if progress is None:
            return None
        clock = None if progress.is_held else progress.stamp_ns * 1e-9
        return Published(progress.time + progress.behind, clock)


def load_startup_inputs(node: Node, *, may_restart: bool = False) -> StartupInputs:
    """Declare the parameters of the sources, and load the files that they name.

    Args:
        node: Node that has the parameters.
        may_restart: True to continue the run that has the ``restart_token``, if there is one.

    Raises:
        LavaError: If a file or a bag is not usable, or both a scene and a bag to resume are given.
    """
    values = node_parameters.declare(node, parameters.SOURCES + _RESTART)
    token = values['restart_token']
    check_token(token)
    folder = BagFolder(
        values['bag_root'], values['bag_directory'], node=node.get_fully_qualified_name()
    )
    file = RestartFile(folder.restart_path(token)) if token else None
    progress = _progress(node, file) if file is not None and may_restart else None
    try:
        given = _given(node, values)
    except LavaError as error:
        if progress is None:
            raise
        warning = f'the inputs cannot be compared with those of {progress.bag}: {error}'
        node.get_logger().warning(warning)
        given = StartupInputs(given=progress.given)
    given = replace(given, bag_folder=folder, restart_file=file)
    if progress is not None:
        if differs := differing(given.given, progress.given):
            node.get_logger().warning(
                f'not resuming {progress.bag}: {", ".join(differs)} differ from those of the run '
                f'with the restart_token {token}; this is a new run'
            )
        elif (restarted := _restarted(node, progress, given)) is not None:
            return restarted
    return _resumed(node, given, values['resume']) if values['resume'] else given


def _given(node: Node, values: Mapping[str, Any]) -> StartupInputs:
    """Load the scene and the terrain that the parameters name."""
    if values['resume']:
        for name in ('scene', 'terrain_file'):
            if values[name]:
                raise validation.surplus(name, 'with resume: the checkpoint contains it')
    source = SceneSource(
        path=values['scene'] or None,
        terrain=values['terrain_file'] or None,
        sea_level=values['sea_level'] if values['sea_level'] > parameters.NO_SEA else None,
        # an elevation alone has no vents: they come from topics
        has_vents=False,
        words={'path': 'scene', 'terrain': 'terrain_file'},
    )
    scene = source.load().scene if source.path else None
    terrain = scene.terrain if scene else source.load_terrain()
    others = {'frame_id': values['frame_id'], 'resume': values['resume']}
    given = digests(scene, terrain, **others)
    onset = '' if scene is None or scene.onset is None else date_text(scene.onset)
    return StartupInputs(
        scene=scene, terrain=None if scene else terrain, onset=onset, given=given
    )


def _progress(node: Node, file: RestartFile) -> Progress | None:
    try:
        return file.read()
    except LavaError as error:
        node.get_logger().warning(f'cannot resume the run of the restart_token: {error}')
        return None


def _restarted(
    node: Node, progress: Progress, given: StartupInputs
) -> StartupInputs | None:
    """Load the newest checkpoint of a killed run; None if it cannot be used."""
    log = node.get_logger()
    try:
        found = _resumed(node, given, progress.bag)
    except LavaError as error:
        log.warning(
            f'cannot resume {progress.bag}, starting again at time 0; the maps had reached '
            f'{progress.time:.3f} s: {error}'
        )
        return None
    assert found.checkpoint is not None
    behind = progress.time - found.checkpoint.time
    if behind < 0.0:
        log.warning(
            f'a reset after this checkpoint is lost: the maps had reached {progress.time:.3f} s'
        )
    elif behind > 0.0:
        log.info(
            f'the maps had reached {progress.time:.3f} s: simulating the {behind:.3f} s since the '
            'checkpoint again, without vents, terrain and effects that changed in between'
        )
    is_newest = math.isclose(found.checkpoint.time, progress.checkpoint_time)
    return replace(
        found,
        is_restart=True,
        progress=progress,
        vents_taken=progress.vents if is_newest else (),
    )


def _resumed(node: Node, given: StartupInputs, bag: str) -> StartupInputs:
    """Load the newest checkpoint of a bag in place of the given scene and terrain."""
    found = newest_checkpoint(bag)
    for error in found.refused:
        node.get_logger().warning(f'a newer checkpoint cannot be used: {error}')
    checkpoint = found.checkpoint
    node.get_logger().info(
        f'resuming at {checkpoint.time:.3f} s simulated with {checkpoint.particle_count} '
        f'{COUNTED[checkpoint.accuracy.method]}, from a checkpoint of lava_ros '
        f'{checkpoint.written_by} in {bag}'
    )
    origin = Origin(str(Path(bag).absolute()), checkpoint.time, found.log_time_ns)
    before: tuple[Vent, ...] = ()
    description = BagReader(bag).custom_data
    known = described(description)
    scene, onset = known['scene'] or {}, recorded_onset(description)
    with suppress(LavaError):
        before = vents_from_list(scene.get('vents', []), checkpoint.scene.terrain)
    return replace(
        given, scene=checkpoint.scene, terrain=None, checkpoint=checkpoint, origin=origin,
        before=before, onset=onset.text if onset else '',
        frame_id=str((known['parameters'] or {}).get('frame_id', '')),
    )


def overrides_from_checkpoint(
    checkpoint: Checkpoint,
    values: Mapping[str, Any],
    defaults: Mapping[str, Any],
    *,
    frame_id: str = '',
    is_restart: bool = False,
) -> dict[str, Any]:
    """Return the parameters that a checkpoint sets in place of their defaults, by name.

    Args:
        checkpoint: The checkpoint.
        values: Parameters as given.
        defaults: Their defaults.
        frame_id: Frame of its coordinates, empty if it is unknown.
        is_restart: True if a killed node is restarted. The checkpoint then takes precedence,
            because parameters may have been changed while the node ran.

    Raises:
        LavaError: If a given parameter contradicts the checkpoint, except in a restart.
    """
    result = {}
    known = _checkpoint_parameters(checkpoint) | ({'frame_id': frame_id} if frame_id else {})
    for name, stored in known.items():
        if _is_same(values[name], stored) or (name, values[name]) == ('method', AUTO):
            # the next start or reset chooses the method again
            continue
        if not is_restart and not _is_same(values[name], defaults[name]):
            expected = f'{stored!r} as in the checkpoint, or no value with resume'
            raise LavaError(name, values[name], expected)
        result[name] = stored
    return result


def _checkpoint_parameters(checkpoint: Checkpoint) -> dict[str, Any]:
    """Return the parameters with which the simulation of a checkpoint was made, by name."""
    forced = checkpoint.forced or {}
    # in ROS, an empty list of strings is a list with one empty string
    result: dict[str, Any] = {
        'effects_on': [name for name in forced if forced[name]] or [''],
        'effects_off': [name for name in forced if not forced[name]] or [''],
        'horizon': checkpoint.horizon / 3600.0,
        'method': checkpoint.accuracy.method,
        **constant_values(constants_of(checkpoint.scene)),
    }
    accuracy, scene = checkpoint.accuracy, checkpoint.scene
    for name, preset in PRESETS.items():
        given = replace(preset.accuracy, method=accuracy.method)
        own = replace(
            given, spacing=accuracy.spacing, thickness=accuracy.thickness,
            longest_step=accuracy.longest_step,
        )
        if own == accuracy:
            automatic = resolved_accuracy(given, scene, forced, horizon=checkpoint.horizon)
            result['preset'] = name
            result['spacing'] = 0.0 if automatic.spacing == accuracy.spacing else accuracy.spacing
    return result


def _is_same(one: Any, other: Any) -> bool:
    if isinstance(one, float) and isinstance(other, float):
        return math.isclose(one, other, rel_tol=1e-12)
    if isinstance(one, list | tuple) or isinstance(other, list | tuple):
        return {*(one or ()), ''} == {*(other or ()), ''}
    return bool(one == other)


def make_simulation(scene: Scene, settings: Settings) -> tuple['Simulation', MethodChoice]:
    """Make a simulation at time 0, in the worker's thread; return it and its method.

    Raises:
        LavaError: If the settings do not fit the scene.
    """
    # the solver loads Warp: done in the worker's thread, not at import
    from lava_ros.simulation import Simulation

    accuracy = preset_accuracy(settings.preset, spacing=settings.spacing)
    choice = settled_method(
        settings.method, scene, accuracy, settings.forced, horizon=settings.horizon
    )
    try:
        simulation = Simulation(
            scene,
            accuracy=replace(accuracy, method=choice.method),
            device=settings.device,
            effects=settings.forced,
            horizon=settings.horizon,
        )
    except LavaError as error:
        # the parameters have no prefix
        raise error.named(error.field.removeprefix('accuracy.')) from error
    return simulation, choice


def resume_simulation(checkpoint: Checkpoint, settings: Settings) -> 'Simulation':
    """Resume the simulation of a checkpoint, in the worker's thread.

    Raises:
        LavaError: If the checkpoint is inconsistent, or the device does not exist.
    """
    from lava_ros.simulation import Simulation

    return Simulation.resume(checkpoint, device=settings.device)
